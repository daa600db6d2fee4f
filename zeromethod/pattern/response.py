"""The panel's response: grey code to light and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.errors import InputError
from zeromethod.rig.model import DisplaySpec

TABLE_SIZE = 1024
"""Entries of the table from light to code."""


@dataclass(frozen=True, eq=False)
class Response:
    """Light (0..1) of grey codes (0..255): a power law, or `light_of_code` at equally spaced codes.

    exponent: (rows, cols) to which that light is raised, from corner to corner of the panel; None: 1
    everywhere. Raises InputError when the light does not rise from code to code.
    """

    gamma: float = 1.0
    light_of_code: tuple[float, ...] | None = None
    exponent: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        points = self.light_of_code
        if points is not None and (len(points) < 2 or np.any(np.diff(points) <= 0)):
            raise InputError(f"display: response_light: {points}: at least two values, each above the last")

    @classmethod
    def from_rig(cls, display: DisplaySpec) -> Response:
        """Response of a rig file's panel."""
        return cls(display.gamma, display.response_light, display.response_exponent)

    def light(self, code: ArrayLike) -> Float:
        """Light of grey codes, which need not be whole, where the exponent is 1."""
        share = np.asarray(code, dtype=np.float64) / 255
        if self.light_of_code is None:
            return np.asarray(share**self.gamma)
        return np.interp(share, np.linspace(0, 1, len(self.light_of_code)), self.light_of_code)

    def inverse(self, light: ArrayLike) -> Float:
        """Grey code, not rounded, of a light; light out of the panel's reach gives the nearest code.

        As `light`: where the exponent is 1.
        """
        wanted = np.clip(np.asarray(light, dtype=np.float64), 0, 1)
        if self.light_of_code is None:
            return np.asarray(255 * wanted ** (1 / self.gamma))
        return np.interp(wanted, self.light_of_code, np.linspace(0, 255, len(self.light_of_code)))

    def picture(self, light: Float | Single) -> Bytes:
        """Grey codes (rows, cols) of a picture's light over the whole panel, each by its place's inverse."""
        wanted = np.asarray(light, dtype=np.float64)
        if self.exponent is not None:
            wanted = np.clip(wanted, 0, 1) ** (1 / self.exponents(wanted.shape))
        return np.floor(self.inverse(wanted) + 0.5).astype(np.uint8)

    def exponents(self, shape: tuple[int, ...]) -> Float:
        """Exponent of every pixel of a panel of (rows, cols)."""
        given = np.asarray(self.exponent)
        down, across = (
            np.linspace(0, knots - 1, pixels) for knots, pixels in zip(given.shape, shape, strict=True)
        )
        columns = np.stack([np.interp(across, np.arange(given.shape[1]), row) for row in given])
        low = np.minimum(down.astype(np.intp), given.shape[0] - 2)
        share = (down - low)[:, None]
        return np.asarray((1 - share) * columns[low] + share * columns[low + 1])

    def code(self, light: float) -> int:
        """Whole grey code nearest to a light's."""
        return int(np.floor(self.inverse(light) + 0.5))

    @cached_property
    def table(self) -> Single:
        """(1024,) codes at equally spaced square roots of light 0..1.

        The root takes the sting out of a power law near black: at gamma 2.2 linear interpolation is
        within 0.002 codes from light 1e-4 upwards.
        """
        return self.inverse(np.linspace(0, 1, TABLE_SIZE) ** 2).astype(np.float32)
