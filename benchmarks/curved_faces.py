"""Depth on curved sensor faces, known and calibrated: the paper's remedy where a flat face is covered (6.2).

The packaged rigs `dome` and `cylinder`. Known: the loop runs on the rig as its file says, binned by 2 with
larger LCD pixels, and is pressed by loads and a rod, four in turn. Calibrated: benches drawn as in
calibration_benches.py, whose mirror's radius is off by up to 2 %, its centre by 0.5 mm and its axis by 0.5
degrees; the whole calibration with three presses of known depth, then a run on it, pressed four times
elsewhere: a pad, a rod, twin pads, a dry ball. Errors are those of each press's peak. Beside a ball's rim a
hollow mirror folds sooner than a flat one; where that cuts the ball off, its sigma says that it was not read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import click
import numpy as np

from benchmarks.calibration_benches import HOLD_S, View, followed, study_bench
from benchmarks.calibration_study import CASES, Outcome
from benchmarks.pads import bar, pad
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import coarser
from benchmarks.salt import salt_option
from zeromethod.cli.numbers import Whole
from zeromethod.rig.load import load_rig
from zeromethod.simulation.press import Dent, Mirror
from zeromethod.surface.comparison import true_peak_mm
from zeromethod.view.progress import Advance, progress

FACES = ("dome", "cylinder")
PRESSES = (
    (0.5, 0.5, 0.1, 4.0, 0.0),
    (0.3, 0.6, 0.15, 6.0, 0.0),
    (0.7, 0.35, 0.05, 3.0, 0.0),
    (0.4, 0.4, 0.1, 4.5, 6.0),
)
"""Place in the view's shares, depth, sigma and length, mm."""
MOST_KNOWN, MOST_CALIBRATED = 0.5, 1.0
"""Largest error of a peak, percent."""
UNREAD = 10.0
"""Stated sigma, percent, from which a press counts as not read."""


@dataclass(frozen=True)
class Face:
    """Errors of peaks on one curved face, percent, known: (presses, frames); and what its benches gave."""

    known: list[list[float]]
    calibrated: list[Outcome]

    @property
    def worst_known(self) -> float:
        """Largest error of a frame, percent; NaN where a press was not read at all."""
        return max(max(map(abs, frames), default=math.nan) for frames in self.known)

    @property
    def read(self) -> list[float]:
        """Errors of the presses that were read on calibrated benches, percent."""
        both = [pair for one in self.calibrated for pair in zip(one.errors, one.sigmas, strict=True)]
        return [error for error, sigma in both if sigma < UNREAD]


def _dent(view: View, x: float, y: float, depth_mm: float, sigma_mm: float, length_mm: float) -> Dent:
    at = view.place(x, y)
    return bar(*at, depth_mm, sigma_mm, length_mm) if length_mm else pad(*at, depth_mm, sigma_mm)


def known_errors(name: str) -> list[list[float]]:
    """Errors of the last frames while a press is held, of each press, percent."""
    rig = coarser(load_rig(name), 2).model_copy(update={"scenario": "none"})
    view = View(rig)
    presses = [(_dent(view, *press),) for press in PRESSES]
    taken, holds = followed(rig, rig, presses)
    errors = []
    for at_ns, dents in zip(holds, presses, strict=True):
        true_mm = true_peak_mm(Mirror(dents), *view.points.T)
        _, peaks = taken.between(at_ns, at_ns + round(1e9 * HOLD_S))
        errors.append([100.0 * (one.depth_mm / true_mm - 1.0) for one in peaks])
    return errors


def studied(name: str, benches: int, advance: Advance) -> Face:
    """Everything of one face."""
    known = known_errors(name)
    advance(name)
    calibrated: list[Outcome] = []
    for number in range(benches):
        calibrated += study_bench(number, len(PRESSES), CASES[:1], name).outcomes
        advance(name)
    return Face(known, calibrated)


def report(benches: int) -> Report:
    """Both faces, and so many calibrated benches of each."""
    with progress(len(FACES) * (1 + benches), FACES[0]) as advance:
        faces = {name: studied(name, benches, advance) for name in FACES}
    figures = []
    for name, face in faces.items():
        known, calibrated = face.worst_known, float(np.max(np.abs(face.read), initial=0.0))
        unread = sum(len(one.errors) for one in face.calibrated) - len(face.read)
        missing = sum(not frames for frames in face.known)
        figures += [
            Figure(f"{name}, known: presses not nulled", f"{missing} of {len(PRESSES)}", "0", not missing),
            Figure(
                f"{name}, known: peak, worst frame of any press",
                f"{known:.3f} %",
                f"{MOST_KNOWN} %",
                known <= MOST_KNOWN,
            ),
            Figure(
                f"{name}, calibrated: peak, worst press of any bench",
                f"{calibrated:.2f} %",
                f"{MOST_CALIBRATED} %",
                calibrated <= MOST_CALIBRATED,
            ),
            Figure(f"{name}, calibrated: presses not read, by their sigma", f"{unread}"),
            Figure(
                f"{name}, calibrated: presses within 2 sigma",
                f"{np.mean([one.covered for one in face.calibrated]):.0%}",
            ),
        ]
    details = [["face", "calibrated bench", "errors %", "stated sigma %"]]
    details += [
        [name, f"{one.bench}", _listed(one.errors), _listed(one.sigmas)]
        for name, face in faces.items()
        for one in face.calibrated
    ]
    data = {name: asdict(face) for name, face in faces.items()}
    return Report("Depth on curved sensor faces", figures, details, data)


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{one:+.2f}" for one in values)


@benchmark(
    "curved_faces",
    __doc__,
    click.option("--benches", type=Whole(min=1), help="Calibrated, of each.  [default: 3, --quick: 1]"),
    salt_option,
)
def command(quick: bool, benches: int | None) -> Report:
    """Run everything."""
    return report(benches or (1 if quick else 3))


if __name__ == "__main__":
    start(command)
