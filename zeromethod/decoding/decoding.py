"""Phasors from frames: least squares over the shifts, pixel by pixel, one set of shifts at a time.

Every set (one axis, one period) is fitted by mean + fundamental + as many harmonics as the shifts can
separate from noise. With equal shifts harmonics 2 to N - 2 do not affect the fundamental, fitted or not;
fitting them keeps an LCD that is drawn without its inverse response from being mistaken for noise. Only one
set's frames are in memory at a time. The fit is one product of matrices per set.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import islice

import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.decoding.fringes import FringeSequence, FringeSet, design_matrix
from zeromethod.errors import InputError

_MOST_HARMONICS = 3
_WORST_CONDITION = 20.0
_SAMPLES = 16_000
_FEW = 4


@dataclass(frozen=True, slots=True)
class Phasors:
    """Least-squares fit of the shifts, per pixel; axis 0 = columns, 1 = rows.

    cosine, sine: per axis (periods, rows, cols) of the fundamental, grey levels, mean over repeats: grey =
    mean + cosine cos(shift) + sine sin(shift) + harmonics. mean: (sets, rows, cols) grey, sets in the
    sequence's order (repeats separate). scatter: (sampled rows, cols) variance of the noise in the rows
    `sampled`, grey^2, as a mean over `degrees` degrees of freedom: of the fit's residual or, for fewer than
    six shifts, which would mistake harmonics for noise, of neighbouring pixels' phases.
    worst_scatter: (rows, cols) variance of the fit's residual in the worst set, of `set_degrees`. moved:
    (rows, cols) largest change of a phasor between repeats, grey. saturated: (rows, cols). second_harmonic:
    its share of the fundamental, mean by the fundamental's power; NaN where not fitted.
    """

    sequence: FringeSequence
    cosine: tuple[Single, Single]
    sine: tuple[Single, Single]
    mean: Single
    scatter: Single
    sampled: slice
    worst_scatter: Single
    degrees: int
    set_degrees: int
    moved: Single
    saturated: Mask
    second_harmonic: float

    def power(self, axis: int, period: int) -> Single:
        """(rows, cols) squared amplitude of the fundamental, grey^2."""
        return np.asarray(self.cosine[axis][period] ** 2 + self.sine[axis][period] ** 2)


@cache
def fit_matrices(shifts_rad: tuple[float, ...]) -> tuple[Float, Float]:
    """Design matrix (shifts, terms) and its least-squares inverse (terms, shifts).

    Harmonics: as many, one to three, as leave a degree of freedom and a well-conditioned fit.
    """
    for harmonics in range(_MOST_HARMONICS, 0, -1):
        design = design_matrix(shifts_rad, harmonics)
        if len(shifts_rad) > design.shape[1] and np.linalg.cond(design) < _WORST_CONDITION:
            break
    return design, np.ascontiguousarray(np.linalg.pinv(design))


def _stacks(frames: Iterable[Image], sequence: FringeSequence) -> Iterator[Image]:
    """(shifts, rows, cols) per set; InputError for frames that differ, are missing or too many."""
    source = iter(frames)
    count, shape, dtype, number = len(sequence.shifts_rad), None, None, 0
    for _ in sequence.sets():
        stack = [np.asarray(frame) for frame in islice(source, count)]
        for frame in stack:
            if frame.ndim != 2 or frame.dtype.kind not in "uif":
                raise InputError(f"frame {number}: {frame.dtype} {frame.shape}: a grey image (rows, cols)")
            shape, dtype = shape or frame.shape, dtype or frame.dtype
            if frame.shape != shape or frame.dtype != dtype:
                raise InputError(
                    f"frame {number}: {frame.shape[1]} x {frame.shape[0]} px {frame.dtype}: "
                    f"the first frame has {shape[1]} x {shape[0]} px {dtype}"
                )
            number += 1
        if len(stack) < count:
            break
        if dtype is not None and dtype.kind == "f" and not np.isfinite(stack).all():
            raise InputError(f"frames {number - count} and on: not finite: grey levels")
        yield np.stack(stack)
    if number != sequence.frames or next(source, None) is not None:
        more = " or more" if number == sequence.frames else ""
        raise InputError(f"frames: {number + bool(more)}{more}: {frames_expected(sequence)}")


def frames_expected(sequence: FringeSequence) -> str:
    """Required number of frames, in words."""
    repeats = f"{sequence.repeats} repeats x " if sequence.repeats > 1 else ""
    columns, rows = map(len, sequence.periods)
    sets = f"2 axes x {columns} periods" if columns == rows else f"({columns} + {rows}) periods"
    return f"{repeats}{sets} x {len(sequence.shifts_rad)} shifts = {sequence.frames}"


def decode_phasors(
    frames: Iterable[Image], sequence: FringeSequence, ceiling_grey: float | None = None
) -> Phasors:
    """Fit every set of shifts.

    frames: (rows, cols) grey images in the sequence's order, taken one set at a time.
    ceiling_grey: level from which a pixel counts as saturated; the largest of an integer type when left out.
    Raises InputError for frames of other number, shape or type.
    """
    design, solve = fit_matrices(sequence.shifts_rad)
    count, terms = design.shape
    degrees, separable = count - terms, terms > 3
    # mean, fundamental, second harmonic where fitted, and the residual along directions that no term has
    matrix = np.vstack([solve[:5], np.linalg.svd(design)[0][:, terms:].T])
    sums: _Sums | None = None
    for fringes, stack in zip(sequence.sets(), _stacks(frames, sequence), strict=True):
        whole = stack.dtype.kind in "ui"
        ceiling = ceiling_grey or (float(np.iinfo(stack.dtype).max) if whole else np.inf)
        sums = sums or _Sums(sequence, stack.shape[1:])
        kind = np.result_type(stack, np.float32)
        flat = stack.reshape(count, -1).astype(kind)
        fitted = (matrix.astype(kind) @ flat).reshape(-1, *stack.shape[1:])
        sums.add(fringes, fitted[0], fitted[1:3])
        if degrees > 0:
            squares = np.einsum("nij,nij->ij", (rest := fitted[min(terms, 5) :]), rest) / degrees
            np.maximum(sums.worst, squares, out=sums.worst)
        if separable:
            sums.scatter += squares[sums.sampled]
            sums.second += _second_harmonic(fitted[1:5, sums.sampled, ::_FEW])
        else:
            _neighbour_scatter(fitted[1:3, sums.sampled], solve, sums.scatter)
        if stack.max() >= ceiling:
            sums.saturated |= (stack >= ceiling).any(axis=0)
    assert sums is not None
    sets = sequence.frames // count
    return Phasors(
        sequence,
        (sums.cosine[0], sums.cosine[1]),
        (sums.sine[0], sums.sine[1]),
        sums.mean,
        sums.scatter / np.float32(sets),
        sums.sampled,
        sums.worst,
        degrees * sets if separable else sets,
        degrees,
        sums.moved,
        sums.saturated,
        float(sums.second[0] / sums.second[1]) if sums.second[1] > 0 else float("nan"),
    )


class _Sums:
    """What is added up, set by set."""

    def __init__(self, sequence: FringeSequence, shape: tuple[int, ...]) -> None:
        rows, cols = shape
        self._share = 1.0 / sequence.repeats
        self.cosine, self.sine = (
            [np.zeros((len(periods), rows, cols), np.float32) for periods in sequence.periods]
            for _ in range(2)
        )
        self._first: dict[tuple[str, int], Single] = {}
        self.mean = np.empty((sequence.frames // len(sequence.shifts_rad), rows, cols), np.float32)
        self._sets = 0
        self.worst, self.moved = np.zeros((rows, cols), np.float32), np.zeros((rows, cols), np.float32)
        self.saturated = np.zeros((rows, cols), np.bool_)
        self.sampled = slice(None, None, max(1, rows * cols // _SAMPLES))
        self.scatter = np.zeros_like(self.moved[self.sampled])
        self.second = np.zeros(2)

    def add(self, fringes: FringeSet, mean: Single, phasor: Single) -> None:
        """Take the fit of one set: mean (rows, cols), cosine and sine (2, rows, cols)."""
        axis = int(fringes.axis == "rows")
        self.mean[self._sets] = mean
        self._sets += 1
        if self._share == 1.0:
            self.cosine[axis][fringes.period], self.sine[axis][fringes.period] = phasor
        else:
            self.cosine[axis][fringes.period] += self._share * phasor[0]
            self.sine[axis][fringes.period] += self._share * phasor[1]
            first = self._first.setdefault((fringes.axis, fringes.period), phasor)
            np.maximum(self.moved, np.hypot(*(phasor - first)), out=self.moved)


def phase_squares(turn: Float | Single) -> Float:
    """Squared fourth differences of phases (..., n), turns, over 70: white noise's variance (..., n - 4).

    A phase that is smooth over five pixels falls out.
    """
    second = np.diff(turn.astype(np.float64), n=2)
    fourth = np.diff(second - np.rint(second), n=2)
    return np.asarray(fourth**2 / 70.0)


def _neighbour_scatter(phasor: Single, solve: Float, out: Single) -> None:
    """Add the noise variance, grey^2, of a phasor (2, rows, cols), from neighbouring pixels' phases."""
    if phasor.shape[2] <= 4:
        return
    turn = np.arctan2(phasor[1], phasor[0]) * np.float32(0.5 / np.pi)
    share = float(np.mean(np.sum(solve[1:3] ** 2, axis=1))) / (2 * np.pi) ** 2
    squares = np.pad(phase_squares(turn), ((0, 0), (2, 2)), mode="edge")
    out += squares * (phasor[0] ** 2 + phasor[1] ** 2) / share


def _second_harmonic(phasors: Single) -> Float:
    """Second harmonic times fundamental and fundamental squared, summed, of (4, rows, cols)."""
    fundamental, second = np.hypot(phasors[0], phasors[1]), np.hypot(phasors[2], phasors[3])
    return np.array([np.vdot(second, fundamental), np.vdot(fundamental, fundamental)])
