"""Maps on a regular lattice in millimetres, resampled from nodes that are regular in camera pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.errors import InputError, MeasurementError
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.interpolant import sample

LARGEST_PX = 100_000_000
_STEPS = 12
_SETTLED_NODES = 1e-6
_BORDER = 2
"""Nodes put round a map before it is sampled: the interpolant's support fits up to the last node then."""


@dataclass(frozen=True, slots=True)
class MapLattice:
    """Points (x0 + i pitch, y0 + j pitch): row j grows with y, column i with x; all in mm.

    The origin is a multiple of the pitch, so that lattices of equal pitch share their points.
    """

    x0_mm: float
    y0_mm: float
    pitch_mm: float
    shape: tuple[int, int]

    @classmethod
    def covering(cls, x_mm: Float, y_mm: Float, pitch_mm: float | None = None) -> MapLattice:
        """MapLattice over nodes (rows, cols), NaN where there are none.

        Without a pitch, it is the nodes' own distance on the axis where that is less, to two digits and not
        above. Raises InputError where the pitch is no length, or its lattice would be empty or too large;
        MeasurementError where there is no node at all.
        """
        if pitch_mm is not None and not (math.isfinite(pitch_mm) and pitch_mm > 0.0):
            raise InputError(f"--pitch: {pitch_mm:g}: a finite number of mm above 0")
        if not (np.isfinite(x_mm) & np.isfinite(y_mm)).any():
            raise MeasurementError("no node looks at the mirror: there is no place to put a lattice")
        if pitch_mm is None:
            apart = (np.hypot(np.diff(x_mm, axis=a), np.diff(y_mm, axis=a)) for a in (0, 1))
            pitch_mm = _two_digits(min(float(np.nanmedian(distance)) for distance in apart))
        first = [math.ceil(float(np.nanmin(values)) / pitch_mm) for values in (y_mm, x_mm)]
        last = [math.floor(float(np.nanmax(values)) / pitch_mm) for values in (y_mm, x_mm)]
        rows, cols = (b - a + 1 for a, b in zip(first, last, strict=True))
        if min(rows, cols) < 2 or rows * cols > LARGEST_PX:
            raise InputError(
                f"--pitch: {pitch_mm:g} mm: gives {max(cols, 0)} x {max(rows, 0)} points; "
                f"allowed: at least 2 x 2, at most {LARGEST_PX} in all"
            )
        return cls(first[1] * pitch_mm, first[0] * pitch_mm, pitch_mm, (rows, cols))

    def mesh(self) -> tuple[Float, Float]:
        """(x, y), each (rows, cols), mm."""
        rows, cols = self.shape
        x = self.x0_mm + self.pitch_mm * np.arange(cols)
        y = self.y0_mm + self.pitch_mm * np.arange(rows)
        return np.meshgrid(x, y)[0], np.meshgrid(x, y)[1]


class Resampler:
    """Brings maps at nodes to a lattice: cubic, NaN wherever a corner of the cell is not valid."""

    def __init__(self, lattice: MapLattice) -> None:
        self._lattice = lattice
        self._at: Float | None = None

    def __call__(self, x_mm: Float, y_mm: Float, valid: Mask, values: Float) -> Float:
        """Values (rows, cols, k) at nodes (x_mm, y_mm) as (lattice rows, lattice cols, k)."""
        known = valid & np.isfinite(x_mm) & np.isfinite(y_mm)
        out = np.full((*self._lattice.shape, values.shape[-1]), np.nan)
        if not known.any():
            return out
        at = self._nodes_at(_completed(np.stack([x_mm, y_mm], axis=-1), np.isfinite(x_mm + y_mm)))
        col, row = at[..., 0], at[..., 1]
        whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
        with np.errstate(invalid="ignore"):
            inside = (col >= 0) & (row >= 0) & (col <= known.shape[1] - 1) & (row <= known.shape[0] - 1)
        i = np.clip(np.where(inside, col, 0).astype(int), 0, whole.shape[1] - 1)
        j = np.clip(np.where(inside, row, 0).astype(int), 0, whole.shape[0] - 1)
        inside &= whole[j, i]
        for k in range(0, values.shape[-1], 2):
            pair = values[..., [k, min(k + 1, values.shape[-1] - 1)]]
            sampled = sample(_completed(pair, known), col[inside] + _BORDER, row[inside] + _BORDER)
            out[inside, k : k + 2] = sampled[:, : out.shape[-1] - k]
        return out

    def _nodes_at(self, places: Float) -> Float:
        """Node position (column, row) of every lattice point, by Newton's steps from the map before."""
        x, y = self._lattice.mesh()
        wanted = np.stack([x, y], axis=-1)
        along_row, along_col = np.gradient(places, axis=(0, 1))
        tangents = np.concatenate([along_col, along_row], axis=-1)
        at = _by_plane(places, wanted) if self._at is None else self._at
        largest = np.array(places.shape[1::-1]) - 2.0
        for _ in range(_STEPS):
            inside = np.clip(at + _BORDER, 1.0, largest)
            missed = wanted - sample(places, inside[..., 0], inside[..., 1])
            xc, yc, xr, yr = np.moveaxis(sample(tangents, inside[..., 0], inside[..., 1]), -1, 0)
            area = xc * yr - xr * yc
            step = np.stack(
                [yr * missed[..., 0] - xr * missed[..., 1], xc * missed[..., 1] - yc * missed[..., 0]],
                axis=-1,
            )
            step /= area[..., None]
            at = inside - _BORDER + step
            within = np.all((at + _BORDER > 1.0) & (at + _BORDER < largest), axis=-1)
            if not within.any() or np.max(np.abs(step[within])) < _SETTLED_NODES:
                break
        self._at = at
        return at


def _by_plane(places: Float, wanted: Float) -> Float:
    """First guess of node positions: the plane through all nodes, turned round."""
    rows, cols = places.shape[:2]
    col, row = np.meshgrid(np.arange(cols) - _BORDER, np.arange(rows) - _BORDER)
    known = np.column_stack([places.reshape(-1, 2), np.ones(rows * cols)])
    plane = np.linalg.lstsq(known, np.column_stack([col.ravel(), row.ravel()]), rcond=None)[0]
    return np.asarray(wanted @ plane[:2] + plane[2])


def _completed(field: Float, known: Mask) -> Float:
    """Field (rows, cols, 2) with a border round it; border and unknown nodes continue it smoothly."""
    padding = ((_BORDER, _BORDER), (_BORDER, _BORDER))
    wide = np.pad(np.asarray(field, dtype=np.float64), (*padding, (0, 0)))
    return continue_smoothly(wide, np.pad(known, padding))


def _two_digits(value: float) -> float:
    """The value to two digits, not above it."""
    exponent = math.floor(math.log10(value)) - 1
    return float(f"{math.floor(value * 10.0**-exponent + 1e-9)}e{exponent}")
