"""Touches: how many random ones are named within three frames, and how many are named that never were.

On the packaged bench with twice as large pixels (camera and LCD), a pupil of 1.25 mm.

Touches: balls, punches, rods and cones of random size, place, direction and albedo come down between two
frames and stay for five, in the closed loop, with dirt on the camera face. Each object touches at several
places, as it is solved in elastic contact once. Counted are frames from the first in which the true contact
covers 1.5 mm^2.

Untouched: some hundred frames are rendered in the closed loop, with the same dirt, before noise. They are
shown again and again, each time under the light of its own moment, a backlight that drifts by 0.5 % a minute
and lamps on the mains, and with noise of its own: sensor and finder get them as in a run, the loop's answer
is that of the frames rendered. At the end a ball touches, under the light as it is then: it is to be named,
so that no finder that sees nothing passes.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import coarser
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import rate
from zeromethod.arrays import Image, Single
from zeromethod.contact import ContactFinder
from zeromethod.devices.opening import open_devices
from zeromethod.loop.state import NULLED
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.pattern import Target
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.sensing import ResidualSensor
from zeromethod.session.session import Session
from zeromethod.simulation.nuisances import Nuisances
from zeromethod.simulation.scenario import Scenario, scenario_of
from zeromethod.simulation.sensor import Sensor
from zeromethod.view.progress import progress
from zeromethod.warp.rest import Rest

LARGER = 2
PUPIL_MM = 1.25
LEAST_MM2 = 1.5
NAMED_FRAMES = 3
DIRT = {"simulation.nuisances.dust": 40, "simulation.nuisances.scratches": 2}
PER_MINUTE, MAINS = 0.005, 0.02
AREAS_MM2 = 1.1, 12.0
"""Smallest and largest area of the objects' contacts, roughly."""
ALBEDOS = "black", "grey", "white"
OBJECTS, PLACES = 5, 10
"""Objects of one run, and touches of each."""
NEAR_MM = 1.0
"""How near to the true one a contact's middle is that counts."""
APART_S, HELD_S, FIRST_S = 0.16, 0.08, 0.3
X_MM, Y_MM = (34.0, 50.0), (-8.0, 8.0)
DISTINCT = 240
SEED = 5


@dataclass(frozen=True)
class Touched:
    """One touch. named_after: frames from the first that it covers 1.5 mm^2 in; None: never named."""

    object: str
    albedo: str
    x_mm: float
    y_mm: float
    area_mm2: float
    named_after: int | None


@dataclass(frozen=True)
class Untouched:
    """Frames without a touch: how many, how many of them distinct before noise, named in how many.

    light: the backlight's at the end over that at the start. touch: whether the ball at the end was named.
    """

    frames: int
    distinct: int
    false: int
    light: float
    touch: bool


def bench() -> Rig:
    """The rig, with dirt."""
    return coarser(load_rig("simulated"), LARGER).replace({"camera.pupil_mm": PUPIL_MM, **DIRT})


def an_object(draw: np.random.Generator) -> tuple[str, str, str, float]:
    """(words, albedo, lines of a press file, depth mm) of an object of random shape and size."""
    area = float(np.exp(draw.uniform(*np.log(AREAS_MM2))))
    radius = float(np.sqrt(area / np.pi))
    albedo = str(draw.choice(ALBEDOS))
    shape = str(draw.choice(("ball", "punch", "edge", "cone")))
    if shape == "ball":
        size = float(np.exp(draw.uniform(np.log(8.0), np.log(80.0))))
        lines, depth = f"radius_mm = {size}", radius**2 / size
    elif shape == "punch":
        lines, depth = f"radius_mm = {radius}", float(draw.uniform(0.01, 0.05))
    elif shape == "cone":
        flank = float(draw.uniform(2.0, 20.0))
        lines, depth = f"flank_deg = {flank}", float(0.5 * np.pi * radius * np.tan(np.radians(flank)))
    else:
        size, length = float(draw.uniform(8.0, 30.0)), max(2.0, area)
        lines = f"radius_mm = {size}\nlength_mm = {length}\nangle_deg = {draw.uniform(0, 180)}"
        depth = 2.0 * (0.5 * area / length) ** 2 / size
    return shape, albedo, f'shape = "{shape}"\nalbedo = "{albedo}"\n{lines}', float(max(depth, 0.004))


def touches_of(draw: np.random.Generator) -> list[Touched]:
    """The touches of some objects, in one run."""
    objects = [an_object(draw) for _ in range(OBJECTS)]
    text, frame_s = "", 1 / 60
    for number, (_, _, lines, depth) in enumerate(objects):
        points = ["{time_s = 0.0, x_mm = 42.0, y_mm = 0.0, depth_mm = 0.0}"]
        for k in range(number * PLACES, (number + 1) * PLACES):
            x, y = draw.uniform(*X_MM), draw.uniform(*Y_MM)
            down = FIRST_S + APART_S * k + draw.uniform(0, frame_s)
            held = ((down, 0.0), (down, depth), (down + HELD_S, depth), (down + HELD_S, 0.0))
            points += [f"{{time_s = {t}, x_mm = {x}, y_mm = {y}, depth_mm = {d}}}" for t, d in held]
        text += f"[[object]]\n{lines}\npath = [{', '.join(points)}]\n"
    seconds = FIRST_S + APART_S * PLACES * OBJECTS
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "touches.toml"
        file.write_text(f"duration_s = {seconds}\n{text}")
        rig = bench().replace({}, scenario=str(file))
        truth = scenario_of(rig)
        with Session(rig) as session:
            steps = list(session.run(seconds=seconds))
            return list(_found(steps, truth, [(shape, albedo) for shape, albedo, _, _ in objects]))


def _found(steps: Sequence[Step], truth: Scenario, objects: Sequence[tuple[str, str]]) -> Iterator[Touched]:
    """Each touch of a run that covers 1.5 mm^2."""
    covered = [truth.mirror_at(step.time_ns).touches for step in steps]
    large = [any(touch.area_mm2 >= LEAST_MM2 for touch in touches) for touches in covered]
    for first in (k for k in range(1, len(steps)) if large[k] and not large[k - 1]):
        (touch,) = covered[first]
        named = None
        for k in range(first, len(steps)):
            if not large[k] or named is not None:
                break
            away = (
                np.hypot(one.x_mm - touch.centroid_mm[0], one.y_mm - touch.centroid_mm[1])
                for one in steps[k].contacts
            )
            named = k - first if any(distance < NEAR_MM for distance in away) else None
        yield Touched(*objects[touch.number], *touch.centroid_mm, touch.area_mm2, named)


@dataclass(frozen=True)
class Rendered:
    """Frames before noise, from a run: of the nulled mirror, and of a ball that touches."""

    rig: Rig
    nulled: Sequence[Single]
    touching: Sequence[Single]
    surface: Any


def rendered(count: int) -> Rendered:
    """Run the bench without noise and keep the light of its frames."""
    down = FIRST_S + count / 60
    path = ", ".join(
        f"{{time_s = {t}, x_mm = 42.0, y_mm = 0.0, depth_mm = {d}}}" for t, d in ((down, 0.0), (down, 0.04))
    )
    text = f'duration_s = {down + 1}\n[[object]]\nshape = "ball"\nradius_mm = 20.0\npath = [{path}]\n'
    lights: list[Single] = []
    nulled, touching, surface = [], [], None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "end.toml"
        file.write_text(text)
        rig = bench().replace({}, scenario=str(file))
        with open_devices(rig) as devices:
            chip = vars(devices.camera)["_sensor"]
            image: Callable[[Single, int], Image] = chip.image

            def kept(light: Single, number: int) -> Image:
                lights.append(light.copy())
                return image(light, number)

            vars(chip)["image"] = kept
            with Session(rig, devices=devices) as session:
                for step in session.run(seconds=down + 0.08):
                    if 1e-9 * step.time_ns > down + 0.01:
                        touching.append(lights[-1])
                    elif step.state in NULLED and 1e-9 * step.time_ns < down - 0.01:
                        nulled.append(lights[-1])
                        surface = step.surface or surface
                    lights.clear()
    return Rendered(bench(), nulled, touching, surface)


class Moments:
    """Frames as they come: the light rendered, under the lamps of the moment, with noise."""

    def __init__(self, rig: Rig, seed: int) -> None:
        lit = rig.replace(
            {
                "simulation.nuisances.backlight_per_minute": PER_MINUTE,
                "simulation.nuisances.mains": MAINS,
                "simulation.seed": seed,
            }
        )
        self._lamps, self._chip = Nuisances(lit), Sensor(lit)
        self._exposure_ns = round(1e9 * rig.camera.exposure_s)
        self._rate_hz = rig.camera.rate_hz

    def image(self, light: Single, number: int) -> Image:
        """Frame of that number."""
        begin = round(1e9 * number / self._rate_hz)
        end = begin + self._exposure_ns
        backlight = np.float32(self._lamps.backlight(begin, end))
        return self._chip.image(light * backlight + np.float32(self._lamps.mains(begin, end)), number)

    def backlight(self, number: int) -> float:
        """Light of the LCD at a frame, over that at first."""
        at = round(1e9 * number / self._rate_hz)
        return self._lamps.backlight(at, at)


def untouched(frames: int, distinct: int) -> Untouched:
    """Show untouched frames, then a touch."""
    shown = rendered(distinct)
    rig, optics = shown.rig, Optics(shown.rig)
    grid = Rest.of(rig, optics).grid
    sensor = ResidualSensor.from_rig(rig, grid, Target.from_spec(rig.target).light)
    finder, moments = ContactFinder(rig, optics, grid), Moments(rig, seed(SEED))
    draw = generator(SEED)
    false = 0
    with progress(frames // 1000, "thousand untouched frames") as advance:
        for number in range(frames):
            image = moments.image(shown.nulled[int(draw.integers(len(shown.nulled)))], number)
            residual = sensor.measure(image)
            false += bool(finder.follow(image, residual, shown.surface, nulled=True))
            if number % 1000 == 999:
                advance()
    named = False
    for k, light in enumerate(shown.touching):
        image = moments.image(light, frames + k)
        named |= bool(finder.follow(image, sensor.measure(image), shown.surface, nulled=False))
    return Untouched(frames, len(shown.nulled), false, moments.backlight(frames), named)


def report(touched: Sequence[Touched], still: Untouched | None) -> Report:
    """Figures with their bars."""
    figures: list[Figure] = []
    details: list[Sequence[str]] = [
        ("object", "touches", "named in frame 1", "2", "3", "4", "later", "never")
    ]
    if touched:
        after = [one.named_after for one in touched]
        good = sum(one is not None and one <= NAMED_FRAMES for one in after)
        name = f"touches named within {NAMED_FRAMES} frames"
        figures.append(figure(name, *rate(good, len(after)), unit="%", least=0.99))
        for shape in sorted({one.object for one in touched}):
            own = [one.named_after for one in touched if one.object == shape]
            counts = [sum(one == k for one in own) for k in range(NAMED_FRAMES + 1)]
            late = sum(one is not None and one > NAMED_FRAMES for one in own)
            details.append((shape, str(len(own)), *map(str, counts), str(late), str(own.count(None))))
    if still is not None:
        figures += [
            figure(f"of {still.frames} untouched frames: named as touched", still.false, most=0),
            Figure("a touch after them is named", "yes" if still.touch else "no", "yes", still.touch),
        ]
    data = {"touched": [asdict(one) for one in touched], "untouched": still and asdict(still)}
    return Report("Touches", figures, details, data)


@benchmark(
    "touches",
    __doc__,
    click.option("--touches", default=500, help="Random touches."),
    click.option("--frames", default=100_000, help="Untouched frames."),
    salt_option,
)
def command(*, quick: bool, touches: int, frames: int) -> Report:
    """Run both."""
    if quick:
        touches, frames = min(touches, OBJECTS * PLACES), min(frames, 2000)
    draw = generator(SEED)
    found: list[Touched] = []
    with progress(touches, "touches") as advance:
        while len(found) < touches:
            new = touches_of(draw)[: touches - len(found)]
            found += new
            for _ in new:
                advance()
    still = untouched(frames, DISTINCT // 4 if quick else DISTINCT) if frames else None
    return report(found, still)


if __name__ == "__main__":
    start(command)
