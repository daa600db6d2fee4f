"""What touches as an image: contrast and pitch of bars, and of a finger's ridges, against the planted ones.

Hard objects on the packaged bench at full size, with a pupil of 1.25 mm: a stamp of bars 0.5 mm apart and a
finger with ridges 0.45 mm apart, at several angles. They come down within 50 ms and are held; stripes are
measured in the images of the last frames. "Without lamp" is the same with `control.lamp` off. Cost: what a
picture with a new lamp takes longer to draw than one without, and what it takes to work a lamp out, which is
done where surfaces are read; of one thread.
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.contact import Contact, Lamp, Stripes, stripes
from zeromethod.gl import create_context
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.resources import resource
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.view.progress import progress
from zeromethod.warp.rest import Rest

CASES = (
    ("bars", "grey", 30.0, True), ("bars", "grey", 30.0, False), ("bars", "white", 0.0, True),
    ("bars", "black", 60.0, True), ("bars", "grey", 90.0, True),
    ("finger", "white", 20.0, True), ("finger", "white", 20.0, False), ("finger", "white", 0.0, True),
    ("finger", "grey", 45.0, True), ("finger", "white", 70.0, True), ("finger", "white", 90.0, True),
)  # fmt: skip
QUICK = (("bars", "grey", 30.0, True), ("bars", "grey", 30.0, False), ("finger", "white", 20.0, True))
PITCH_MM = {"bars": 0.5, "finger": 0.45}
PUPIL_MM = 1.25
SECONDS = 0.55
COMPARED = 6
"""Last frames that are compared."""
CONTRAST, PITCH_PERCENT, DRAW_MS = 0.5, 2.0, 0.15
_DRAWS = 100


@dataclass(frozen=True)
class Seen:
    """One object, medians of the frames compared; None where nothing was found.

    contacts: how many the object is. lit: nodes at which the LCD is white.
    """

    case: str
    lamp: bool
    contacts: float
    lit: int
    contrast: float | None
    pitch_percent: float | None
    angle_deg: float | None
    area_mm2: float | None


def press_file(folder: Path, name: str, albedo: str, angle_deg: float) -> Path:
    """A packaged scenario with an object of another albedo and direction."""
    text = resource("calibration", "presses", f"{name}.toml").read_text()
    text = re.sub(r'albedo = "\w+"', f'albedo = "{albedo}"', text)
    path = folder / f"{name}-{albedo}-{angle_deg:g}.toml"
    path.write_text(re.sub(r"angle_deg = [\d.]+", f"angle_deg = {angle_deg}", text))
    return path


def measured(rig: Rig, name: str, words: str, angle_deg: float) -> tuple[Seen, Step]:
    """Run one object; its figures, and the last step."""
    with Session(rig) as session:
        steps = list(session.run(seconds=SECONDS))
        lamp = Lamp(session.loop.grid).follow(steps[-1].contacts) if rig.control.lamp else None
    last = steps[-COMPARED:]
    touching = [step.contacts[0] for step in last if step.contacts]
    found = [one for one in map(stripes, touching) if one is not None]
    counts = float(np.median([len(step.contacts) for step in last]))
    lit = 0 if lamp is None else int(np.count_nonzero(lamp))
    own: tuple[float | None, ...] = (None, None, None, None)
    if found:
        own = _medians(found, touching, PITCH_MM[name], angle_deg)
    return Seen(words, rig.control.lamp, counts, lit, *own), steps[-1]


def _medians(
    found: Sequence[Stripes], touching: Sequence[Contact], pitch_mm: float, angle_deg: float
) -> tuple[float, float, float, float]:
    """(contrast, pitch's error in percent, angle's in degrees, area)."""
    pitch = 100 * (np.median([one.pitch_mm for one in found]) / pitch_mm - 1)
    off = [(one.angle_deg - angle_deg + 90) % 180 - 90 for one in found]
    area = float(np.median([one.area_mm2 for one in touching]))
    return float(np.median([one.contrast for one in found])), float(pitch), float(np.median(off)), area


def draw_ms(rig: Rig, contacts: Sequence[Contact]) -> tuple[float, float]:
    """(what a new lamp adds to drawing a picture, what a lamp takes to work out), ms."""
    rest = Rest.of(rig, Optics(rig))
    lamps = Lamp(rest.grid)
    took = []
    for _ in range(_DRAWS):
        started = time.perf_counter()
        lit = lamps.follow(contacts)
        took.append(1e3 * (time.perf_counter() - started))
    if lit is None:
        lit = np.zeros(rest.grid.shape, bool)
    times: dict[bool, list[float]] = {False: [], True: []}
    with create_context() as context:
        target, response = Target.from_spec(rig.target), Response.from_rig(rig.display)
        renderer = PatternRenderer(context, rest.grid, rest.q, rest.display_size, target, response)
        size = rig.display.columns, rig.display.rows
        framebuffer = context.framebuffer([context.texture(size, 1)])
        for k in range(2 * _DRAWS):
            started = time.perf_counter()
            renderer.render(framebuffer, rest.q, lamp=lit.copy() if k % 2 else None)
            context.finish()
            times[bool(k % 2)].append(1e3 * (time.perf_counter() - started))
    # what else runs on the computer only adds
    fast = {lamp: float(np.quantile(those, 0.25)) for lamp, those in times.items()}
    return fast[True] - fast[False], float(np.median(took))


def report(found: Sequence[Seen], cost: tuple[float, float]) -> Report:
    """Figures with their bars."""
    bars = [one for one in found if one.case.startswith("bars") and one.lamp]
    fingers = [one for one in found if one.case.startswith("finger") and one.lamp]
    contrast = min((one.contrast or 0.0 for one in bars), default=0.0)
    one_each = all(one.contacts == 1 for one in found)
    figures = [
        Figure("each object is one contact", "yes" if one_each else "no", "yes", one_each),
        Figure("bars of 0.5 mm: least contrast", f"{contrast:.2f}", f"{CONTRAST:g}", contrast >= CONTRAST),
    ]
    for name, those in (("bars", bars), ("a finger's ridges", fingers)):
        missing = any(one.pitch_percent is None for one in those)
        worst = max((abs(one.pitch_percent or 0.0) for one in those), default=0.0)
        met = not missing and worst <= PITCH_PERCENT
        value = "not found" if missing else f"{worst:.2f} %"
        figures.append(Figure(f"pitch of {name}, worst", value, f"{PITCH_PERCENT:g} %", met))
    figures.append(
        Figure("drawing with a new lamp", f"{cost[0]:+.2f} ms", f"{DRAW_MS:g} ms", cost[0] <= DRAW_MS)
    )
    figures.append(Figure("working a lamp out, not in the loop", f"{cost[1]:.2f} ms"))
    details: list[Sequence[str]] = [
        ("object", "lamp", "contacts", "nodes lit", "contrast", "pitch", "angle", "area")
    ]
    for one in found:
        values = (one.contrast, one.pitch_percent, one.angle_deg, one.area_mm2)
        forms = ("{:.3f}", "{:+.2f} %", "{:+.2f} deg", "{:.2f} mm2")
        words = [
            "-" if value is None else form.format(value) for value, form in zip(values, forms, strict=True)
        ]
        details.append((one.case, "on" if one.lamp else "off", f"{one.contacts:g}", f"{one.lit}", *words))
    return Report("What touches as an image", figures, details, {"seen": [asdict(one) for one in found]})


@benchmark("contact_image", __doc__)
def command(*, quick: bool) -> Report:
    """Run all objects."""
    cases = QUICK if quick else CASES
    found: list[Seen] = []
    largest: tuple[Contact, ...] = ()
    with tempfile.TemporaryDirectory() as folder, progress(len(cases), "objects") as advance:
        for name, albedo, angle, lamp in cases:
            scenario = str(press_file(Path(folder), name, albedo, angle))
            values = {"camera.pupil_mm": PUPIL_MM, "control.lamp": lamp}
            rig = load_rig("simulated").replace(values, scenario=scenario)
            seen, last = measured(rig, name, f"{name}, {albedo}, {angle:g} deg", angle)
            found.append(seen)
            largest = last.contacts or largest
            advance()
    return report(found, draw_ms(load_rig("simulated"), largest))


if __name__ == "__main__":
    start(command)
