"""The rest map: the LCD position that every camera pixel looks at by the mirror at rest."""

from __future__ import annotations

import enum
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask
from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp


class Reason(enum.IntFlag):
    """Reasons why a pixel is invalid, as bits; 0 means valid. Stored as uint16 arrays."""

    NO_MODULATION = 1  # no fringes: not the mirror, or dark
    SATURATED = 2  # grey levels at the camera's largest
    DEAD = 4  # a few pixels, of camera or LCD, that do not follow their neighbours
    DISTURBED = 8  # the light changed during the capture: a hand, a moved part
    SECOND_REFLECTION = 16  # two places of the LCD in one pixel
    WRONG_ORDER = 32  # whole periods away from its neighbours
    AMBIGUOUS_ORDER = 64  # another order is nearly as likely
    OFF_DISPLAY = 128  # the place lies off the LCD
    INCONSISTENT = 256  # the periods disagree by more than noise, in this pixel alone


def plain_name(reason: Reason) -> str:
    """Name of one reason in words."""
    return str(reason.name).lower().replace("_", " ")


_ARRAYS = ("column", "row", "sigma", "valid", "reason")
_STORED = ("lcd_px", "sigma_px", "valid", "reason")

LEAST_SHARE = 0.5
"""Least valid share of a node's window for the node to be valid."""

_LEAST_SIGMA_PX = 1e-6

_FLAGS: tuple[tuple[Reason, Flag], ...] = (
    (Reason.NO_MODULATION, Flag.MODULATION),
    (Reason.SATURATED, Flag.SATURATED),
    (Reason.DEAD, Flag.MODULATION),
    (Reason.DISTURBED, Flag.LIGHT_LOST),
    (Reason.SECOND_REFLECTION, Flag.MIXED),
    (Reason.WRONG_ORDER, Flag.AMBIGUOUS),
    (Reason.AMBIGUOUS_ORDER, Flag.AMBIGUOUS),
    (Reason.OFF_DISPLAY, Flag.OFF_DISPLAY),
    (Reason.INCONSISTENT, Flag.MIXED),
)


@dataclass(frozen=True, slots=True)
class RestMap:
    """Absolute LCD position per camera pixel.

    lcd_px: (rows, cols, 2) LCD (column, row) in px, pixel centres at integers; NaN where not valid. sigma_px:
    (rows, cols, 2) standard deviation in LCD px, independent from pixel to pixel; NaN where not valid. valid:
    (rows, cols). reason: (rows, cols) uint16 of `Reason` bits, 0 = valid.
    """

    lcd_px: Float
    sigma_px: Float
    valid: Mask
    reason: Flags

    def save(self, path: Path) -> None:
        """Write `path` (.npz) atomically: column, row, sigma, valid, reason."""
        with atomic_write(path) as part, part.open("wb") as file:
            np.savez_compressed(
                file,
                allow_pickle=False,
                column=self.lcd_px[..., 0],
                row=self.lcd_px[..., 1],
                sigma=self.sigma_px,
                valid=self.valid,
                reason=self.reason,
            )

    @classmethod
    def load(cls, path: Path) -> RestMap:
        """Rest map from a file of `save`, or from a calibration's arrays (.h5).

        Raises InputError for anything else.
        """
        if path.suffix == ".h5":
            return cls._of_calibration(path)
        allowed = f"a rest map (.npz with {', '.join(_ARRAYS)})"
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
                column, row, sigma, valid, reason = (data[name] for name in _ARRAYS)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or 'damaged'}): {allowed}") from error
        except (KeyError, ValueError, TypeError, EOFError, AttributeError, zipfile.BadZipFile) as error:
            raise InputError(f"{path}: not complete: {allowed}") from error
        shape = column.shape
        fits = row.shape == valid.shape == reason.shape == shape and sigma.shape == (*shape, 2)
        numeric = all(array.dtype.kind in "fbiu" for array in (column, row, sigma, valid, reason))
        if len(shape) != 2 or not fits or not numeric:
            raise InputError(f"{path}: arrays of shapes that do not go together: {allowed}")
        lcd = np.stack([column, row], axis=-1).astype(np.float64)
        return cls(lcd, sigma.astype(np.float64), valid.astype(np.bool_), reason.astype(np.uint16))

    @classmethod
    def _of_calibration(cls, path: Path) -> RestMap:
        import h5py  # noqa: PLC0415 - loads slowly, rarely needed

        try:
            with h5py.File(path, "r") as file:
                group = file["rest_map"]
                lcd_px, sigma_px, valid, reason = (group[name][()] for name in _STORED)
        except (OSError, KeyError) as error:
            raise InputError(f"{path}: has no rest map; name the arrays (HDF5) of a calibration") from error
        return cls(lcd_px.astype(np.float64), sigma_px.astype(np.float64), valid, reason)

    def warp(self, grid: NodeGrid, time_ns: int = 0) -> Warp:
        """Rest map as a measured warp: q and sigma at the nodes, from a quadratic fitted around each.

        The window is as wide as the node spacing, so the noise of neighbouring nodes is nearly independent.
        Nodes of the padding are `OUTSIDE` (with q where the image reaches them); elsewhere the flag is that
        of the most frequent reason in the window. Raises InputError for a grid of another image size.
        """
        if grid.image_shape != self.valid.shape:
            raise InputError(
                f"rest map: {self.valid.shape[1]} x {self.valid.shape[0]} px: "
                f"the camera has {grid.image_shape[1]} x {grid.image_shape[0]}"
            )
        half = max(1, grid.spacing_px // 2)
        q = np.full((*grid.shape, 2), np.nan)
        sigma = np.full((*grid.shape, 2), np.nan)
        found = np.zeros(grid.shape, dtype=np.uint16)
        _fit(self.lcd_px, self.sigma_px, self.valid, self.reason, grid.u_px, grid.v_px, half, q, sigma, found)
        flags = np.where(grid.measurable, np.uint16(0), np.uint16(Flag.OUTSIDE))
        for reason, flag in _FLAGS:
            flags[grid.measurable & (found & int(reason) != 0)] |= np.uint16(flag)
        return Warp(q, sigma, flags, time_ns)


@numba.njit(cache=True)
def _worst(reason: Flags, rows: tuple[int, int], cols: tuple[int, int]) -> int:
    """The most frequent bit of a window."""
    count = np.zeros(16, dtype=np.int64)
    for j in range(rows[0], rows[1]):
        for i in range(cols[0], cols[1]):
            for bit in range(16):
                count[bit] += (int(reason[j, i]) >> bit) & 1
    most = 0
    for bit in range(16):
        if count[bit] > count[most]:
            most = bit
    return 1 << most


@numba.njit(cache=True)
def _quadratic(
    place: Float,
    spread: Float,
    valid: Mask,
    rows: tuple[int, int],
    cols: tuple[int, int],
    middle: tuple[float, float, float],
) -> tuple[float, float]:
    """Value and sigma at `middle` (column, row, half width) of the quadratic through a window."""
    u, v, half = middle
    normal, right, basis = np.zeros((6, 6)), np.zeros(6), np.empty(6)
    for j in range(rows[0], rows[1]):
        for i in range(cols[0], cols[1]):
            if valid[j, i]:
                x, y = (i - u) / half, (j - v) / half
                basis[0], basis[1], basis[2] = 1.0, x, y
                basis[3], basis[4], basis[5] = x * x, x * y, y * y
                weight = 1.0 / max(spread[j, i], _LEAST_SIGMA_PX) ** 2
                for m in range(6):
                    right[m] += weight * basis[m] * place[j, i]
                    for n in range(6):
                        normal[m, n] += weight * basis[m] * basis[n]
    # a ridge far below the data's weight keeps a window of only a few lines of pixels solvable
    for m in range(1, 6):
        normal[m, m] += 1e-9 * normal[0, 0]
    inverse = np.linalg.inv(normal)
    value = 0.0
    for m in range(6):
        value += inverse[0, m] * right[m]
    return value, np.sqrt(inverse[0, 0])


@numba.njit(cache=True)
def _fit(
    lcd: Float,
    spread: Float,
    valid: Mask,
    reason: Flags,
    u_px: Float,
    v_px: Float,
    half: int,
    q: Float,
    sigma: Float,
    found: Flags,
) -> None:
    """Weighted least squares of a quadratic per node and component; `found` gets one reason bit, or 0."""
    rows, cols = valid.shape
    for b in range(len(v_px)):
        for a in range(len(u_px)):
            j0, i0 = round(v_px[b]), round(u_px[a])
            if not (half <= j0 < rows - half and half <= i0 < cols - half):
                found[b, a] = 1
                continue
            window = (j0 - half, j0 + half + 1), (i0 - half, i0 + half + 1)
            count = 0
            for j in range(window[0][0], window[0][1]):
                for i in range(window[1][0], window[1][1]):
                    count += valid[j, i]
            if count < max(LEAST_SHARE * (2 * half + 1) ** 2, 7.0):
                found[b, a] = _worst(reason, window[0], window[1])
                continue
            middle = (u_px[a], v_px[b], float(half))
            for k in range(2):
                q[b, a, k], sigma[b, a, k] = _quadratic(
                    lcd[..., k], spread[..., k], valid, window[0], window[1], middle
                )
