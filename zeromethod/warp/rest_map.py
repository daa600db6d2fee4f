"""The rest map: the LCD position that every camera pixel looks at by the mirror at rest."""

from __future__ import annotations

import enum
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Flags, Float, Ints, Mask
from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

T = TypeVar("T", bound=np.generic)


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
        q, sigma, found = _fit(self, grid, half)
        flags = np.where(grid.measurable, np.uint16(0), np.uint16(Flag.OUTSIDE))
        for reason, flag in _FLAGS:
            flags[grid.measurable & (found & int(reason) != 0)] |= np.uint16(flag)
        return Warp(q, sigma, flags, time_ns)


def _worst(reasons: Flags) -> Flags:
    """The most frequent bit (n,) of windows (n, pixels)."""
    counts = np.stack([(reasons >> bit & 1).sum(axis=1) for bit in range(16)], axis=1)
    return np.asarray(np.left_shift(1, counts.argmax(axis=1)), np.uint16)


def _quadratic(place: Float, spread: Float, valid: Mask, basis: Float) -> tuple[Float, Float]:
    """Values and sigma (n,) in the middle of the quadratics through windows (n, pixels).

    basis: (pixels, 6) 1, x, y, x^2, x y, y^2.
    """
    weights = np.where(valid, 1.0 / np.maximum(spread, _LEAST_SIGMA_PX) ** 2, 0.0)
    products = (basis[:, :, None] * basis[:, None, :]).reshape(len(basis), -1)
    normal = (weights @ products).reshape(-1, 6, 6)
    # a ridge far below the data's weight keeps a window of only a few lines of pixels solvable
    for m in range(1, 6):
        normal[:, m, m] += 1e-9 * normal[:, 0, 0]
    inverse = np.linalg.inv(normal)[:, 0]
    right = (weights * np.where(valid, place, 0.0)) @ basis
    return (inverse * right).sum(axis=1), np.sqrt(inverse[:, 0])


def _windows(pixels: NDArray[T], rows: Ints, cols: Ints, half: int) -> NDArray[T]:
    """Pixels (n, (2 half + 1)^2) of the windows around some."""
    size = 2 * half + 1
    views = np.lib.stride_tricks.sliding_window_view(pixels, (size, size))
    return views[rows - half, cols - half].reshape(len(rows), size * size)


def _fit(rest: RestMap, grid: NodeGrid, half: int) -> tuple[Float, Float, Flags]:
    """Weighted least squares of a quadratic per node and component, in windows of `half` px on either side.

    Returns q and sigma (rows, cols, 2), NaN where too few are valid; one reason bit (rows, cols), or 0.
    """
    q, sigma = np.full((2, *grid.shape, 2), np.nan)
    found = np.ones(grid.shape, np.uint16)
    rows, cols = rest.valid.shape
    v, u = (one.ravel() for one in np.meshgrid(grid.v_px, grid.u_px, indexing="ij"))
    inside = (v >= half) & (v < rows - half) & (u >= half) & (u < cols - half)
    nodes = np.flatnonzero(inside)
    v, u = v[inside].astype(np.intp), u[inside].astype(np.intp)
    valid = _windows(rest.valid, v, u, half)
    enough = valid.sum(axis=1) >= max(LEAST_SHARE * (2 * half + 1) ** 2, 7.0)
    lost = ~enough
    found.ravel()[nodes] = 0
    found.ravel()[nodes[lost]] = _worst(_windows(rest.reason, v[lost], u[lost], half))
    v, u, valid, nodes = v[enough], u[enough], valid[enough], nodes[enough]
    y, x = (one.ravel() / half for one in np.mgrid[-half : half + 1, -half : half + 1])
    basis = np.stack([np.ones(x.size), x, y, x * x, x * y, y * y], axis=-1)
    for k in range(2):
        place, spread = (_windows(one[..., k], v, u, half) for one in (rest.lcd_px, rest.sigma_px))
        value, deviation = _quadratic(place, spread, valid, basis)
        q.reshape(-1, 2)[nodes, k], sigma.reshape(-1, 2)[nodes, k] = value, deviation
    return q, sigma, found
