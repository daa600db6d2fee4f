"""What presses inside a contact: a few pressures on its area, and the dent that each makes in a half-space.

Source: Johnson 1985, Contact Mechanics, 3.2 to 5.2, doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.contact.contact import Contact
from zeromethod.contact.polygon import evenly

SHAPES = 8
"""Pressures of a contact; the first is a ball's, the others sum up to no force."""
RINGS, _RAYS = 9, 40
"""Cells of a contact: ring by ring from its middle."""
_GAUSS = np.polynomial.legendre.leggauss(RINGS)
_THETA, _WEIGHT = np.pi / 4 * (_GAUSS[0] + 1), np.pi / 4 * _GAUSS[1]
_RHO, _DEPTH = np.sin(_THETA), np.cos(_THETA)
_RINGS = np.stack([_RHO * _DEPTH**2, _RHO, np.arccosh(1 / _RHO) * _RHO * _DEPTH]) * _WEIGHT
"""Pressure x rho d(rho) of a ball, a punch and a cone. With rho = sin(theta), Gauss points of theta make
every sum exact where the pressure is infinite at the border, too."""
_OPEN = np.array([0.7, 0.7, 0.7, 0.7, 0.2, 0.2, 0.2])
"""Standard deviations, before anything was read, of the shares of force that press otherwise than a ball
does: 1 for a punch or a cone, and a ball is between the two; what is bent is less than that."""
_LEAST = 0.002
"""Force over radius^2, in 1 / (pi E*), as which a smaller one counts for that: a ball that sticks may press
in its middle as much as it pulls at its border."""
_OWN = 0.2837
"""A cell acts on itself as from that share of its side: the mean of 1 / distance over a square."""


@dataclass(frozen=True, slots=True)
class Loads:
    """Pressures on one contact, as forces of cells that are small where the pressure of a punch is large.

    cells: (n, 2) mm. area_mm2: (n,) their areas. forces: (SHAPES, n) that of a ball (sum 1), what a punch and
    a cone differ from it by, and a punch's tilted along x and y and bent as xx, xy, yy in the contact's own
    axes.
    """

    cells: Float
    area_mm2: Float
    forces: Float

    @property
    def own2_mm2(self) -> Float:
        """(n,) square of the distance from which a cell acts on itself."""
        return _OWN**2 * self.area_mm2

    @classmethod
    def of(cls, contact: Contact) -> Loads:
        """Pressures on the area within a contact's border.

        rho runs from 0 in the middle to 1 at the border along every ray; for balls, cylinders that cross and
        cones that is exact.
        """
        middle = np.array([contact.x_mm, contact.y_mm])
        border = evenly(contact.outline_mm, _RAYS) - middle
        axes = 2 / contact.major_mm, 2 / max(contact.minor_mm, 1e-6)
        offset, area, forces = _pressures(border, np.radians(contact.angle_deg), *axes)
        return cls(offset + middle, area, forces)

    @property
    def middle_mm(self) -> Float:
        """(2,) where a ball's force acts."""
        return np.asarray(np.einsum("c,ck->k", self.forces[0], self.cells))


def _pressures(border: Float, angle: float, by_major: float, by_minor: float) -> tuple[Float, Float, Float]:
    """(cells (n, 2) from the middle, their areas (n,), forces (SHAPES, n)) within a border (_RAYS, 2).

    by_major, by_minor: 1 / half an axis.
    """
    along = np.roll(border, -1, axis=0) - np.roll(border, 1, axis=0)
    sector = 0.5 * np.abs(border[:, 0] * along[:, 1] - border[:, 1] * along[:, 0])
    area = np.outer(_RHO * _DEPTH * _WEIGHT, sector).ravel()
    ball, punch, cone = (one / one.sum() for one in (np.outer(ring, sector).ravel() for ring in _RINGS))
    u, v = (np.outer(_RHO, border[:, axis]).ravel() for axis in (0, 1))
    x = by_major * (u * np.cos(angle) + v * np.sin(angle))
    y = by_minor * (v * np.cos(angle) - u * np.sin(angle))
    uneven = np.stack([x, y, x * x, x * y, y * y])
    own = punch * (uneven - (uneven * punch).sum(axis=1, keepdims=True))
    own /= np.maximum(np.abs(own).sum(axis=1, keepdims=True), 1e-12)
    return np.stack((u, v), axis=-1), area, np.vstack([ball, punch - ball, cone - ball, own])


@lru_cache
def _indices(contacts: int, tilts: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Places of shares without a net force, and of the others."""
    every = np.arange(SHAPES * contacts + tilts)
    net = (every % SHAPES == 0) | (every >= SHAPES * contacts)
    return np.flatnonzero(~net), np.flatnonzero(net)


def shares(normal: Float, right: Float, loads: Sequence[Loads]) -> tuple[Float, Float]:
    """Shares (t,) of all contacts' pressures that solve normal equations, and these (t, t) with what is open.

    The pressures come first, contact by contact; those without a net force are about as large as it.
    """
    parts, alone = _indices(len(loads), len(right) - SHAPES * len(loads))
    balls = np.linalg.solve(normal[alone[:, None], alone], right[alone])[: len(loads)]
    newtons = np.maximum(np.abs(balls), [_LEAST * load.area_mm2.sum() / np.pi for load in loads])
    known = normal.copy()
    known[parts, parts] += np.outer(newtons, _OPEN).ravel() ** -2
    return np.asarray(np.linalg.solve(known, right), np.float64), known
