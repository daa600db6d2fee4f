"""Fringe sequences: the pictures shown, fringes of several periods and shifts along columns and rows.

Convention: light(x, k) = 1/2 + contrast/2 cos(2 pi x / period - shift_k), x the LCD column (or row) in px
with pixel centres at integers. A growing shift moves the fringes towards growing x. Light is the LCD's
emission, not its grey code: it is drawn through the inverse response, or enough shifts cancel the harmonics.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.errors import InputError

Axis = Literal["columns", "rows"]

SHIFTS = 6
"""Equal shifts that cancel harmonics 2 to 4: the rest of a gamma of 2.2 shifts the phase by 0.3 mrad."""

CONTRAST = 0.9
"""Contrast that leaves a margin at both ends of the response."""


@dataclass(frozen=True, slots=True)
class FringeSet:
    """The fringes of one axis and one period, all shifts, in one repeat."""

    axis: Axis
    period: int
    repeat: int


@dataclass(frozen=True)
class FringeSequence:
    """Frames of a sequence in order: repeats, in each of these axes, in each periods, in each shifts.

    periods_px: LCD px, of both axes; of the columns alone where row_periods_px gives the rows' own.
    shifts_rad: three or more angles that differ modulo 2 pi.
    """

    periods_px: tuple[float, ...]
    shifts_rad: tuple[float, ...]
    axes: tuple[Axis, Axis] = ("columns", "rows")
    repeats: int = 1
    row_periods_px: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """InputError for a sequence that cannot be decoded."""
        for periods in self.periods:
            if len(periods) < 2 or not all(np.isfinite(p) and p >= 2 for p in periods):
                raise InputError(f"periods: {_listed(periods)}: two or more, each of 2 LCD px or more")
            if any(b - a <= 0 for a, b in pairwise(sorted(periods))):
                raise InputError(f"periods: {_listed(periods)}: each period once")
        angles = np.sort(np.mod(self.shifts_rad, 2 * np.pi))
        gaps = np.diff(angles, append=angles[:1] + 2 * np.pi)
        if len(angles) < 3 or not np.all(np.isfinite(angles)) or gaps.min() < 1e-3:
            degrees = _listed(np.rad2deg(self.shifts_rad))
            raise InputError(f"shifts: {degrees} degrees: three or more that differ modulo 360")
        if np.linalg.cond(design_matrix(self.shifts_rad, 1)) > 20.0:
            degrees = _listed(np.rad2deg(self.shifts_rad))
            raise InputError(f"shifts: {degrees} degrees: spread over the turn, not all on one side")
        if set(self.axes) != {"columns", "rows"}:
            raise InputError(f"axes: {','.join(self.axes)}: columns,rows or rows,columns")
        if self.repeats < 1:
            raise InputError(f"repeats: {self.repeats}: 1 or more")

    @property
    def periods(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Periods along the columns and along the rows, LCD px."""
        return self.periods_px, self.row_periods_px or self.periods_px

    @cached_property
    def even(self) -> bool:
        """Whether the shifts divide the turn evenly, in any order."""
        turns = np.sort(np.mod(np.asarray(self.shifts_rad) - self.shifts_rad[0] + 1e-9, 2 * np.pi))
        return bool(np.allclose(np.diff(turns), 2 * np.pi / len(turns), atol=1e-6))

    @property
    def frames(self) -> int:
        """Pictures in the whole sequence."""
        return self.repeats * sum(map(len, self.periods)) * len(self.shifts_rad)

    def sets(self) -> Iterator[FringeSet]:
        """Groups of frames that differ only in shift, in the order in which they are shown."""
        for repeat in range(self.repeats):
            for axis in self.axes:
                for period in range(len(self.periods[axis == "rows"])):
                    yield FringeSet(axis, period, repeat)

    def pictures(self, columns: int, rows: int, contrast: float = CONTRAST) -> Iterator[Single]:
        """Light (rows, columns), 0 to 1, of every frame in order, on a panel of that size in px."""
        for fringes in self.sets():
            along = np.arange(columns if fringes.axis == "columns" else rows)
            periods_px = self.periods[fringes.axis == "rows"]
            for shift in self.shifts_rad:
                phase = 2 * np.pi * along / periods_px[fringes.period] - shift
                line = (0.5 + 0.5 * contrast * np.cos(phase)).astype(np.float32)
                line = line[None, :] if fringes.axis == "columns" else line[:, None]
                yield np.broadcast_to(line, (rows, columns))


def equal_shifts(count: int) -> tuple[float, ...]:
    """`count` shifts, equally spread over a turn, rad."""
    return tuple(2 * np.pi * k / count for k in range(count))


def design_matrix(shifts_rad: Sequence[float], harmonics: int) -> Float:
    """(shifts, 1 + 2 harmonics): grey = mean + sum over h of c_h cos(h shift) + s_h sin(h shift)."""
    shift = np.asarray(shifts_rad, dtype=np.float64)[:, None]
    order = np.arange(1, harmonics + 1)
    waves = np.stack([np.cos(order * shift), np.sin(order * shift)], axis=-1)
    return np.hstack([np.ones_like(shift), waves.reshape(len(shift), -1)])


def _listed(values: Sequence[float] | Float) -> str:
    return ",".join(f"{value:g}" for value in values)
