"""What comes is seen before it touches: time to contact, place, size, arming, false arming, the first frame.

Balls, flat plates and rods, 2 to 30 mm across, come down on the mirror of the packaged rig `contactless` at
10 to 300 mm/s, up to 30 degrees from straight down, and are seen by the simulated watch camera. Then shadows
and changes of light pass over the empty room (`--minutes` of them, an hour for the bar). Then balls come
slowly and touch while the loop runs, camera and LCD binned by 4; at last the watch camera fails meanwhile.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import changed, coarser
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import estimate
from zeromethod.approach import FAULTY, Approach, Watching, WatchReader
from zeromethod.arrays import Float
from zeromethod.cli.numbers import Real, Whole
from zeromethod.clock import SimulatedClock
from zeromethod.loop.state import State
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.simulation.contact.objects import Form, Solid
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.path import PathPoint, place_at
from zeromethod.simulation.watch_camera import SimulatedWatchCamera

APPROACHES, QUICK = 500, 24
PER_TOUCH, QUICK_MINUTES = 25, 2
"""Approaches for each touch in the loop."""
MINUTE_FRAMES = 1800
LATENCY_S = 0.02
"""From a frame's mid-exposure until its answer is there: read-out and computing."""
FROM_MM, FROM_S = 110.0, 2.5
"""An object comes from this height, or, a slow one, from what it takes in this time and 8 mm more."""
FIRST_S = 0.6
"""Before, the view is empty."""
SEED = 21
FAULTS = ("stall", "lost", "repeat", "dark")


def drawn(number: int) -> tuple[ObjectPath, float, float]:
    """An approach: the object on its path, its speed, mm/s, and when it touches, s."""
    rng = generator(SEED, number)
    speed = float(10.0 * 30.0 ** rng.random())
    form = (Form.BALL, Form.PUNCH, Form.EDGE)[int(rng.integers(3))]
    size = float(2.0 * 15.0 ** rng.random())
    tilt, azimuth = np.radians(30.0 * np.sqrt(rng.random())), 2 * np.pi * rng.random()
    place = np.array([rng.uniform(45.0, 85.0), rng.uniform(-12.0, 12.0)])
    solid = Solid(form, size / 2, albedo=float(rng.uniform(0.02, 0.9)))
    if form is Form.EDGE:
        length = min(size * float(rng.uniform(2.0, 4.0)), 36.0)
        solid = replace(solid, radius_mm=length / 4 if size > length / 2 else size / 2, length_mm=length)
        solid = replace(solid, angle_deg=float(rng.uniform(0.0, 180.0)))
    down = speed * np.cos(tilt)
    height = min(FROM_MM, FROM_S * down + 8.0)
    touch_s = FIRST_S + height / down
    off = height * np.tan(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
    points = (
        PathPoint(0, 1e4, 0.0, -height),
        PathPoint(round(1e9 * FIRST_S), 1e4, 0.0, -height),
        PathPoint(round(1e9 * FIRST_S), float(place[0] + off[0]), float(place[1] + off[1]), -height),
        PathPoint(round(1e9 * touch_s), float(place[0]), float(place[1]), 0.0),
    )
    return ObjectPath(solid, points), speed, touch_s


def approach(rig: Rig, number: int) -> dict[str, Any]:
    """Outcome of one approach; errors and their sigmas, None where nothing was said."""
    path, speed, touch_s = drawn(number)
    camera, reader = SimulatedWatchCamera(rig, SimulatedClock()), WatchReader(rig)
    camera.scenario = replace(camera.scenario, objects=(path,))
    assert rig.watch is not None
    seen: list[tuple[float, Approach]] = []
    for frame in range(int(touch_s * rig.watch.rate_hz) + 1):
        time_s = frame / rig.watch.rate_hz
        time_ns = round(1e9 * time_s)
        seen.append((time_s, reader.take(camera.image(time_ns, frame), time_ns)))
    armed = [time_s for time_s, one in seen if one.armed and time_s + LATENCY_S < touch_s]
    found: dict[str, Any] = {
        "form": str(path.solid.form), "diameter_mm": 2 * path.solid.radius_mm, "speed_mm_s": speed,
        "albedo": path.solid.albedo, "armed_before_s": touch_s - armed[0] if armed else None,
        "still_armed": seen[-1][1].armed,
    }  # fmt: skip
    x_mm, y_mm, _ = path.points[-1].place
    at_time = [one for time_s, one in seen if time_s + LATENCY_S <= touch_s - 0.1]
    at_height = [one for time_s, one in seen if -place_at(path.points, one.time_ns)[2] >= 10.0]
    found |= _errors("contact", at_time, "contact_s", lambda one: touch_s - 1e-9 * one.time_ns)
    found |= _errors("x", at_height, "x_mm", lambda _: x_mm) | _errors("y", at_height, "y_mm", lambda _: y_mm)
    known = [one for _, one in seen if np.isfinite(one.diameter_mm)]
    return found | _errors("diameter", known, "diameter_mm", lambda _: 2 * path.solid.radius_mm)


def _errors(name: str, seen: list[Approach], figure: str, truth: Any) -> dict[str, float | None]:
    """Error, sigma and truth of the newest approach's figure."""
    newest = seen[-1] if seen else None
    if newest is None or not np.isfinite(getattr(newest, figure)):
        return dict.fromkeys((f"{name}_error", f"{name}_sigma", f"{name}_true"))
    true = float(truth(newest))
    error = float(getattr(newest, figure)) - true
    return {f"{name}_error": error, f"{name}_sigma": getattr(newest, f"sigma_{figure}"), f"{name}_true": true}


def shadows(rig: Rig, minute: int) -> dict[str, Any]:
    """How often, in one minute of shadows and light, the loop is armed though nothing comes."""
    nuisances = {"room_light": 0.2, "room_shadows": 3}
    restless = changed(rig, simulation={"seed": seed(SEED + minute), "nuisances": nuisances})
    camera, reader = SimulatedWatchCamera(restless, SimulatedClock()), WatchReader(rig)
    camera.scenario = replace(camera.scenario, objects=())
    armings, seen, before = 0, 0, False
    for frame in range(MINUTE_FRAMES):
        time_ns = round(1e9 * frame / 30.0)
        one = reader.take(camera.image(time_ns, frame), time_ns)
        armings += one.armed and not before
        seen += one.watching is not Watching.CLEAR
        before = one.armed
    return {"armings": armings, "frames": MINUTE_FRAMES, "not_clear": seen}


def touch(rig: Rig, number: int) -> dict[str, Any]:
    """The first frame after a slow ball's touch: whether it was measured; its peak's error in sigmas."""
    rng = generator(SEED, 1, number)
    least, most = [10.0, 55.0, -6.0, 8.0, 1.3], [40.0, 75.0, 6.0, 15.0, 1.3 + 1 / 60]
    speed, x_mm, y_mm, radius_mm, touch_s = rng.uniform(least, most).tolist()
    height = speed * (touch_s - 0.3)
    points = ((0.0, -300.0), (0.29, -300.0), (0.3, -height), (touch_s, 0.0), (touch_s + 0.05 / speed, 0.05))
    path = ",".join(f"{{time_s={t!r},x_mm={x_mm!r},y_mm={y_mm!r},depth_mm={d!r}}}" for t, d in points)
    text = f'duration_s={touch_s + 0.2}\n[[object]]\nshape="ball"\nradius_mm={radius_mm!r}\npath=[{path}]\n'
    text += f'[[phase]]\nname="hold"\nfrom_s={touch_s}\nto_s={touch_s + 0.2}\n'
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "touch.toml"
        file.write_text(text)
        with Session(rig.model_copy(update={"scenario": str(file)})) as session:
            first, armed = None, False
            for step in session.run():
                begins_ns = step.time_ns - step.exposure_ns // 2
                armed |= step.state is State.APPROACH
                if first is None and step.frame_number is not None and begins_ns >= 1e9 * touch_s:
                    first = step
    assert first is not None
    truth, pull = first.truth, None
    if truth is not None and first.peak is not None:
        pull = truth.depth_peak_error_percent / truth.depth_peak_error_sigma_percent
    return {
        "armed": armed, "valid": first.measured is not None and first.peak is not None,
        "valid_share": first.valid_share, "state": str(first.state), "pull": pull,
    }  # fmt: skip


def fault(rig: Rig, kind: str) -> dict[str, Any]:
    """A fault of the watch camera while a ball presses: whether it is named, and what it does to readings."""
    text = (
        'duration_s=0.7\n[[object]]\nshape="ball"\nradius_mm=12.0\npath=[{time_s=0.0,x_mm=62.0,y_mm=0.0,'
        "depth_mm=-9.0},{time_s=0.3,x_mm=62.0,y_mm=0.0,depth_mm=0.0},"
        "{time_s=0.301,x_mm=62.0,y_mm=0.0,depth_mm=0.05}]\n"
    )
    faults = {"simulation.faults.watch": kind, "simulation.faults.watch_s": [0.1, 9.0]}
    peaks, named = [], False
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "press.toml"
        file.write_text(text)
        pressed = rig.model_copy(update={"scenario": str(file)})
        for one in (pressed.replace(faults), pressed.model_copy(update={"watch": None})):
            with Session(one) as session:
                steps = list(session.run())
            peaks.append([step.depth_peak_mm for step in steps])
            named |= any(one.approach is not None and one.approach.watching in FAULTY for one in steps)
    changed = int(np.sum(~np.isclose(np.array(peaks[0]), np.array(peaks[1]), rtol=0, atol=0, equal_nan=True)))
    return {"fault": kind, "named": named, "changed": changed}


def figures_of(runs: list[dict[str, Any]]) -> list[Figure]:
    """Figures of the approaches."""
    unarmed = sum(run["armed_before_s"] is None for run in runs)

    def among(name: str) -> tuple[Float, Float, Float]:
        known = [run for run in runs if run[f"{name}_error"] is not None]
        keys = (f"{name}_error", f"{name}_sigma", f"{name}_true")
        error, sigma, true = (np.array([run[key] for run in known]) for key in keys)
        return error, sigma, true

    contact, contact_sigma, contact_true = among("contact")
    x, x_sigma, _ = among("x")
    y, y_sigma, _ = among("y")
    size, size_sigma, size_true = among("diameter")
    off, percent, of_size = (
        np.hypot(x, y),
        100 * np.abs(contact / contact_true),
        100 * np.abs(size / size_true),
    )
    pulls = np.concatenate([contact / contact_sigma, x / x_sigma, y / y_sigma, size / size_sigma])
    late = estimate(lambda off: np.percentile(off, 95), 0.01 * percent)
    beyond = 100 * float(np.mean(np.abs(pulls) > 3))
    return [
        figure(f"of {len(runs)} approaches: not armed before the touch", unarmed, most=0),
        figure("error of time to contact 0.1 s before, 95 % within", *late, unit="%", most=0.15),
        figure("approaches whose time to contact is known", percent.size, least=0.98, of_other=True),
        _shares("place, at 10 mm of height", off, 2.0, "mm", len(runs)),
        _shares("diameter, at the touch", of_size, 5.0, "%", len(runs)),
        Figure("errors beyond three of their sigmas", f"{beyond:.1f} %", "at most 1 %", beyond <= 1.0),
    ]


def _shares(name: str, errors: Float, bar: float, unit: str, runs: int) -> Figure:
    """Median and 95th percentile, which has the bar, and how many are known."""
    if not errors.size:
        return Figure(name, "not known", f"within {bar:g} {unit}", False)
    p95 = float(np.percentile(errors, 95))
    words = f"median {np.median(errors):.2f} {unit}, 95 % within {p95:.2f} {unit}; {errors.size} of {runs}"
    return Figure(name, words, f"95 % within {bar:g} {unit}", p95 <= bar)


def measure(approaches: int, minutes: int, touches: int, parts: Parts) -> Report:
    """Approaches, minutes of shadows and touches."""
    rig = load_rig("contactless")
    small = coarser(rig, 4)

    def one(number: int) -> dict[str, Any]:
        if number < approaches:
            return approach(rig, number)
        if number < approaches + minutes:
            return shadows(rig, number - approaches)
        if number < approaches + minutes + touches:
            return touch(small, number - approaches - minutes)
        return fault(small, FAULTS[number - approaches - minutes - touches])

    total = approaches + minutes + touches + len(FAULTS)
    found = parts.run(total, "approaches", one)
    runs = [each for each in found if "form" in each]
    quiet = [each for each in found if "armings" in each]
    touched = [each for each in found if "valid" in each]
    figures = figures_of(runs) if runs else []
    if quiet:
        armings = sum(each["armings"] for each in quiet)
        figures.append(figure(f"armed by shadows and light, {len(quiet)} min", armings, most=1))
    if touched:
        valid = sum(each["valid"] and each["armed"] for each in touched)
        words = f"{valid} of {len(touched)}"
        near = sum(each["pull"] is not None and abs(each["pull"]) < 3 for each in touched)
        figures += [
            Figure("first frame after a touch measured", words, "95 %", valid >= 0.95 * len(touched)),
            Figure("its peak, not yet called good, within 3 sigma", f"{near} of {len(touched)}", "", None),
        ]
    if failed := [each for each in found if "fault" in each]:
        named, changed = sum(each["named"] for each in failed), sum(each["changed"] for each in failed)
        words = f"{named} of {len(failed)}"
        figures += [
            Figure("faults of the watch camera named", words, "all", named == len(failed)),
            Figure("readings changed by them", str(changed), "0", changed == 0),
        ]
    return Report("Contactless sensing", figures, [], {"runs": found})


@benchmark(
    "contactless",
    __doc__,
    part_options,
    salt_option,
    click.option("--approaches", type=Whole(min=1), default=APPROACHES, show_default=True, help="How many."),
    click.option("--minutes", type=Real(min=0), default=60, show_default=True, help="Shadows and light."),
)
def command(quick: bool, approaches: int, minutes: float, keep: Path | None, most_runs: int | None) -> Report:
    count = QUICK if quick else approaches
    minutes = round(min(minutes, QUICK_MINUTES) if quick else minutes)
    parts = Parts(keep, most_runs, approaches=count, minutes=minutes)
    return measure(count, minutes, -(-count // PER_TOUCH), parts)


if __name__ == "__main__":
    start(command)
