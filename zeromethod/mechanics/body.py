"""What a rig's prism adds to a half-space's answer to a load, as a few smooth products.

A load that makes a dent of q / r in a half-space (q = F (1 - nu^2) / (pi E), in mm^2; Boussinesq) makes

    d(x, y) = q / r + q sum over i of u_i(x, y) v_i(x', y')

in the prism, with polynomials u_i, v_i. Neither force nor modulus matters, but Poisson's ratio and what holds
the faces do. Loads nearer to the mirror's borders than a tenth count as at the nearest place inside.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from zeromethod.arrays import Float
from zeromethod.kept_arrays import kept_arrays
from zeromethod.mechanics.collocation import mirror_response
from zeromethod.mechanics.faces import faces_of
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.model import Rig
from zeromethod.rig.tables import FaceSupports

_PLACES, _LOADS = (16, 14), (16, 14)
"""Chebyshev points along x and y of places, and of loads; even along y."""

_INSET = 0.1
"""Share of half the mirror's length and width that loads keep from its borders."""

_NEGLIGIBLE = 1e-3
"""Products smaller than that share of the first are left out."""

_MOST_POISSON = 0.4999
"""Rubber nearer to incompressible is taken as this."""

_VERSION = 1
"""Of the files: to be raised when anything here changes what they hold."""

_ROUND_MM, _ROUND_DEG = 0.5, 0.5
"""Prisms that differ by less are one: it changes what is added by a hundredth."""


@dataclass(frozen=True, eq=False)
class BodyKernel:
    """The products: coefficients of Chebyshev polynomials.

    of_places: (products, y, x), 1/mm, scaled to the mirror, 0 <= x <= length and |y| <= half width. of_loads:
    (products, y, x), scaled to `load_box_mm`. left: root mean square of what the faces' supports do not
    allow, relative to what of it a half-space does.
    """

    length_mm: float
    half_width_mm: float
    of_places: Float = field(repr=False)
    of_loads: Float = field(repr=False)
    left: float = 0.0

    @property
    def place_box_mm(self) -> Float:
        """(2, 2) from and to of places, of x and of y."""
        return np.array([[0.0, self.length_mm], [-self.half_width_mm, self.half_width_mm]])

    @property
    def load_box_mm(self) -> Float:
        """(2, 2) from and to of loads, of x and of y."""
        half, wide = 0.5 * self.length_mm * (1 - _INSET), self.half_width_mm * (1 - _INSET)
        middle = 0.5 * self.length_mm
        return np.array([[middle - half, middle + half], [-wide, wide]])

    def products(self, x_mm: Float, y_mm: Float) -> Float:
        """(3, products, ...) u_i at places, 1/mm, and their slopes along x and y, 1/mm^2; 0 slope beyond."""
        shape = np.shape(x_mm)
        out = _series(self.of_places, self.place_box_mm, np.ravel(x_mm), np.ravel(y_mm))
        return out.reshape(3, -1, *shape)

    def slopes(self, places_mm: Float, load_mm: Float) -> Float:
        """(n, 2) slopes, 1/mm^2, that the body adds per q at places (n, 2) by a load at (2,)."""
        by_load = _series(self.of_loads, self.load_box_mm, *load_mm[:, None])[0][:, 0]
        whole = np.einsum("i,iba->ba", by_load, self.of_places)
        return np.asarray(_series(whole[None], self.place_box_mm, *places_mm.T)[1:, 0].T)

    def by_loads(self, loads_mm: Float) -> Float:
        """(products, m) v_i at loads (2, m)."""
        return np.asarray(_series(self.of_loads, self.load_box_mm, *loads_mm)[0])

    def added(self, places_mm: Float, loads_mm: Float) -> Float:
        """(places, loads) 1/mm that the body adds per q at places (2, n) by loads at (2, m)."""
        return np.asarray(self.products(*places_mm)[0].T @ self.by_loads(loads_mm))


def _series(coefficients: Float, box: Float, x: Float, y: Float) -> Float:
    """(3, products, n) values and slopes of two-dimensional series; beyond the box as at its border."""
    out = np.empty((3, len(coefficients), len(x)))
    at, by, inside = [], [], []
    for (low, high), value, count in zip(box, (x, y), coefficients.shape[:0:-1], strict=True):
        t = (2 * value - low - high) / (high - low)
        inside.append(np.abs(t) <= 1)
        t = np.clip(t, -1, 1)
        at.append(chebyshev.chebvander(t, count - 1))
        slope = chebyshev.chebder(np.eye(count), axis=0)
        by.append(chebyshev.chebvander(t, max(count - 2, 0)) @ slope * (2 / (high - low)))
    for k, (along, across, kept) in enumerate(
        ((at[0], at[1], 1.0), (by[0], at[1], inside[0]), (at[0], by[1], inside[1]))
    ):
        basis = (across[:, :, None] * along[:, None, :]).reshape(len(x), -1)
        out[k] = coefficients.reshape(len(coefficients), -1) @ basis.T * kept
    return out


def body_of(rig: Rig) -> BodyKernel | None:
    """That of a rig that says what holds its prism's faces; None for others."""
    supports = rig.rubber.support
    if not isinstance(supports, FaceSupports):
        return None
    shape = PrismGeometry(rig.prism)
    angles = (_rounded(np.degrees(a), _ROUND_DEG) for a in (shape.pattern_angle_rad, shape.camera_angle_rad))
    sizes = (_rounded(size, _ROUND_MM) for size in (shape.length_mm, shape.half_width_mm))
    return _kernel(*sizes, *angles, supports, min(rig.rubber.poisson, _MOST_POISSON))


def _rounded(value: float, step: float) -> float:
    return step * round(float(value) / step)


@lru_cache(8)
def _kernel(
    length_mm: float,
    half_width_mm: float,
    pattern_deg: float,
    camera_deg: float,
    supports: FaceSupports,
    poisson: float,
) -> BodyKernel:
    """Worked out in some seconds of processor time, and kept for the next time."""
    depends_on = {
        "version": _VERSION, "shape": [length_mm, half_width_mm, pattern_deg, camera_deg],
        "supports": supports.model_dump(), "poisson": poisson,
    }  # fmt: skip

    def made() -> dict[str, Float]:
        faces = faces_of(length_mm, np.radians(pattern_deg), np.radians(camera_deg), half_width_mm, supports)
        places, to_places = _lattice(_PLACES, length_mm, half_width_mm, 0.0)
        loads, to_loads = _lattice(_LOADS, length_mm, half_width_mm, _INSET)
        response, left = mirror_response(faces, poisson, loads, places)
        u, size, v = np.linalg.svd(response * np.pi / (1 - poisson**2), full_matrices=False)
        kept = size > _NEGLIGIBLE * size[0]
        of_places = _coefficients((u * size).T[kept], *to_places)
        return {"of_places": of_places, "of_loads": _coefficients(v[kept], *to_loads), "left": np.array(left)}

    found = kept_arrays("body", depends_on, made)
    return BodyKernel(length_mm, half_width_mm, found["of_places"], found["of_loads"], float(found["left"]))


def _coefficients(values: Float, along: Float, across: Float) -> Float:
    """(n, y, x) of values (n, y x) at the points."""
    whole = values.reshape(len(values), len(across), len(along))
    # in one order, as what is compiled for another is compiled again
    return np.ascontiguousarray(np.einsum("bq,nqp,ap->nba", across, whole, along, optimize=True))


def _lattice(
    counts: tuple[int, int], length_mm: float, half_width_mm: float, inset: float
) -> tuple[Float, tuple[Float, Float]]:
    """(2, n) points on the mirror, and the inverse of the polynomials' values there, along x and along y."""
    points = [chebyshev.chebpts1(count) for count in counts]
    x = 0.5 * length_mm * (1 + (1 - inset) * points[0])
    y = half_width_mm * (1 - inset) * points[1]
    along, across = (np.asarray(np.linalg.inv(chebyshev.chebvander(at, len(at) - 1))) for at in points)
    return np.stack([each.ravel() for each in np.meshgrid(x, y)]), (along, across)
