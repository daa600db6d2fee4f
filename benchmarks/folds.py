"""Steep presses that no picture can null: what a burst of coded pictures reads there, against exact rays.

Loads as curved as Gaussians of sigma 0.8 to 2 mm, so deep that the carrier is too fine for the LCD or the
mirror folds, from one frame to the next, anywhere in the middle half of the camera's view; 1.5 s each. Every
pixel that a burst read is held against where it truly looks: a wrong order is 3 LCD px off and more. Nodes
and the peak of the last frame are held against their sigma, and the residual of all other nodes against that
before the press.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import click
import numpy as np

from benchmarks.honesty import deviation
from benchmarks.pads import HOLLOW, pad
from benchmarks.peaks import LEVER_MM, middle_of_the_view
from benchmarks.report import Figure, Report, benchmark, figure, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed
from benchmarks.salt import generator, salt_option, seed
from benchmarks.totals import SIGMAS, estimate, few_beyond, ratio
from zeromethod.arrays import Float, Mask
from zeromethod.cli.numbers import Whole
from zeromethod.devices.opening import open_devices
from zeromethod.loop.burst import Read
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.optics import Dented, DepthField, Optics
from zeromethod.rig.load import load_rig
from zeromethod.session.session import Session
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.path import PathPoint, PressPath
from zeromethod.simulation.press import Dent
from zeromethod.simulation.scenario import Scenario
from zeromethod.view.progress import progress

PRESSES, QUICK = 200, 8
PRESS_AT, LAST = 8, 110
"""Frames."""

SIZES_MM = 0.8, 2.0
OF_FOLD = 0.6, 2.0
"""Depth over that at which the ring around a load begins to fold."""

WRONG_LCD_PX, PERCENT = 1.5, 1.0
MOST_RESIDUAL = 1.1
SEED = 17


@dataclass(frozen=True)
class Outcome:
    """What came of a press.

    wrong, placed: pixels at a wrong order, and all that were read. beyond, nodes: coordinates of the last
    frame off by more than 3 sigma, and all valid. peak_percent, peak_sigmas: error of the last peak.
    residual: of other nodes during the burst over that before; NaN without one. locked: at the end.
    """

    size_mm: float
    depth_mm: float
    wrong: int
    placed: int
    beyond: int
    nodes: int
    peak_percent: float
    peak_sigmas: float
    residual: float
    locked: bool


def pressed(draw: np.random.Generator) -> Dent:
    """A press that cannot be nulled whole."""
    size_mm = float(draw.uniform(*SIZES_MM))
    folds_mm = size_mm**2 / (HOLLOW * LEVER_MM)
    x, y = VIEW_MIDDLE_MM + float(draw.uniform(-6.0, 6.0)), float(draw.uniform(-4.0, 4.0))
    return pad(x, y, float(draw.uniform(*OF_FOLD)) * folds_mm, size_mm)


def judged(number: int) -> Outcome:
    """One press."""
    draw = generator(SEED, number)
    dent = pressed(draw)
    rig = changed(middle_of_the_view(load_rig("simulated")), simulation={"seed": seed(number)})
    rig = rig.model_copy(update={"scenario": "none"})
    optics, at_ns = Optics(rig), round(1e9 * PRESS_AT / rig.camera.rate_hz)
    points = tuple(PathPoint(at_ns, dent.x_mm, dent.y_mm, depth) for depth in (0.0, dent.depth_mm))
    before, during = [], []
    with open_devices(rig) as devices:
        camera = devices.camera
        assert isinstance(camera, SimulatedCamera)
        camera.scenario = Scenario("steep", (PressPath(dent, points),), 1e9)
        with Session(rig, devices=devices) as session:
            for step in session.run(frames=LAST):
                if Event.BURST in step.events:
                    during.append(step.residual_rms_px)
                elif step.state is State.RESTING:
                    before.append(step.residual_rms_px)
            mirror = camera.truth(step.time_ns)
            read = session.loop.burst_read
            wrong, placed = (0, 0) if read is None else _orders(optics, read, mirror)
            assert step.measured is not None
            valid = step.measured.valid
            true_q = optics.trace(*session.loop.grid.mesh(), Dented(optics.rest, mirror)).q
            off = np.abs(step.measured.q - true_q) / step.measured.sigma
            beyond = int(np.count_nonzero(off[valid] > SIGMAS))
            error_mm, _, ratio = deviation(step, mirror)
    return Outcome(
        dent.size_mm,
        dent.depth_mm,
        wrong,
        placed,
        beyond,
        2 * int(np.count_nonzero(valid)),
        100 * error_mm / dent.depth_mm,
        ratio,
        float(np.median(during) / np.median(before)) if during else float("nan"),
        step.state is State.LOCKED,
    )


def _orders(optics: Optics, read: Read, mirror: DepthField) -> tuple[int, int]:
    """(pixels read wrong, pixels read) of a burst."""
    places: Float = read.places
    known: Mask = read.known
    v, u = np.mgrid[: known.shape[0], : known.shape[1]].astype(np.float64)
    true_q = optics.trace(u + read.left, v + read.top, Dented(optics.rest, mirror)).q
    off = np.abs(places - true_q).max(axis=-1)[known]
    return int(np.count_nonzero(~(off < WRONG_LCD_PX))), len(off)


def summarise(outcomes: Sequence[Outcome]) -> Report:
    """Bars over all presses."""
    wrong, placed = sum(one.wrong for one in outcomes), sum(one.placed for one in outcomes)
    beyond = estimate(ratio, [one.beyond for one in outcomes], [one.nodes for one in outcomes])
    locked = [one for one in outcomes if one.locked]
    percent = [abs(one.peak_percent) for one in locked]
    residual = [one.residual for one in outcomes if np.isfinite(one.residual)]
    within = sum(one < PERCENT for one in percent)
    figures = [
        figure("pixels read at a wrong order", wrong, most=0),
        figure("valid nodes beyond 3 sigma", *beyond, unit="%", most=0.01),
        figure("locked at the end", len(locked), least=0.97, of_other=True),
        Figure("presses; pixels read", f"{len(outcomes)}; {placed}"),
        Figure("of these, peak within 1 %", f"{within} of {len(locked)}", "all", within == len(locked)),
        few_beyond("of these, peaks", [one.peak_sigmas for one in locked]),
        Figure(
            "residual of other nodes during a burst over before, largest",
            f"{max(residual):.2f}" if residual else "no burst",
            "<= 1.1",
            bool(residual) and max(residual) <= MOST_RESIDUAL,
        ),
        Figure("presses with a burst", f"{len(residual)} of {len(outcomes)}"),
    ]
    return Report(
        "Folds and dents too fine for the LCD", figures, [], {"presses": [asdict(o) for o in outcomes]}
    )


@benchmark(
    "folds",
    __doc__,
    click.option("--presses", type=Whole(min=1), default=PRESSES, show_default=True, help="Runs."),
    salt_option,
)
def command(quick: bool, presses: int) -> Report:
    """Run everything."""
    count = QUICK if quick else presses
    outcomes = []
    with progress(count, "presses") as advance:
        for number in range(count):
            outcomes.append(judged(number))
            advance()
    return summarise(outcomes)


if __name__ == "__main__":
    start(command)
