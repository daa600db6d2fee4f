"""What a rig's prism adds to a half-space's answer: once per shape and supports, kept as a smooth kernel.

displacement(x, y) = that of a half-space + the sum over forces F at (x', y') of F C(x, y; x', y'). C is known
at Chebyshev points of the mirror for forces at Chebyshev points a little inside it, and a polynomial between.
Forces nearer to the mirror's borders count as at the nearest place inside.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import chebyshev

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.kept_arrays import kept_arrays
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.prism_tables import Prism
from zeromethod.rig.tables import FaceSupports
from zeromethod.simulation.elements.correction import mirror_response

if TYPE_CHECKING:
    from zeromethod.simulation.elements.elasticity import ElasticBody

CELLS, LINE_CELLS = 12, 8
"""Triangles along each side of the section, and cells along half the width."""
PLACES, FORCES = (22, 18), (18, 16)
"""Chebyshev points along x and y of where depth is known, and of forces; even along y."""
INSET = 0.1
"""Share of half the mirror's length and width that forces keep from its borders."""
MOST_POISSON = 0.4999
"""Rubber nearer to incompressible is taken as this."""
_VERSION = 1
"""Of the files: to be raised when anything here changes what they hold."""


def _values(at: Float, count: int) -> Float:
    """(n, count) values of the first Chebyshev polynomials."""
    return np.asarray(chebyshev.chebvander(at, count - 1), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class PrismKernel:
    """The correction for rubber of E = 1 MPa.

    length_mm, half_width_mm: the mirror spans 0 <= x <= length and |y| <= half width. coefficients: (places
    y, places x, forces y, forces x), of Chebyshev polynomials scaled to the mirror and to where forces are.
    """

    length_mm: float
    half_width_mm: float
    coefficients: Float = field(repr=False)

    def _polynomials(self, x: Float, y: Float, counts: tuple[int, int], inset: float) -> tuple[Float, Float]:
        """Values (n, counts) of the polynomials along x and along y; places beyond count as at the border."""
        u = np.clip((2 * np.asarray(x) / self.length_mm - 1) / (1 - inset), -1, 1)
        v = np.clip(np.asarray(y) / self.half_width_mm / (1 - inset), -1, 1)
        u, v = (_values(at, count) for at, count in zip((u, v), counts, strict=True))
        return u, v

    def of_forces(self, x: Float, y: Float, force_n: Float) -> Float:
        """(places y, places x) coefficients of the depth, mm, by forces (n,) at places (x, y), E = 1 MPa."""
        rows, cols = self.coefficients.shape[2:]
        along, across = self._polynomials(x, y, (cols, rows), INSET)
        moments = np.einsum("n,nb,na->ba", force_n, across, along, optimize=True)
        return np.asarray(np.tensordot(self.coefficients, moments, axes=2))

    def on_grid(self, depth: Float, x: Float, y: Float) -> Float:
        """(y, x) mm of what `of_forces` gave, on a lattice of x (cols,) and y (rows,)."""
        rows, cols = depth.shape
        along, across = self._polynomials(x, y, (cols, rows), 0.0)
        return np.asarray(across @ depth @ along.T)

    def between(self, places_mm: Float, forces_mm: Float) -> Float:
        """(places, forces) mm per N at places (2, n) by forces at places (2, m), E = 1 MPa."""
        rows, cols, force_rows, force_cols = self.coefficients.shape
        along, across = self._polynomials(places_mm[0], places_mm[1], (cols, rows), 0.0)
        by = self._polynomials(forces_mm[0], forces_mm[1], (force_cols, force_rows), INSET)
        left = np.einsum("nb,na->nba", across, along).reshape(places_mm.shape[1], -1)
        right = np.einsum("nb,na->nba", by[1], by[0]).reshape(forces_mm.shape[1], -1)
        return np.asarray(left @ self.coefficients.reshape(rows * cols, -1) @ right.T)


@dataclass(frozen=True)
class HeldPrism:
    """All that the kernel depends on.

    refined: times as many elements along every side.
    """

    length_mm: float
    pattern_rad: float
    camera_rad: float
    half_width_mm: float
    supports: FaceSupports
    poisson: float
    refined: float = 1.0

    @classmethod
    def of(cls, prism: Prism, supports: FaceSupports, poisson: float) -> HeldPrism:
        """That of a rig's prism, its mirror taken as flat."""
        shape = PrismGeometry(prism)
        return cls(
            shape.length_mm, shape.pattern_angle_rad, shape.camera_angle_rad, shape.half_width_mm,
            supports, min(poisson, MOST_POISSON),
        )  # fmt: skip

    @cached_property
    def body(self) -> ElasticBody:
        """The prism in elements, E = 1 MPa. Raises InputError without the library of elements."""
        try:
            from zeromethod.simulation.elements.elasticity import ElasticBody, line_mesh  # noqa: PLC0415
            from zeromethod.simulation.elements.section import prism_section  # noqa: PLC0415 - loads slowly
        except ImportError as error:
            allowed = "per face only with finite elements: pip install 'zeromethod[elements]'"
            raise InputError(f"rubber.support: {allowed}") from error

        faces = self.supports.pattern, self.supports.camera
        cells = round(CELLS * self.refined)
        section = prism_section(self.length_mm, self.pattern_rad, self.camera_rad, faces, cells)
        line = line_mesh(self.half_width_mm, round(LINE_CELLS * self.refined))
        return ElasticBody(section, line, self.supports.ends, 1 / (2 * (1 + self.poisson)), self.poisson)

    def kernel(self) -> PrismKernel:
        """Worked out: some half a minute of processor time."""
        x, y = self._points(PLACES, 0.0)
        at_x, at_y = self._points(FORCES, INSET)
        upper = at_y[at_y > 0]
        places = np.stack([each.ravel() for each in np.meshgrid(x, y)])
        forces = np.stack([each.ravel() for each in np.meshgrid(at_x, upper)])
        found = mirror_response(self.body, forces, places)
        known = found.reshape(len(y), len(x), len(upper), len(at_x))
        # the body is symmetric about y = 0
        whole = np.concatenate((known[::-1, :, ::-1], known), axis=2)
        for axis, count in enumerate(whole.shape):
            inverse = np.linalg.inv(chebyshev.chebvander(chebyshev.chebpts1(count), count - 1))
            whole = np.moveaxis(np.tensordot(inverse, whole, axes=(1, axis)), 0, axis)
        return PrismKernel(self.length_mm, self.half_width_mm, whole)

    def _points(self, counts: tuple[int, int], inset: float) -> tuple[Float, Float]:
        half, wide = self.length_mm / 2, self.half_width_mm * (1 - inset)
        reach = half * (1 - inset)
        return half + reach * chebyshev.chebpts1(counts[0]), wide * chebyshev.chebpts1(counts[1])

    @property
    def depends_on(self) -> dict[str, Any]:
        """All that the kernel depends on, as JSON can have it."""
        return {
            "version": _VERSION, "sizes": [CELLS, LINE_CELLS, PLACES, FORCES, INSET],
            "shape": [
                round(float(one), 9)
                for one in (self.length_mm, self.pattern_rad, self.camera_rad, self.half_width_mm)
            ],
            "supports": self.supports.model_dump(), "poisson": self.poisson, "refined": self.refined,
        }  # fmt: skip


@lru_cache(4)
def prism_kernel(prism: HeldPrism) -> PrismKernel:
    """The kernel, kept for the next time."""
    made = kept_arrays("prism", prism.depends_on, lambda: {"coefficients": prism.kernel().coefficients})
    return PrismKernel(prism.length_mm, prism.half_width_mm, made["coefficients"])
