"""What presses inside a contact: a few pressures on its area, and the dent that each makes in a half-space.

Source: Johnson 1985, Contact Mechanics, 3.2 to 5.2, doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact.contact import Contact
from zeromethod.contact.polygon import evenly

SHAPES = 8
"""Pressures of a contact; the first is a ball's, the others sum up to no force."""
_RINGS, _RAYS = 9, 40
_OPEN = 0.7
"""Standard deviation, before anything was read, of the share of force that presses otherwise than a ball
does: 1 for a punch or a cone, and a ball is between the two."""
_PASSES = 3
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
        at, weight = np.polynomial.legendre.leggauss(_RINGS)
        theta, weight = np.pi / 4 * (at + 1), np.pi / 4 * weight
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

    def depth(self, at_mm: Float) -> Float:
        """Depth (n, SHAPES) at points (n, 2), mm, in 1 / (pi E*) of a newton."""
        return _products(self._near(at_mm), self.forces)

    def slope(self, at_mm: Float) -> Float:
        """Slope (n, SHAPES, 2) at points (n, 2), in 1 / (pi E*) of a newton."""
        cube = self._near(at_mm) ** 3
        away = [at_mm[:, k, None] - self.cells[:, k] for k in (0, 1)]
        return -np.stack([_products(cube * way, self.forces) for way in away], axis=-1)

    def _near(self, at_mm: Float) -> Float:
        """1 / distance of points from cells (n, cells)."""
        x, y = (at_mm[:, k, None] - self.cells[:, k] for k in (0, 1))
        return np.asarray(1.0 / np.sqrt(x * x + y * y + self.own2_mm2))


def _products(near: Float, forces: Float) -> Float:
    """(n, SHAPES) sums over cells. Not by the linear algebra library: its threads change the last bit."""
    return np.asarray(np.einsum("nc,sc->ns", near, forces))


def shares(normal: Float, right: Float, newtons: Float, alike: float = 1.0) -> tuple[Float, Float]:
    """Shares (t,) of all contacts' pressures that solve normal equations, and these (t, t) with what is open.

    The pressures come first, contact by contact; those without a net force are as large as needed, not more.
    newtons: (contacts,) forces if all were balls. alike: number of values that are off together.
    """
    count = SHAPES * len(newtons)
    for _ in range(_PASSES):
        known = normal.copy()
        for k, own in zip(range(0, count, SHAPES), newtons, strict=True):
            parts = np.arange(k + 1, k + SHAPES)
            known[parts, parts] += alike / max((_OPEN * float(own)) ** 2, 1e-30)
        mean = np.asarray(np.linalg.solve(known, right), np.float64)
        # of balls that stick it is the parts that say how much is open
        newtons = np.maximum(np.abs(newtons), np.abs(mean[:count]).reshape(-1, SHAPES).max(axis=1))
    return mean, known
