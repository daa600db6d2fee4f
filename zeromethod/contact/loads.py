"""What presses inside a contact: a few pressures on its area, and the dent that each makes in a half-space.

Source: Johnson 1985, Contact Mechanics, 3.2 to 5.2, doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact.contact import Contact
from zeromethod.contact.polygon import evenly

SHAPES = 8
"""Pressures of a contact; the first is a ball's, the others sum up to no force."""
RINGS, _RAYS = 9, 40
"""Cells of a contact: ring by ring from its middle."""
_GAUSS = np.polynomial.legendre.leggauss(RINGS)
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
        cones that is exact. With rho = sin(theta), Gauss points of theta make every sum exact where the
        pressure is infinite at the border, too.
        """
        middle = np.array([contact.x_mm, contact.y_mm])
        border = evenly(contact.outline_mm, _RAYS) - middle
        across = np.roll(border, -1, axis=0) - np.roll(border, 1, axis=0)
        sector = 0.5 * np.abs(border[:, 0] * across[:, 1] - border[:, 1] * across[:, 0])
        theta, weight = np.pi / 4 * (_GAUSS[0] + 1), np.pi / 4 * _GAUSS[1]
        rho, depth = np.sin(theta), np.cos(theta)
        # pressure x rho d(rho)
        rings = np.stack([rho * depth**2, rho, np.arccosh(1 / rho) * rho * depth]) * weight
        whole = (rings[:, :, None] * sector).reshape(3, -1)
        whole /= whole.sum(axis=1, keepdims=True)
        offset = (rho[:, None, None] * border).reshape(-1, 2)
        angle = np.radians(contact.angle_deg)
        x = 2 * (offset @ (np.cos(angle), np.sin(angle))) / contact.major_mm
        y = 2 * (offset @ (-np.sin(angle), np.cos(angle))) / max(contact.minor_mm, 1e-6)
        uneven = np.stack([x, y, x * x, x * y, y * y])
        uneven = whole[1] * (uneven - (uneven * whole[1]).sum(axis=1, keepdims=True))
        uneven /= np.maximum(np.abs(uneven).sum(axis=1, keepdims=True), 1e-12)
        area = ((rho * depth * weight)[:, None] * sector).ravel()
        return cls(offset + middle, area, np.concatenate([whole[:1], whole[1:] - whole[0], uneven]))

    @property
    def middle_mm(self) -> Float:
        """(2,) where a ball's force acts."""
        return np.asarray(np.einsum("c,ck->k", self.forces[0], self.cells))


def shares(normal: Float, right: Float, loads: Sequence[Loads]) -> tuple[Float, Float]:
    """Shares (t,) of all contacts' pressures that solve normal equations, and these (t, t) with what is open.

    The pressures come first, contact by contact; those without a net force are about as large as it.
    """
    count = SHAPES * len(loads)
    parts = np.flatnonzero(np.arange(count) % SHAPES)
    alone = np.delete(np.arange(len(right)), parts)
    balls = np.linalg.solve(normal[np.ix_(alone, alone)], right[alone])[: len(loads)]
    newtons = np.maximum(np.abs(balls), [_LEAST * load.area_mm2.sum() / np.pi for load in loads])
    known = normal.copy()
    known[parts, parts] += np.outer(newtons, _OPEN).ravel() ** -2
    return np.asarray(np.linalg.solve(known, right), np.float64), known
