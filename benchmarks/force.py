"""Force: what presses, read from the mirror around it, against what truly presses.

On the packaged bench at full size, with a pupil of 1.25 mm. Random presses: one to three balls, cones, flat
punches that do not touch each other, with 10 to 300 mN each; compared are the last frames of half a second.
Two balls 2.5 mm apart; balls of 5 mm that stick (50 mJ/m^2) under 5 to 50 mN, whose work of adhesion follows
from force and outline.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.parts import Parts, part_options
from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.contact.adhesion import work_of_adhesion
from zeromethod.rig.load import load_rig
from zeromethod.session.session import Session

PUPIL_MM = 1.25
RANDOM, QUICK = 30, 4
SECONDS, COMPARED = 0.75, 12
APART_MM = 9.0
STICKING_N = (0.005, 0.02, 0.05)
ADHESION_J_M2, BALL_MM = 0.05, 5.0
PERCENT, LEAST_N = 1.0, 0.002


@dataclass(frozen=True)
class Found:
    """One object: its true force, N, the mean of what is read in the last frames, and its scatter.

    sigma_n: stated for one frame. sigmas: error of a frame over it, rms. adhesion_j_m2: of one that sticks.
    """

    case: str
    shape: str
    true_n: float
    force_n: float | None
    scatter_n: float
    sigma_n: float
    sigmas: float
    adhesion_j_m2: float | None = None


def cases(count: int) -> dict[str, list[dict[str, Any]]]:
    """Objects of every run, by name."""
    found: dict[str, list[dict[str, Any]]] = {}
    for number in range(count):
        draw = np.random.default_rng(1900 + number)
        placed: list[tuple[float, float]] = []
        while len(placed) < 1 + number % 3:
            x, y = float(draw.uniform(30, 55)), float(draw.uniform(-12, 12))
            if all(np.hypot(x - a, y - b) > APART_MM for a, b in placed):
                placed.append((x, y))
        found[f"random {number}"] = [_object(draw, x, y) for x, y in placed]
    ball = {"shape": "ball", "radius_mm": 20.0, "y_mm": 0.0}
    found["side by side"] = [{**ball, "x_mm": 40.0, "force_n": 0.03}, {**ball, "x_mm": 42.5, "force_n": 0.05}]
    for force in STICKING_N:
        sticks = {"radius_mm": BALL_MM, "adhesion_j_m2": ADHESION_J_M2, "x_mm": 42.0}
        found[f"sticks {1e3 * force:g} mN"] = [{**ball, **sticks, "force_n": force}]
    return found


def _object(draw: np.random.Generator, x_mm: float, y_mm: float) -> dict[str, Any]:
    """A ball, cone or punch at a place, whose slopes stay below the fold."""
    shape = ("ball", "cone", "punch")[draw.integers(3)]
    at = {"shape": shape, "x_mm": x_mm, "y_mm": y_mm}
    if shape == "cone":
        return {**at, "flank_deg": float(draw.uniform(4, 9)), "force_n": float(draw.uniform(0.03, 0.15))}
    if shape == "punch":
        return {**at, "radius_mm": float(draw.uniform(0.8, 1.5)), "force_n": float(draw.uniform(0.01, 0.05))}
    return {**at, "radius_mm": float(draw.uniform(5, 40)), "force_n": float(draw.uniform(0.01, 0.1))}


def scenario(objects: Sequence[dict[str, Any]]) -> str:
    """A press file: the objects come down within 50 ms and are held."""
    lines = [f"duration_s = {SECONDS}"]
    for one in objects:
        lines.append('[[object]]\nalbedo = "grey"')
        place = f"x_mm = {one['x_mm']}, y_mm = {one['y_mm']}"
        given = {key: value for key, value in one.items() if key not in {"x_mm", "y_mm", "force_n"}}
        lines += [
            f'{key} = "{value}"' if key == "shape" else f"{key} = {value}" for key, value in given.items()
        ]
        points = [(0.3, 0.0), (0.35, one["force_n"]), (SECONDS, one["force_n"])]
        path = [f"{{ time_s = {time_s}, {place}, force_n = {force} }}" for time_s, force in points]
        lines.append(f"path = [{', '.join(path)}]")
    lines += ['[[phase]]\nname = "untouched"\nfrom_s = 0.0\nto_s = 0.3']
    return "\n".join([*lines, f'[[phase]]\nname = "hold"\nfrom_s = 0.4\nto_s = {SECONDS}\n'])


def measured(case: str, objects: Sequence[dict[str, Any]]) -> list[Found]:
    """Run one case; each object's force by the contact nearest to it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "press.toml"
        file.write_text(scenario(objects))
        rig = load_rig("simulated").replace({"camera.pupil_mm": PUPIL_MM}, scenario=str(file))
        with Session(rig) as session:
            steps = [step for step in session.run(seconds=SECONDS) if step.surface is not None][-COMPARED:]
    modulus = rig.rubber.youngs_modulus_mpa or 1.0
    found = []
    for one in objects:
        rows = []
        for step in steps:
            near = [(np.hypot(c.x_mm - one["x_mm"], c.y_mm - one["y_mm"]), c) for c in step.touching]
            near = [pair for pair in near if pair[0] < 1.0 and np.isfinite(pair[1].force_n)]
            if near:
                contact = min(near, key=lambda pair: pair[0])[1]
                work = work_of_adhesion(contact, BALL_MM, modulus / (1 - rig.rubber.poisson**2))[0]
                rows.append((contact.force_n, contact.sigma_force_n, work))
        force, sigma, work = np.mean(rows, axis=0) if rows else (np.nan,) * 3
        scatter = float(np.std([row[0] for row in rows], ddof=1)) if len(rows) > 1 else np.nan
        sticks = float(work) if "adhesion_j_m2" in one else None
        read = float(force) if len(rows) == len(steps) else None
        z = [(row[0] - one["force_n"]) / row[1] for row in rows] or [np.nan]
        sigmas = float(np.sqrt(np.mean(np.square(z))))
        found.append(Found(case, one["shape"], one["force_n"], read, scatter, float(sigma), sigmas, sticks))
    return found


def _off(one: Found) -> float:
    """Error over the larger of a hundredth and 2 mN."""
    if one.force_n is None:
        return np.inf
    return abs(one.force_n - one.true_n) / max(0.01 * PERCENT * one.true_n, LEAST_N)


def report(found: Sequence[Found]) -> Report:
    """Figures with their bars."""
    random = [one for one in found if one.case.startswith("random")]
    known = [one for one in random if one.force_n is not None]
    figures = [
        Figure("random objects read", f"{len(known)} of {len(random)}", "all", len(known) == len(random))
    ]
    if known:
        worst = max(_off(one) for one in known)
        percent = 100 * np.array([(one.force_n or 0) / one.true_n - 1 for one in known])
        noise = 1e6 * float(np.median([one.scatter_n for one in known]))
        z = float(np.sqrt(np.mean([one.sigmas**2 for one in known])))
        figures += [
            Figure("worst, over 1 % or 2 mN", f"{worst:.2f}", "1", worst <= 1),
            Figure(
                "error, rms (worst)", f"{np.sqrt(np.mean(percent**2)):.2f} ({np.abs(percent).max():.2f}) %"
            ),
            Figure("noise of a frame, median", f"{noise:.0f} uN", "150 uN", noise <= 150),
            Figure("error of a frame over its sigma, rms", f"{z:.2f}", "0.8 to 1.25", 0.8 <= z <= 1.25),
        ]
    for name, percent_bar in (("side by side", 2.0), ("sticks", 1.0)):
        own = [one for one in found if one.case.startswith(name)]
        if own:
            off = max(100 * abs((one.force_n or np.inf) / one.true_n - 1) for one in own)
            figures.append(Figure(f"{name}, worst", f"{off:.2f} %", f"{percent_bar:g} %", off <= percent_bar))
    works = [one.adhesion_j_m2 for one in found if one.adhesion_j_m2 is not None]
    if works:
        off = max(100 * abs(work / ADHESION_J_M2 - 1) for work in works)
        figures.append(Figure("work of adhesion, worst", f"{off:.0f} %", "15 %", off <= 15))
    rows = [("case", "shape", "true, N", "read, N", "error", "scatter, uN", "sigma, uN", "adhesion, J/m2")]
    for one in found:
        error = "" if one.force_n is None else f"{100 * (one.force_n / one.true_n - 1):+.2f} %"
        read = "not read" if one.force_n is None else f"{one.force_n:.5f}"
        work = "" if one.adhesion_j_m2 is None else f"{one.adhesion_j_m2:.4f}"
        apart = f"{1e6 * one.scatter_n:.0f}", f"{1e6 * one.sigma_n:.0f}"
        rows.append((one.case, one.shape, f"{one.true_n:.5f}", read, error, *apart, work))
    data = {"objects": [asdict(one) for one in found]}
    return Report("Force of random presses", figures, rows, data)


@benchmark(
    "force",
    __doc__,
    click.option("--presses", default=RANDOM, show_default=True, help="Random presses."),
    part_options,
)
def command(quick: bool, presses: int, keep: Path | None, most_runs: int | None) -> Report:
    """Run what is missing, and report all."""
    count = QUICK if quick else presses
    wanted = list(cases(count).items())
    parts = Parts(keep, most_runs, presses=count)
    runs = parts.run(
        len(wanted), "presses", lambda number: [asdict(one) for one in measured(*wanted[number])]
    )
    return report([Found(**one) for run in runs for one in run])


if __name__ == "__main__":
    start(command)
