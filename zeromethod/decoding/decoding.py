"""Phasors from frames: least squares over the shifts, pixel by pixel, one set of shifts at a time.

Every set (one axis, one period) is fitted by mean + fundamental + as many harmonics as the shifts can
separate from noise. With equal shifts harmonics 2 to N - 2 do not affect the fundamental, fitted or not;
fitting them keeps an LCD that is drawn without its inverse response from being mistaken for noise. Only one
set's frames are in memory at a time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.decoding.fringes import FringeSequence, design_matrix
from zeromethod.errors import InputError

_MOST_HARMONICS = 3
_WORST_CONDITION = 20.0
_SAMPLES = 20_000
_MIXED = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Phasors:
    """Least-squares fit of the shifts, per pixel; axis 0 = columns, 1 = rows.

    cosine, sine: (2, periods, rows, cols) of the fundamental, grey levels, mean over repeats: grey = mean +
    cosine cos(shift) + sine sin(shift) + harmonics. mean: (sets, rows, cols) grey, sets in the sequence's
    order (repeats separate). scatter: (rows, cols) variance of the noise, grey^2, as a mean over `degrees`
    degrees of freedom: of the fit's residual or, for fewer than six shifts, which would mistake harmonics for
    noise, of neighbouring pixels (`from_neighbours`): too large where fringes are narrow or oblique in the
    camera's view. worst_scatter: (rows, cols) variance of the fit's residual in the worst set, of
    `set_degrees`. moved: (rows, cols) largest change of a phasor between repeats, grey. saturated: (rows,
    cols). second_harmonic: its share of the fundamental, median over the brighter pixels; NaN where not
    fitted.
    """

    sequence: FringeSequence
    cosine: Single
    sine: Single
    mean: Single
    scatter: Single
    worst_scatter: Single
    degrees: int
    set_degrees: int
    from_neighbours: bool
    moved: Single
    saturated: Mask
    second_harmonic: float

    @property
    def power(self) -> Single:
        """(2, periods, rows, cols) squared amplitude of the fundamental, grey^2."""
        return self.cosine**2 + self.sine**2


def fit_matrices(shifts_rad: tuple[float, ...]) -> tuple[Float, Float]:
    """Design matrix (shifts, terms) and its least-squares inverse (terms, shifts).

    Harmonics: as many, one to three, as leave a degree of freedom and a well-conditioned fit.
    """
    for harmonics in range(_MOST_HARMONICS, 0, -1):
        design = design_matrix(shifts_rad, harmonics)
        if len(shifts_rad) > design.shape[1] and np.linalg.cond(design) < _WORST_CONDITION:
            break
    return design, np.ascontiguousarray(np.linalg.pinv(design))


@numba.njit(cache=True)
def _fit(frames: Image, design: Float, solve: Float, ceiling: float) -> tuple[Single, Single, Single, Mask]:
    """Phasor (2, rows, cols), mean, variance of the residual, and where a frame reaches the ceiling."""
    count, rows, cols = frames.shape
    terms = design.shape[1]
    degrees = count - terms
    phasor = np.empty((2, rows, cols), np.float32)
    mean, scatter = np.empty((rows, cols), np.float32), np.empty((rows, cols), np.float32)
    saturated = np.zeros((rows, cols), np.bool_)
    grey = np.empty(count)
    fitted = np.empty(terms)
    for j in range(rows):
        for i in range(cols):
            for k in range(count):
                grey[k] = frames[k, j, i]
                if grey[k] >= ceiling:
                    saturated[j, i] = True
            for m in range(terms):
                fitted[m] = 0.0
                for k in range(count):
                    fitted[m] += solve[m, k] * grey[k]
            mean[j, i], phasor[0, j, i], phasor[1, j, i] = fitted[0], fitted[1], fitted[2]
            squares = 0.0
            for k in range(count):
                rest = grey[k]
                for m in range(terms):
                    rest -= design[k, m] * fitted[m]
                squares += rest * rest
            scatter[j, i] = squares / degrees if degrees > 0 else 0.0
    return phasor, mean, scatter, saturated


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
        if not np.isfinite(stack).all():
            raise InputError(f"frames {number - count} and on: not finite: grey levels")
        yield np.stack(stack)
    if number != sequence.frames or next(source, None) is not None:
        more = " or more" if number == sequence.frames else ""
        raise InputError(f"frames: {number + bool(more)}{more}: {frames_expected(sequence)}")


def frames_expected(sequence: FringeSequence) -> str:
    """Required number of frames, in words."""
    repeats = f"{sequence.repeats} repeats x " if sequence.repeats > 1 else ""
    periods, shifts = len(sequence.periods_px), len(sequence.shifts_rad)
    return f"{repeats}2 axes x {periods} periods x {shifts} shifts = {sequence.frames}"


def decode_phasors(
    frames: Iterable[Image], sequence: FringeSequence, ceiling_grey: float | None = None
) -> Phasors:
    """Fit every set of shifts.

    frames: (rows, cols) grey images in the sequence's order, taken one set at a time.
    ceiling_grey: level from which a pixel counts as saturated; the largest of an integer type when left out.
    Raises InputError for frames of other number, shape or type.
    """
    design, solve = fit_matrices(sequence.shifts_rad)
    degrees = design.shape[0] - design.shape[1]
    separable = design.shape[1] > 3
    sets = sequence.frames // len(sequence.shifts_rad)
    phasors: dict[tuple[str, int], Any] = {}
    first: dict[tuple[str, int], Single] = {}
    means: list[Single] = []
    seconds: list[float] = []
    nothing: list[Any] = [np.float32(0)] * 3
    total, worst, moved = nothing
    saturated: Mask = np.zeros(1, np.bool_)
    for fringes, stack in zip(sequence.sets(), _stacks(frames, sequence), strict=True):
        whole = stack.dtype.kind in "ui"
        ceiling = ceiling_grey or (float(np.iinfo(stack.dtype).max) if whole else np.inf)
        phasor, mean, scatter, clipped = _fit(stack, design, solve, ceiling)
        place = fringes.axis, fringes.period
        phasors[place] = phasors.get(place, 0) + phasor / sequence.repeats
        moved = np.maximum(moved, np.hypot(*(phasor - first.setdefault(place, phasor))))
        means.append(mean)
        worst = np.maximum(worst, scatter)
        saturated = np.logical_or(saturated, clipped)
        total = total + (scatter if separable else _neighbour_scatter(stack)) / sets
        if separable:
            seconds.append(_second_harmonic(stack, solve))
    periods = range(len(sequence.periods_px))
    cosine, sine = (
        np.array([[phasors[axis, n][part] for n in periods] for axis in ("columns", "rows")])
        for part in (0, 1)
    )
    return Phasors(
        sequence,
        cosine,
        sine,
        np.array(means),
        total,
        worst,
        degrees * sets if separable else sequence.frames,
        degrees,
        not separable,
        moved,
        saturated,
        float(np.median(seconds)) if seconds else float("nan"),
    )


def _neighbour_scatter(stack: Image) -> Single:
    """Noise variance of every pixel from the mixed fourth difference, mean over the shifts.

    Second differences along both axes in turn (doi:10.1006/cviu.1996.0060) remove fringes along either axis
    and have 36 times the variance of white noise.
    """
    total = np.zeros(stack.shape[1:], dtype=np.float32)
    for frame in stack.astype(np.float32):
        across = cv2.filter2D(frame, -1, _MIXED, borderType=cv2.BORDER_REFLECT_101)
        total += across * across
    return total / np.float32(36.0 * len(stack))


def _second_harmonic(stack: Image, solve: Float) -> float:
    """Second harmonic over fundamental, median over the half of the pixels with the larger fundamental."""
    flat = stack.reshape(len(stack), -1)
    some = flat[:, :: max(1, flat.shape[1] // _SAMPLES)].astype(np.float64)
    fitted = solve[1:5] @ some
    fundamental, second = np.hypot(*fitted[:2]), np.hypot(*fitted[2:4])
    bright = fundamental >= max(float(np.median(fundamental)), 1e-9)
    return float(np.median(second[bright] / fundamental[bright])) if bright.any() else float("nan")
