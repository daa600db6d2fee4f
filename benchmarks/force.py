"""Force: what presses, read from the mirror around it, against what truly presses.

On the packaged bench at full size, with a pupil of 1.25 mm, each run with noise of its own. The modulus by a
weight of 20 g, and all forces as it makes them; two balls 2.5 mm apart; balls of 5 mm that stick (50 mJ/m^2)
under 5 to 50 mN, whose work of adhesion follows from force and outline, and one that pulls; 50 mg; a layer
20 mm thick that the rig file has as 22 +- 2 mm; friction of half the force. Random presses: one to three
balls, cones, flat punches that do not touch each other, with 10 to 150 mN each; and each ball's pressure.
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
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import estimate, rms
from zeromethod.contact import pressure_map
from zeromethod.contact.adhesion import work_of_adhesion
from zeromethod.devices.opening import open_devices
from zeromethod.loop.step import Step
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.session import Session
from zeromethod.session.weighing import for_weighing, weigh

PUPIL_MM = 1.25
RANDOM, QUICK = 30, 4
FIRST_S, COMPARED, MANY = 0.55, 12, 60
"""Frames are compared from then on: 60 where something sticks or hardly weighs anything, 12 else."""
APART_MM = 9.0
STICKING_N = (0.005, 0.02, 0.05)
ADHESION_J_M2, BALL_MM = 0.05, 5.0
PULL_N, PULLED_MM = -0.002, 20.0
"""A larger ball: one of 5 mm that is pulled so touches less than what is called a contact."""
WEIGHT_MG, FOOT_MM = 50.0, 0.5
GRAMS, TRUE_MPA = 20.0, 1.6
LAYER = {"rubber.support": "bonded", "rubber.thickness_mm": 20.0}
SAID = LAYER | {"rubber.thickness_mm": 22.0, "rubber.thickness_sigma_mm": 2.0}
SHARE, LEAST_N = 0.03, 0.005


@dataclass(frozen=True)
class Found:
    """One object: its true force, N, the mean of what is read in the last frames, and its scatter.

    sigma_n: stated for one frame. sigmas: error of a frame over it, rms. adhesion_j_m2: of one that sticks,
    and its stated sigma.
    largest, whole: a ball's greatest pressure, and the sum of its pressure, over the true ones.
    """

    case: str
    shape: str
    true_n: float
    force_n: float | None
    scatter_n: float
    sigma_n: float
    sigmas: float
    adhesion_j_m2: float | None = None
    adhesion_sigma: float | None = None
    largest: float | None = None
    whole: float | None = None


def once() -> dict[str, list[dict[str, Any]]]:
    """Objects of the runs that are there once, by name."""
    ball = {"shape": "ball", "radius_mm": 20.0, "x_mm": 42.0, "y_mm": 0.0}
    found: dict[str, list[dict[str, Any]]] = {"weighed": []}
    found["side by side"] = [{**ball, "x_mm": 40.0, "force_n": 0.03}, {**ball, "x_mm": 42.5, "force_n": 0.05}]
    for force, radius_mm in ((PULL_N, PULLED_MM), *((force, BALL_MM) for force in STICKING_N)):
        sticks = {"radius_mm": radius_mm, "adhesion_j_m2": ADHESION_J_M2, "force_n": force}
        found[f"{'sticks' if force > 0 else 'pulls'} {1e3 * force:g} mN"] = [ball | sticks]
    foot = {"shape": "punch", "radius_mm": FOOT_MM, "force_n": 9.81e-6 * WEIGHT_MG}
    found["50 mg"] = [ball | foot]
    found["thickness"] = [ball | {"force_n": 0.1}]
    return found | {"friction": [ball | {"force_n": 0.1, "friction": 0.5}]}


def random(count: int) -> dict[str, list[dict[str, Any]]]:
    """Objects of random runs, by name."""
    found = {}
    for number in range(count):
        draw = generator(1900 + number)
        placed: list[tuple[float, float]] = []
        while len(placed) < 1 + number % 3:
            x, y = float(draw.uniform(30, 55)), float(draw.uniform(-12, 12))
            if all(np.hypot(x - a, y - b) > APART_MM for a, b in placed):
                placed.append((x, y))
        found[f"random {number}"] = [_object(draw, x, y) for x, y in placed]
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


def scenario(objects: Sequence[dict[str, Any]], seconds: float) -> str:
    """A press file: the objects come down within 50 ms and are held."""
    lines = [f"duration_s = {seconds}"]
    for one in objects:
        lines.append('[[object]]\nalbedo = "grey"')
        place = f"x_mm = {one['x_mm']}, y_mm = {one['y_mm']}"
        given = {key: value for key, value in one.items() if key not in {"x_mm", "y_mm", "force_n"}}
        lines += [
            f'{key} = "{value}"' if key == "shape" else f"{key} = {value}" for key, value in given.items()
        ]
        points = [(0.3, 0.0), (0.35, one["force_n"]), (seconds, one["force_n"])]
        path = [f"{{ time_s = {time_s}, {place}, force_n = {force} }}" for time_s, force in points]
        lines.append(f"path = [{', '.join(path)}]")
    lines += ['[[phase]]\nname = "untouched"\nfrom_s = 0.0\nto_s = 0.3']
    return "\n".join([*lines, f'[[phase]]\nname = "hold"\nfrom_s = 0.4\nto_s = {seconds}\n'])


def weighed(number: int) -> Found:
    """The weight's case: what rubber of 1.6 MPa is found to be, as a force of so many N."""
    truth = {
        "camera.pupil_mm": PUPIL_MM,
        "simulation.seed": seed(number),
        "rubber.youngs_modulus_mpa": TRUE_MPA,
    }
    rig = load_rig("simulated").replace(truth, scenario="weight")
    with open_devices(rig) as devices, Session(for_weighing(rig), devices=devices) as session:
        found = weigh(session.run(seconds=2.5), GRAMS, 1e-3 * GRAMS, 2.0, lambda _words: None)
    sigmas = abs(found.youngs_modulus_mpa - TRUE_MPA) / found.sigma_mpa
    return Found("weighed", "weight", TRUE_MPA, found.youngs_modulus_mpa, 0.0, found.sigma_mpa, sigmas)


def measured(case: str, objects: Sequence[dict[str, Any]], number: int) -> list[Found]:
    """Run one case; each object's force by the contact nearest to it."""
    if not objects:
        return [weighed(number)]
    frames = COMPARED if case.startswith(("random", "side", "thick", "friction")) else MANY
    seconds = FIRST_S + frames / 60
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "press.toml"
        file.write_text(scenario(objects, seconds))
        bench = {"camera.pupil_mm": PUPIL_MM, "simulation.seed": seed(number)}
        layer, said = (LAYER, SAID) if case == "thickness" else ({}, {})
        true = load_rig("simulated").replace(bench | layer, scenario=str(file))
        rig = true.replace(said)
        with open_devices(true) as devices, Session(rig, devices=devices) as session:
            steps = [step for step in session.run(seconds=seconds) if step.surface is not None][-frames:]
    return [_found(case, one, steps, rig) for one in objects]


def _found(case: str, one: dict[str, Any], steps: Sequence[Step], rig: Rig) -> Found:
    """What the last steps say of one object."""
    modulus = (rig.rubber.youngs_modulus_mpa or 1.0) / (1 - rig.rubber.poisson**2)
    rows = []
    for step in steps:
        near = [(np.hypot(c.x_mm - one["x_mm"], c.y_mm - one["y_mm"]), c) for c in step.touching]
        near = [pair for pair in near if pair[0] < 1.0 and np.isfinite(pair[1].force_n)]
        if near:
            contact = min(near, key=lambda pair: pair[0])[1]
            found = work_of_adhesion(contact, one.get("radius_mm", BALL_MM), modulus)
            rows.append((contact.force_n, contact.sigma_force_n, *found))
    force, sigma, *work = np.mean(rows, axis=0) if rows else (np.nan,) * 4
    scatter = float(np.std([row[0] for row in rows], ddof=1)) if len(rows) > 1 else np.nan
    z = [(row[0] - one["force_n"]) / row[1] for row in rows] or [np.nan]
    sticks = "adhesion_j_m2" in one
    largest = whole = None
    if one["shape"] == "ball" and not sticks and len(rows) == len(steps):
        largest, whole = _pressure(one, steps[-1], rig, modulus)
    return Found(
        case, one["shape"], one["force_n"], float(force) if len(rows) == len(steps) else None,
        scatter, float(sigma), float(np.sqrt(np.mean(np.square(z)))),
        float(work[0]) if sticks else None, float(work[1]) if sticks else None, largest, whole,
    )  # fmt: skip


def _pressure(one: dict[str, Any], step: Step, rig: Rig, modulus: float) -> tuple[float, float]:
    """A ball's greatest pressure and the sum of its pressure in one frame, over Hertz's.

    Source: Johnson 1985, Contact Mechanics, 4.24, doi:10.1017/CBO9781139171731.
    """
    assert step.surface is not None
    apart = [np.hypot(c.x_mm - one["x_mm"], c.y_mm - one["y_mm"]) for c in step.contacts]
    found = pressure_map(rig, step.surface, step.contacts, int(np.argmin(apart)))
    hertz = (6 * one["force_n"] * modulus**2 / (np.pi**3 * one["radius_mm"] ** 2)) ** (1 / 3)
    return float(found.pressure_mpa.max()) / hertz, found.force_n / one["force_n"]


def _off(one: Found, modulus: float = 1.0) -> float:
    """Error over the larger of `SHARE` and `LEAST_N`; modulus: what is taken over the true one."""
    if one.force_n is None:
        return np.inf
    return abs(modulus * one.force_n - one.true_n) / max(SHARE * one.true_n, LEAST_N)


def report(found: Sequence[Found]) -> Report:
    """Figures with their bars."""
    random = [one for one in found if one.case.startswith("random")]
    known = [one for one in random if one.force_n is not None]
    modulus = next((one.force_n for one in found if one.case == "weighed" and one.force_n), None)
    figures = [figure(f"of {len(random)} random objects: not read", len(random) - len(known), most=0)]
    if known:
        worst = max(_off(one) for one in known)
        percent = 100 * np.array([(one.force_n or 0) / one.true_n - 1 for one in known])
        noise = 1e6 * float(np.median([one.scatter_n for one in known]))
        z = estimate(rms, [one.sigmas for one in known])
        figures += [
            figure("error of force, worst, over 3 % or 5 mN", worst, most=1.0),
            Figure("error, rms (worst)", f"{rms(percent):.2f} ({np.abs(percent).max():.2f}) %"),
            Figure("noise of a frame, median", f"{noise:.0f} uN", "150 uN", noise <= 150),
            figure("error of a frame over its sigma, rms", *z, least=0.7, most=1.5),
        ]
        if modulus is not None:
            worst = max(_off(one, modulus / TRUE_MPA) for one in known)
            figures.append(Figure("the same with the modulus by 20 g", f"{worst:.2f}", "1", worst <= 1))
    if modulus is not None:
        figures.append(Figure("modulus by 20 g", f"{100 * (modulus / TRUE_MPA - 1):+.2f} %"))
    figures += _single(found)
    rows = [("case", "shape", "true, N", "read, N", "error", "scatter, uN", "sigma, uN", "adhesion, J/m2")]
    for one in found:
        error = "" if one.force_n is None else f"{100 * (one.force_n / one.true_n - 1):+.2f} %"
        read = "not read" if one.force_n is None else f"{one.force_n:.5f}"
        work = "" if one.adhesion_j_m2 is None else f"{one.adhesion_j_m2:.4f}"
        apart = f"{1e6 * one.scatter_n:.0f}", f"{1e6 * one.sigma_n:.0f}"
        rows.append((one.case, one.shape, f"{one.true_n:.5f}", read, error, *apart, work))
    data = {"objects": [asdict(one) for one in found]}
    return Report("Force of presses", figures, rows, data)


def _single(found: Sequence[Found]) -> list[Figure]:
    """Of the cases that are there once."""
    figures = []
    for name, percent_bar in (("side by side", 2.0), ("sticks", 1.0)):
        if own := [one for one in found if one.case.startswith(name)]:
            off = max(100 * abs((one.force_n or np.inf) / one.true_n - 1) for one in own)
            figures.append(Figure(f"{name}, worst", f"{off:.2f} %", f"{percent_bar:g} %", off <= percent_bar))
    for one in found:
        force = np.nan if one.force_n is None else one.force_n
        if one.case.startswith("pulls"):
            words = f"{1e3 * force:.2f} mN"
            figures.append(Figure(f"a pull of {1e3 * one.true_n:g} mN", words, "below 0", force < 0))
        elif one.case == "50 mg":
            sure = force / one.sigma_n
            figures.append(Figure("50 mg, in one frame's sigmas", f"{sure:.1f}", "5", sure >= 5))
        elif one.case == "thickness":
            off = abs(force - one.true_n) / one.sigma_n
            figures.append(Figure("thickness 10 % wrong, in sigmas", f"{off:.1f}", "2", off <= 2))
        elif one.case == "friction":
            off = 100 * abs(force / one.true_n - 1)
            figures.append(Figure("friction of half the force", f"{off:.2f} %", "0.5 %", off <= 0.5))
    if works := [one.adhesion_j_m2 for one in found if one.adhesion_j_m2 is not None]:
        off = max(100 * abs(work / ADHESION_J_M2 - 1) for work in works)
        figures.append(Figure("work of adhesion, worst", f"{off:.0f} %", "15 %", off <= 15))
        z = max(
            abs(one.adhesion_j_m2 - ADHESION_J_M2) / one.adhesion_sigma
            for one in found
            if one.adhesion_j_m2 is not None and one.adhesion_sigma
        )
        figures.append(Figure("the same, in its sigmas", f"{z:.1f}", "2", z <= 2))
    # not of those whose rig file is wrong, or that are dragged
    balls = [one for one in found if one.case.startswith(("random", "side"))]
    for name, values, bar in (
        ("greatest pressure of a ball", [one.largest for one in balls if one.largest is not None], 0.1),
        ("sum of a ball's pressure", [one.whole for one in balls if one.whole is not None], None),
    ):
        if values:
            off = float(np.abs(np.array(values) - 1).max())
            figures.append(figure(f"{name}, worst of {len(values)}", off, unit="%", most=bar))
    return figures


@benchmark(
    "force",
    __doc__,
    click.option("--presses", default=RANDOM, show_default=True, help="Random presses."),
    click.option("--single/--no-single", default=True, help="Weight, adhesion, friction and such, too."),
    part_options,
    salt_option,
)
def command(quick: bool, presses: int, single: bool, keep: Path | None, most_runs: int | None) -> Report:
    """Run what is missing, and report all."""
    count = QUICK if quick else presses
    wanted = [*(once() if single else {}).items(), *random(count).items()]
    parts = Parts(keep, most_runs, presses=count, single=single)
    runs = parts.run(
        len(wanted), "presses", lambda number: [asdict(one) for one in measured(*wanted[number], number)]
    )
    return report([Found(**one) for run in runs for one in run])


if __name__ == "__main__":
    start(command)
