"""Rubbing: pitch, speed, share in contact, stick and slip against the planted ones; ten fabrics told apart.

Textures on the packaged bench, exposed for 1 ms, read through the loop as `zeromethod run --rubbing` does;
the camera's pixels are the packaged ones, as many of them as the patch needs. "cases": brushes and woven
cloth of 0.3 to 3 mm pitch, pile and sandpaper are pressed, held, and slide at 5 to 50 mm/s. Where a frame
goes over half a pitch most frames that slip must be called aliased, and elsewhere few; elsewhere speed, and
everywhere pitch, medians of the frames, are compared. The share in contact is compared, frame by frame,
with the true one of the area that was looked at; all three are held against their sigma in every frame.

"fabrics": woven cloth of ten kinds in a row, each unlike the one before by 14 % in its pitch or 15 % in the
round of its tips. Of each, pieces cut anew (seeds: places and heights of the tips) take each other's place
under the same force, 21 in a series, two frames each. The first five of a kind are learned: the mean of
the printed statistics, and their scatter about it over all kinds, by which differences are divided. All
others are then given to the nearest mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.salt import salt_option, seed
from benchmarks.totals import rate
from zeromethod.arrays import Float
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.rubbing import ContactStatus, Motion
from zeromethod.session.session import Session
from zeromethod.simulation.contact.touch import Touch
from zeromethod.simulation.scenario import scenario_of

CASES = (
    ("woven", 0.3, 0.3, 5.0), ("woven", 0.3, 0.3, 8.0), ("woven", 0.3, 0.3, 20.0), ("woven", 0.3, 0.3, 50.0),
    ("woven", 0.5, 0.6, 12.0), ("woven", 0.5, 0.6, 20.0), ("woven", 0.9, 0.9, 5.0), ("woven", 0.9, 0.9, 20.0),
    ("brush", 0.7, 0.8, 15.0), ("brush", 1.5, 1.2, 40.0), ("brush", 1.5, 1.2, 50.0),
    ("brush", 3.0, 2.5, 10.0), ("brush", 3.0, 2.5, 50.0),
    ("pile", 0.5, 1.0, 5.0), ("pile", 0.5, 1.0, 50.0),
    ("sandpaper", 0.4, 0.5, 20.0), ("sandpaper", 0.4, 0.5, 50.0),
)  # fmt: skip
"""Weave, pitch and round of the tips, mm, mm/s."""
REGULAR = ("woven", "brush")
QUICK = (0, 2, 9, 15)
FABRICS = (
    (0.50, 0.80), (0.57, 0.80), (0.57, 0.92), (0.65, 0.92), (0.65, 1.05),
    (0.74, 1.05), (0.74, 1.20), (0.84, 1.20), (0.84, 1.38), (0.95, 1.38),
)  # fmt: skip
"""Pitch and round of the tips of woven cloth, mm."""
LEARNED, UNSEEN = 5, 100
STATISTICS = ("share", "spots_per_cm2", "spot_mm2", "pitch_mm")
HEIGHT_MM, PRESSURE_MPA = 0.001, 0.018
TOUCH_S, HELD_S, SLIP_S, STICK_S, END_S = 0.26, 0.3, 0.44, 0.6, 0.7
FIRST_S, PIECE_S, SERIES = 0.22, 2 / 60, 21
"""Until the first of a series is lit and read, how long each other one lies there, and pieces of it."""
WITHIN, SIGMAS, BEYOND = 3, 3.0, 0.01
NAMED_FRAMES = 3


def rubbed(
    folder: Path, weave: str, pitch_mm: float, tip_mm: float, speed_mm_s: float, number: int
) -> tuple[list[Any], Any]:
    """(time s of the scenario, status, true share of what was looked at) of frames with a status; the rig."""
    large = pitch_mm > 2
    x_mm = 42.0 - 0.5 * speed_mm_s * (STICK_S - SLIP_S)
    force = _force_n(large=large)
    path = [(TOUCH_S, x_mm, 0.0), (HELD_S, x_mm, force), (SLIP_S, x_mm, force)]
    path.append((STICK_S, x_mm + speed_mm_s * (STICK_S - SLIP_S), force))
    rig = _rig(folder, _object(weave, pitch_mm, tip_mm, number, path), number)
    if not large:
        rig = _of_pixels(rig, 480, 352)
    found = []
    scenario = scenario_of(rig)
    with Session(rig) as session:
        for step in session.run(seconds=END_S):
            if step.contact_status is not None:
                touches = scenario.mirror_at(step.time_ns).touches
                found.append((1e-9 * step.time_ns, step.contact_status, _true_share(session, touches)))
    return found, rig


def rub_rig(folder: Path, speed_mm_s: float, from_s: float, to_s: float, end_s: float) -> Rig:
    """Rig under woven cloth that slides from one time to another and is pressed until the end."""
    x_mm, force = 36.0, _force_n(large=False)
    path = [(TOUCH_S, x_mm, 0.0), (TOUCH_S + 0.02, x_mm, force), (from_s, x_mm, force)]
    path += [(to_s, x_mm + speed_mm_s * (to_s - from_s), force)]
    path += [(end_s, path[-1][1], force)] if end_s > to_s else []
    return _of_pixels(_rig(folder, _object("woven", 0.9, 0.9, 0, path), 0), 640, 352)


def _radius_mm(*, large: bool) -> float:
    return 7.0 if large else 3.0


def _force_n(*, large: bool) -> float:
    return float(PRESSURE_MPA * np.pi * _radius_mm(large=large) ** 2)


def _object(
    weave: str, pitch_mm: float, tip_mm: float, number: int, path: Sequence[tuple[float, float, float]]
) -> str:
    """Of a press file; path: time s, x mm, force N."""
    points = ", ".join(f"{{time_s = {t}, x_mm = {x}, y_mm = 0.0, force_n = {f}}}" for t, x, f in path)
    return (
        f'[[object]]\nshape = "texture"\nweave = "{weave}"\nradius_mm = {_radius_mm(large=pitch_mm > 2)}\n'
        f"pitch_mm = {pitch_mm}\ntip_mm = {tip_mm}\nheight_mm = {HEIGHT_MM}\nseed = {seed(number)}\n"
        f'albedo = "grey"\npath = [{points}]\n'
    )


def _rig(folder: Path, objects: str, number: int) -> Rig:
    press = folder / "press.toml"
    press.write_text(objects)
    changed = {"camera.exposure_s": 0.001, "control.rubbing": True, "simulation.seed": seed(number)}
    return load_rig("simulated").replace(changed, scenario=str(press))


def _of_pixels(rig: Rig, columns: int, rows: int) -> Rig:
    middle = [(columns - 1) / 2, (rows - 1) / 2]
    return rig.replace({"camera.columns": columns, "camera.rows": rows, "camera.centre_px": middle})


def _true_share(session: Session, touches: Sequence[Touch]) -> float | None:
    reader = session._rubbing
    spots = None if reader is None else reader.spots
    if spots is None or not touches:
        return None
    row, col = (at[:, None, None] for at in np.nonzero(spots.looked))
    # several points of each pixel: pixels alone meet spots of a pitch of 15 of them always alike
    within = (np.arange(WITHIN) + 0.5) / WITHIN - 0.5
    x: Float = spots.x_mm + spots.pitch_mm * (col + within)
    y: Float = spots.y_mm + spots.pitch_mm * (row + within[:, None])
    return float(np.mean(touches[0].covers(*np.broadcast_arrays(x, y))))


def rub_case(folder: Path, number: int) -> dict[str, Any]:
    """One case: what was read, beside what is true."""
    weave, pitch, tip, speed = CASES[number]
    found, rig = rubbed(folder, weave, pitch, tip, speed, number)
    slips = [one for at, one, _ in found if SLIP_S + 0.04 < at < STICK_S and one.motion is Motion.SLIP]
    shares = [(one.share, true, one.sigma_share) for _, one, true in found if true is not None]
    known = np.array([each for each in shares if np.isfinite(each[0])])
    named = [(at, one.event) for at, one, _ in found if one.event]
    pulls = [abs(share - true) / sigma for share, true, sigma in shares]
    pulls += [abs(one.pitch_mm - pitch) / one.sigma_pitch_mm for _, one, _ in found if weave in REGULAR]
    pulls += [abs(one.speed_mm_s - speed) / one.sigma_speed_mm_s for one in slips if not one.aliased]
    pulls = [float(one) for one in pulls if np.isfinite(one)]
    frames = [_frames_after(named, "slip", SLIP_S, rig.camera.rate_hz)]
    frames.append(_frames_after(named, "stick", STICK_S, rig.camera.rate_hz))
    return {
        "pitch_mm": _median([one for _, one, _ in found], "pitch_mm"),
        "speed_mm_s": float(np.median([one.speed_mm_s for one in slips])) if slips else None,
        "aliased": float(np.mean([one.aliased for one in slips])) if slips else None,
        "share_off": float(np.abs(known[:, 0] - known[:, 1]).max()) if known.size else None,
        "share_sigmas": float(np.median(np.abs(known[:, 0] - known[:, 1]) / known[:, 2]))
        if known.size
        else None,
        "named": frames,
        "events": len(named),
        "values": len(pulls),
        "beyond": sum(one > SIGMAS for one in pulls),
    }


def _frames_after(
    named: Sequence[tuple[float, str]], what: str, began_s: float, rate_hz: float
) -> int | None:
    """Frames from that which began after it until it is named, both counted; None where it never is."""
    times = [at for at, event in named if event == what and at > began_s]
    return int(np.floor((times[0] - began_s) * rate_hz)) + 1 if times else None


def _median(found: Sequence[ContactStatus], name: str) -> float | None:
    values = [getattr(one, name) for one in found if np.isfinite(getattr(one, name))]
    return float(np.median(values)) if values else None


def pieces(folder: Path, number: int) -> list[dict[str, Any]]:
    """Printed statistics of a fabric's pieces that take each other's place: medians of each one's frames."""
    group, kind = divmod(number, len(FABRICS))
    seeds = [1000 + SERIES * group + k for k in range(SERIES)]
    begin = [TOUCH_S + FIRST_S + PIECE_S * k for k in range(SERIES + 1)]
    begin[0] = TOUCH_S
    objects = ""
    for piece, from_s, to_s in zip(seeds, begin, begin[1:], strict=False):
        path = [(from_s, 42.0, 0.0), (from_s, 42.0, _force_n(large=False))]
        path += [(to_s, 42.0, path[1][2]), (to_s, 42.0, 0.0)]
        objects += _object("woven", *FABRICS[kind], piece, path)
    rig = _of_pixels(_rig(folder, objects, seeds[0]), 352, 320)
    seen: list[list[ContactStatus]] = [[] for _ in seeds]
    with Session(rig) as session:
        for step in session.run(seconds=begin[-1]):
            at = int(np.searchsorted(begin, 1e-9 * step.time_ns)) - 1
            if 0 <= at < SERIES and step.contact_status is not None:
                seen[at].append(step.contact_status)
    return [{"kind": kind, **{name: _median(one, name) for name in STATISTICS}} for one in seen]


def told_apart(found: Sequence[Sequence[dict[str, Any]]]) -> tuple[int, int, list[str]]:
    """(unseen pieces given to their own kind, unseen pieces, which were not), of series in their order."""
    first = len(FABRICS)
    learned, of = _figures([one for series in found[:first] for one in series[:LEARNED]])
    unseen, true = _figures(
        [one for k, series in enumerate(found) for one in series[LEARNED if k < first else 0 :]]
    )
    means = np.stack([np.nanmean(learned[of == kind], axis=0) for kind in range(first)])
    scatter = np.sqrt(np.nanmean((learned - means[of]) ** 2, axis=0))
    away: Float = np.linalg.norm((unseen[:, None] - means) / scatter, axis=-1)
    nearest = np.argmin(np.where(np.isfinite(away), away, np.inf), axis=1)
    right = nearest == true
    wrong = [f"{k} as {n}" for k, n, ok in zip(true, nearest, right, strict=True) if not ok]
    return int(np.count_nonzero(right)), len(right), wrong


def _figures(pieces: Sequence[dict[str, Any]]) -> tuple[Float, np.ndarray]:
    """((n, statistics), NaN where not known; (n,) kinds)."""
    values = [[np.nan if one[name] is None else one[name] for name in STATISTICS] for one in pieces]
    return np.array(values, dtype=np.float64), np.array([one["kind"] for one in pieces])


def _fabric_report(found: Sequence[Sequence[dict[str, Any]]]) -> Report:
    title, kept = "Rubbing: fabrics", {"found": list(found)}
    if len(found) < len(FABRICS):
        return Report(title, [Figure("fabrics learned", f"{len(found)} of {len(FABRICS)}")], [], kept)
    right, count, wrong = told_apart(found)
    apart = figure("unseen pieces told apart", *rate(right, count), unit="%", least=0.98)
    return Report(title, [apart], [("wrong", *wrong)] if wrong else [], kept)


def _percent_off(value: float | None, true: float) -> float:
    """Infinite where nothing was found."""
    return float("inf") if value is None else 100 * (value / true - 1)


def _case_report(found: Sequence[dict[str, Any]], numbers: Sequence[int]) -> Report:
    details: list[Sequence[str]] = [
        ("texture", "pitch", "speed", "aliased", "share off", "named after", "events")
    ]
    pitches: list[float] = []
    speeds: list[float] = []
    shares: list[float] = []
    named: list[float] = []
    wrong_alias = 0
    for one, number in zip(found, numbers, strict=False):
        weave, pitch, _, speed = CASES[number]
        regular = weave in REGULAR
        aliased = regular and speed / 60 > 0.5 * pitch
        of_pitch, of_speed = _percent_off(one["pitch_mm"], pitch), _percent_off(one["speed_mm_s"], speed)
        pitches += [abs(of_pitch)] if regular else []
        speeds += [] if aliased else [abs(of_speed)]
        wrong_alias += one["aliased"] is None or round(one["aliased"]) != aliased
        shares.append(np.inf if one["share_off"] is None else one["share_off"])
        named += [np.inf if frames is None else frames for frames in one["named"]]
        called = "-" if one["aliased"] is None else f"{one['aliased']:.2f}"
        ends = f"{one['named'][0]}, {one['named'][1]}"
        words = f"{of_pitch:+.2f} %" if regular else "-", f"{of_speed:+.2f} %", f"{called} ({aliased:d})"
        texture = f"{weave} {pitch:g} mm, {speed:g} mm/s"
        details.append((texture, *words, f"{shares[-1]:.3f}", ends, f"{one['events']}"))
    worst = [max(each, default=np.inf) for each in (pitches, speeds, shares, named)]
    beyond = sum(one["beyond"] for one in found) / max(sum(one["values"] for one in found), 1)
    figures = [
        figure("error of pitch, worst", 0.01 * worst[0], unit="%", most=0.03),
        figure("error of speed where not aliased, worst", 0.01 * worst[1], unit="%", most=0.03),
        Figure("aliased or not, wrongly named", f"{wrong_alias} of {len(found)}", "0", wrong_alias == 0),
        figure("error of the share in contact, worst frame", worst[2], most=0.03),
        Figure(
            "frames until stick or slip is named",
            f"{worst[3]:g}",
            f"{NAMED_FRAMES}",
            worst[3] <= NAMED_FRAMES,
        ),
        Figure(
            "pitch, speed, share of frames beyond 3 sigma", f"{beyond:.2%}", f"{BEYOND:.0%}", beyond <= BEYOND
        ),
    ]
    return Report("Rubbing", figures, details, {"found": list(found)})


@benchmark(
    "rubbing",
    __doc__,
    part_options,
    click.option(
        "--part", type=click.Choice(["cases", "fabrics"]), default="cases", show_default=True, help="Which."
    ),
    salt_option,
)
def command(*, quick: bool, keep: Path | None, most_runs: int | None, part: str) -> Report:
    """Run one part."""
    parts = Parts(keep, most_runs, part=part, quick=quick)
    with parts.folder() as folder:
        if part == "cases":
            numbers = QUICK if quick else tuple(range(len(CASES)))
            found = parts.run(len(numbers), "textures", lambda k: rub_case(folder, numbers[k]))
            return _case_report(found, numbers)
        runs = len(FABRICS) * (1 if quick else (LEARNED + UNSEEN) // SERIES)
        return _fabric_report(parts.run(runs, "series", lambda k: pieces(folder, k)))


if __name__ == "__main__":
    start(command)
