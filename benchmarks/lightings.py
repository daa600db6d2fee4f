"""Eight lightings, each at two strengths: whether depth called good is good, and the exposure advised for it.

The packaged bench with twice as large pixels (--quick: four times): a lit room, lamps on the mains at 100 and
at 120 Hz, a sun with clouds, a printed pattern under a lamp at the camera, a ring light seen in the mirror,
and the LCD alone, brighter and dimmer. In each a person's steps are taken: `devices --focus` advises an
exposure from frames, which is set, and the loop runs with it. A pad comes down 0.1 mm and stays: nodes
called good in frames called good are compared with the truth, and their rms error with that of the clean
bench (of the print: of the clean bench that reads its LCD passively). Then a grey ball touches, which has to
be named, and nothing before. The best exposure is that, of many in steps of a tenth, at which the view's
nodes hold the most information (sum of 1 / sigma^2 of the residual; under a lamp while the pad presses). At
full size the print is also read under the default press of 0.2 mm.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import coarser, pressed
from zeromethod.commissioning.setting_up import SettingUp
from zeromethod.devices.opening import open_devices
from zeromethod.loop.state import NULLED, State
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session

PRINT = "lamp at the camera, print"
CASES: Sequence[tuple[str, str, dict[str, Any]]] = (
    ("clean", "", {}),
    ("passive by the LCD", "", {}),
    ("lit room", "0.3", {"room": 0.3}),
    ("lit room", "1", {"room": 1.0}),
    ("mains, 100 Hz", "0.3", {"mains": 0.3}),
    ("mains, 100 Hz", "1", {"mains": 1.0}),
    ("mains, 120 Hz", "0.3", {"mains": 0.3, "mains_hz": 120.0}),
    ("mains, 120 Hz", "1", {"mains": 1.0, "mains_hz": 120.0}),
    ("sun and clouds", "1", {"sun": 1.0, "cloud_s": 1.5}),
    ("sun and clouds", "3", {"sun": 3.0, "cloud_s": 1.5}),
    (PRINT, "1", {}),
    (PRINT, "0.7", {"brightness": 0.7}),
    ("ring light", "0.3", {"ring": 0.3}),
    ("ring light", "1", {"ring": 1.0}),
    ("LCD, brighter", "1.1", {"brightness": 1.1}),
    ("LCD, brighter", "1.2", {"brightness": 1.2}),
    ("LCD, dimmer", "0.5", {"brightness": 0.5}),
    ("LCD, dimmer", "0.25", {"brightness": 0.25}),
)
REFERENCES = frozenset({"clean", "passive by the LCD"})
DEPTH_MM, TOUCH_S, SETTLED_S, LAST_S = 0.1, 0.5, 0.75, 2.2
"""The pad's press: when it comes, from when it counts, and when the run ends; a burst takes most of that."""
LOOK_S, LOOKS = 1.6, 5
"""How long focus looks, and how often its advice is followed while the picture saturates."""
GOOD = NULLED | {State.PASSIVE}
BEYOND_PERCENT, WITHIN, PASSIVE_PERCENT = 1.0, 1.3, 1.5


@dataclass(frozen=True)
class Lit:
    """What came of one lighting.

    advised_ms, best_ms: exposures. rms_nm: of the pressed mirror's depth, nodes called good, median frame;
    rms_sigma_nm: of that median, by how frames scatter.
    beyond: of these, off by over three sigma, percent. valid: share of the nodes in view. good: frames called
    good of those pressed. found: whether the ball was named, None where contacts are not outlined.
    """

    light: str
    strength: str
    advised_ms: float
    best_ms: float
    rms_nm: float
    rms_sigma_nm: float
    beyond: float
    peak_percent: float
    valid: float
    good: float
    false: int
    found: bool | None


def rig_of(light: str, values: dict[str, Any], factor: int) -> Rig:
    """The bench under a light."""
    rig = coarser(load_rig("printed" if light == PRINT else "simulated"), factor)
    rig = rig.replace({f"light.{key}": value for key, value in values.items()} | {"scenario": "none"})
    return rig.replace({"control.controller": "passive"}) if light.startswith("passive") else rig


@contextmanager
def exposed(rig: Rig, exposure_s: float) -> Iterator[Session]:
    """A session of the simulated bench whose camera was set to an exposure before."""
    with ExitStack() as stack:
        devices = stack.enter_context(open_devices(rig))
        setter: Any = devices.camera
        setter.set_exposure(exposure_s)
        yield stack.enter_context(Session(rig, devices=devices))


def advised_s(rig: Rig) -> float:
    """The exposure that focus advises, followed."""
    exposure_s = rig.camera.exposure_s
    for _ in range(LOOKS):
        with open_devices(rig) as devices:
            setter: Any = devices.camera
            setter.set_exposure(exposure_s)
            sight = list(SettingUp(rig, devices, with_lcd=True).sights(LOOK_S))[-1]
        saturated = sight.report.saturated_share > 0
        exposure_s = sight.advised_exposure_s
        if not saturated:
            break
    return exposure_s


def pad(rig: Rig, at_s: float = TOUCH_S) -> Any:
    """The bench under the pad."""
    return pressed(rig, [(at_s, 0.0), (at_s + 0.05, DEPTH_MM), (LAST_S + 1, DEPTH_MM)])


def best_s(rig: Rig) -> float:
    """The exposure at which the view's nodes hold the most information, by sweep."""
    frame_s = 1 / rig.camera.rate_hz
    found = []
    with pad(rig, 0.0 if rig.light.by_mirror else LAST_S) as bench:
        for exposure_s in frame_s * 1.1 ** -np.arange(24.0):
            with exposed(bench, float(exposure_s)) as session:
                seen = [step.residual for step in session.run(frames=9) if step.residual is not None]
                sums = [np.sum(np.where(one.valid[..., None], one.sigma**-2.0, 0.0)) for one in seen[-4:]]
            found.append((float(np.median(sums)) if sums else 0.0, float(exposure_s)))
            if found[-1][0] < 0.5 * max(found)[0]:
                break
    return max(found)[1]


def lit(light: str, strength: str, values: dict[str, Any], factor: int, sweep: bool) -> Lit:
    """Run one lighting."""
    rig = rig_of(light, values, factor)
    exposure_s = advised_s(rig)
    errors, sigmas, peaks, valid = [], [], [], []
    false = good = frames = 0
    with pad(rig) as bench, exposed(bench, exposure_s) as session:
        truth = session.result.true_mirror
        assert truth is not None
        for step in session.run(seconds=LAST_S):
            false += bool(step.contacts)
            if 1e-9 * step.time_ns < SETTLED_S:
                continue
            frames += 1
            surface = step.surface
            if surface is None or step.state not in GOOD:
                continue
            good += 1
            nodes = surface.valid
            true = truth(step.time_ns).depth(surface.x_mm[nodes], surface.y_mm[nodes])
            off = surface.depth_mm[nodes] - true
            errors.append(1e6 * float(np.sqrt(np.mean(off**2))))
            sigmas.append(np.abs(off) / surface.sigma_depth_mm[nodes])
            valid.append(step.valid_share)
            if step.peak is not None:
                peaks.append(100 * (step.peak.depth_mm - DEPTH_MM) / DEPTH_MM)
    found, touched = (None, 0) if rig.light.by_mirror else touching(rig, exposure_s)
    return Lit(
        light, strength, 1e3 * exposure_s, 1e3 * best_s(rig) if sweep else float("nan"),
        float(np.median(errors)) if errors else float("nan"),
        float(np.std(errors) * np.sqrt(np.pi / 2 / len(errors))) if errors else float("nan"),
        100 * float(np.mean(np.concatenate(sigmas) > 3)) if sigmas else 0.0,
        float(np.median(peaks)) if peaks else float("nan"), float(np.median(valid)) if valid else 0.0,
        good / max(frames, 1), false + touched, found,
    )  # fmt: skip


def touching(rig: Rig, exposure_s: float) -> tuple[bool, int]:
    """(whether a grey ball that touches is named within six frames, false contacts before)."""
    named = false = 0
    with exposed(rig.replace({"scenario": "hertz"}), exposure_s) as session:
        for step in session.run(seconds=0.6):
            time_s = 1e-9 * step.time_ns
            false += bool(step.contacts) and time_s < 0.3
            named += bool(step.contacts) and time_s > 0.45
    return named > 0, false


def passive_live() -> tuple[float, float, float]:
    """(worst peak error in the hold, percent; frames read of all; ms of a frame) of 0.2 mm under a lamp."""
    rig = load_rig("printed")
    off, times = [], []
    read = frames = 0
    with Session(rig) as session:
        for step in session.run(seconds=1.0):
            frames += step.frame_number is not None
            read += step.surface is not None
            times.append(step.loop_ms + step.read_ms)
            if step.phase == "hold" and step.truth is not None:
                off.append(step.truth.depth_peak_error_percent)
    return max(off, key=abs), read / frames, float(np.nanmedian(times))


def ratio(found: Sequence[Lit], one: Lit) -> tuple[float, float]:
    """Error over that of the bench that it is compared with, and the sigma of that."""
    reference = "passive by the LCD" if one.light == PRINT else "clean"
    clean = next((each for each in found if each.light == reference), None)
    if clean is None:
        return float("nan"), float("nan")
    over = one.rms_nm / clean.rms_nm
    return over, over * float(np.hypot(one.rms_sigma_nm / one.rms_nm, clean.rms_sigma_nm / clean.rms_nm))


def report(found: Sequence[Lit], passive: tuple[float, float, float] | None) -> Report:
    """Figures with their bars."""
    others = [one for one in found if one.light not in REFERENCES]
    if not others:
        return Report("Eight lightings", [], [], {"lit": [asdict(one) for one in found]})
    worst = max(others, key=lambda one: np.nan_to_num(ratio(found, one)[0], nan=np.inf))
    most, most_sigma = ratio(found, worst)
    beyond = max(others, key=lambda one: one.beyond)
    false = sum(one.false for one in others)
    named = [one.found for one in others if one.found is not None]
    away = [max(one.advised_ms / one.best_ms, one.best_ms / one.advised_ms) for one in others]
    figures = [
        figure("error over the clean bench's, worst", most, most_sigma, most=4.0),
        Figure("the lighting of that", f"{worst.light} {worst.strength}"),
        Figure("nodes called good beyond 3 sigma, worst", f"{beyond.beyond:.2f} % ({beyond.light} "
               f"{beyond.strength})", f"{BEYOND_PERCENT:g} %", beyond.beyond <= BEYOND_PERCENT),
        figure("frames with a false contact", false, most=0),
        Figure("lightings in which a ball that touches is named", f"{sum(named)} of {len(named)}", "all",
               all(named)),
    ]  # fmt: skip
    if passive is not None:
        percent, read, frame_ms = passive
        name = "print under a lamp, full size, 0.2 mm: peak in the hold, worst frame"
        bar = f"{PASSIVE_PERCENT:g} %"
        figures.append(Figure(name, f"{percent:+.2f} %", bar, abs(percent) <= PASSIVE_PERCENT))
        figures.append(Figure("the same: frames read; time of one", f"{read:.0%}; {frame_ms:.1f} ms"))
    if np.isfinite(away).any():
        far = float(np.nanmax(away))
        name = "exposure advised over the best, or under, worst"
        figures.append(Figure(name, f"{far:.2f}", f"{WITHIN:g}", far <= WITHIN))
    rows: list[Sequence[str]] = [
        ("light", "strength", "exposure advised", "best", "rms", "over clean", "> 3 sigma", "peak", "valid",
         "frames good", "false", "ball named")
    ]  # fmt: skip
    for one in found:
        named_word = "-" if one.found is None else "yes" if one.found else "NO"
        exposures = f"{one.advised_ms:.1f} ms", f"{one.best_ms:.1f} ms"
        over, sigma = ratio(found, one)
        depth = f"{one.rms_nm:.1f} nm", f"{over:.2f} ± {sigma:.2f}", f"{one.beyond:.2f} %"
        seen = f"{one.peak_percent:+.2f} %", f"{one.valid:.1%}", f"{one.good:.0%}", f"{one.false}"
        rows.append((one.light, one.strength, *exposures, *depth, *seen, named_word))
    data = {"lit": [asdict(one) for one in found], "passive": passive}
    return Report("Eight lightings", figures, rows, data)


@benchmark(
    "lightings",
    __doc__,
    click.option(
        "--only", multiple=True, help="Lightings whose name begins so alone, next to the clean benches."
    ),
    click.option(
        "--full", is_flag=True, help="At the packaged bench's own pixels: minutes for each lighting."
    ),
    click.option("--no-sweep", is_flag=True, help="Leave out the best exposures."),
    part_options,
)
def command(
    *,
    quick: bool,
    full: bool,
    only: tuple[str, ...],
    no_sweep: bool,
    keep: Path | None,
    most_runs: int | None,
) -> Report:
    """Run all lightings, or those of them that are still missing in `keep`."""
    factor = 1 if full else 4 if quick else 2
    cases = [case for case in CASES if not only or case[0] in REFERENCES or case[0].startswith(only)]
    lamp = any(case[0] == PRINT for case in cases)

    def run(number: int) -> dict[str, Any]:
        if number == len(cases):
            return {"passive": passive_live()}
        light, strength, values = cases[number]
        sweep = not no_sweep and light not in REFERENCES
        return {"lit": asdict(lit(light, strength, values, factor, sweep))}

    parts = Parts(keep, most_runs, factor=factor, only=list(only), sweep=not no_sweep)
    found = parts.run(len(cases) + lamp, "lightings", run)
    passive = next((tuple(one["passive"]) for one in found if "passive" in one), None)
    return report([Lit(**one["lit"]) for one in found if "lit" in one], passive)


if __name__ == "__main__":
    start(command)
