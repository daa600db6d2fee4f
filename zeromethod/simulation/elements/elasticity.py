"""Linear elasticity of a body with one section all along y, in finite elements that do not lock.

Displacements and a pressure are products of functions of the section and of y (Taylor-Hood in both), so the
body's matrices are Kronecker products of those of a plane mesh and of a line. The body is symmetric about
y = 0: fields even and odd in y (of the displacements along x and w; that along y is of the other kind) are
solved apart, each on the half y > 0.

Convention: components are ordered x, w (into the rubber), y; fields are (3, section, line, ...) arrays of
values at the nodes. Source: Boffi, Brezzi & Fortin 2013, Mixed Finite Element Methods, 8.8,
doi:10.1007/978-3-642-36519-5.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu
from skfem import (
    Basis,
    BilinearForm,
    ElementLineP1,
    ElementLineP2,
    ElementTriP1,
    ElementTriP2,
    FacetBasis,
    MeshLine,
)

from zeromethod.arrays import Float, Mask
from zeromethod.rig.tables import Support
from zeromethod.simulation.elements.section import Section, SectionFace

_LINE_GRADING = 1.4
_ORDER = 4
"""Of the polynomials that are integrated exactly."""


@BilinearForm
def _mass(u: Any, v: Any, _: Any) -> Any:
    return u * v


def _gradients(one: int, other: int) -> BilinearForm:
    """Products of d v / d one and d u / d other."""
    return BilinearForm(lambda u, v, _: v.grad[one] * u.grad[other])


def _gradient(axis: int) -> BilinearForm:
    """Products of v and d u / d axis."""
    return BilinearForm(lambda u, v, _: v * u.grad[axis])


def line_mesh(half_width_mm: float, cells: int) -> MeshLine:
    """Cells from y = 0 to the end, smaller towards the end."""
    return MeshLine(half_width_mm * (1 - (1 - np.linspace(0, 1, cells + 1)) ** _LINE_GRADING))


@dataclass(frozen=True)
class ElasticBody:
    """A body under loads and given displacements.

    ends: what holds the faces across y. Raises ValueError where nothing keeps the body from moving.
    """

    section: Section
    line: MeshLine
    ends: Support
    shear_mpa: float
    poisson: float

    def __post_init__(self) -> None:
        held = [face.support for face in self.section.faces]
        if "bonded" not in (*held, self.ends) and held.count("sliding") < 2:
            raise ValueError("nothing keeps the body from moving")

    @cached_property
    def plane(self) -> Basis:
        """Displacements' functions of the section."""
        return Basis(self.section.mesh, ElementTriP2(), intorder=_ORDER)

    @cached_property
    def along(self) -> Basis:
        """Displacements' functions of y."""
        return Basis(self.line, ElementLineP2(), intorder=_ORDER)

    @cached_property
    def nodes(self) -> tuple[Float, Float, Float]:
        """(x, w) of the section's nodes, each (section,), and y of the line's, mm."""
        return self.plane.doflocs[0], self.plane.doflocs[1], self.along.doflocs[0]

    @cached_property
    def end(self) -> int:
        """Index of the line's node at the end."""
        return int(np.argmax(self.nodes[2]))

    def on(self, face: SectionFace) -> Mask:
        """(section,) nodes on a face."""
        return np.asarray(face.touches(self.plane.doflocs))

    def face_load(self, face: SectionFace, traction: Float) -> Float:
        """Load of tractions (3, section, line, n) MPa on a face."""
        facets = self.section.mesh.facets_satisfying(face.touches)
        rim = _mass.assemble(FacetBasis(self.section.mesh, self.plane.elem, facets=facets, intorder=_ORDER))
        by = rim.toarray(), self._line_mass.toarray()
        return np.asarray(np.einsum("sa,caln,lm->csmn", by[0], traction, by[1], optimize=True))

    def end_load(self, traction: Float) -> Float:
        """Load of tractions (3, section, n) MPa on the end: (3, section, line, n)."""
        load = np.zeros((*traction.shape[:2], len(self.nodes[2]), traction.shape[2]))
        mass = self._plane_mass
        for axis in range(3):
            load[axis, :, self.end] = mass @ traction[axis]
        return load

    @cached_property
    def _plane_mass(self) -> sp.csr_matrix:
        return _mass.assemble(self.plane)

    @cached_property
    def _line_mass(self) -> sp.csr_matrix:
        return _mass.assemble(self.along)

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """Of displacements (3, section, line) and pressures, both raveled; symmetric."""
        plane, along = self.plane, self.along
        pressure = plane.with_element(ElementTriP1()), along.with_element(ElementLineP1())
        m, k, d = self._line_mass, _gradients(0, 0).assemble(along), _gradient(0).assemble(along)
        mass, slope = self._plane_mass, [_gradient(axis).assemble(plane) for axis in range(2)]
        stiff: list[list[Any]] = [[None] * 3 for _ in range(3)]  # d v / d row x d u / d column
        for one in range(2):
            for other in range(2):
                stiff[one][other] = sp.kron(_gradients(one, other).assemble(plane), m)
            stiff[one][2] = sp.kron(slope[one].T, d)
            stiff[2][one] = sp.kron(slope[one], d.T)
        stiff[2][2] = sp.kron(mass, k)
        whole = stiff[0][0] + stiff[1][1] + stiff[2][2]
        blocks = [
            [self.shear_mpa * (stiff[u][v] + (whole if u == v else 0)) for u in range(3)] for v in range(3)
        ]
        across = _mass.assemble(along, pressure[1])
        widen = [sp.kron(_gradient(axis).assemble(plane, pressure[0]), across) for axis in range(2)]
        widen.append(sp.kron(_mass.assemble(plane, pressure[0]), _gradient(0).assemble(along, pressure[1])))
        bulk = 2 * self.shear_mpa * self.poisson / (1 - 2 * self.poisson)
        soft = sp.kron(_mass.assemble(pressure[0]), _mass.assemble(pressure[1])) / bulk
        for axis in range(3):
            blocks[axis].append(-widen[axis].T)
        blocks.append([-each for each in widen] + [-soft])
        return sp.csr_matrix(sp.block_array(blocks))

    @cached_property
    def _turn(self) -> sp.csr_matrix:
        """From components along (normal, across it, y) on sliding faces to x, w, y; elsewhere as they are."""
        cos, sin = np.ones(len(self.nodes[0])), np.zeros(len(self.nodes[0]))
        for face in self.section.faces:
            if face.support == "sliding":
                cos[self.on(face)], sin[self.on(face)] = face.normal
        eye, c, s = sp.eye_array(len(self.nodes[2])), sp.diags_array(cos), sp.diags_array(sin)
        turn = sp.block_array([[sp.kron(c, eye), sp.kron(-s, eye)], [sp.kron(s, eye), sp.kron(c, eye)]])
        rest = sp.eye_array(self.matrix.shape[0] - turn.shape[0])
        return sp.csr_matrix(sp.block_diag((turn, rest)))

    def fixed(self, *, even: bool) -> Mask:
        """(3, section, line) components, on sliding faces along (normal, across it, y), that are given."""
        shape = len(self.nodes[0]), len(self.nodes[2])
        fixed = np.zeros((3, *shape), dtype=bool)
        start = int(np.argmin(self.nodes[2]))
        fixed[2 if even else slice(0, 2), :, start] = True
        slid = np.zeros(shape[0], dtype=int)
        for face in self.section.faces:
            on = self.on(face)
            if face.support == "bonded":
                fixed[:, on] = True
            elif face.support == "sliding":
                fixed[0, on] = True
                slid += on
        fixed[:2, slid == 2] = True
        if self.ends == "bonded":
            fixed[:, :, self.end] = True
        elif self.ends == "sliding":
            fixed[2, :, self.end] = True
        if not even and not fixed[2].any():
            # free to move along y, which loads that are odd in y do not do
            fixed[2, 0, start] = True
        return fixed

    def solve(self, given: Float, load: Float, *, even: bool) -> Float:
        """Displacements (3, section, line, n) mm under loads, those that are fixed as `given` (x, w, y).

        given, load: (3, section, line, n); even or odd in y as `even` says.
        """
        turn, factor, free, matrix = self._factored(even=even)
        size = int(np.prod(given.shape[:3]))
        unknown = np.zeros((matrix.shape[0], given.shape[3]))
        unknown[:size] = given.reshape(size, -1)
        unknown = turn.T @ unknown
        unknown[free] = 0.0
        right = np.zeros_like(unknown)
        right[:size] = load.reshape(size, -1)
        right = (turn.T @ right - matrix @ unknown)[free]
        inner = matrix[free][:, free]
        found = factor.solve(right)
        found += factor.solve(right - inner @ found)  # what the factors' rounding left
        unknown[free] = found
        return np.asarray((turn @ unknown)[:size].reshape(given.shape))

    def _factored(self, *, even: bool) -> tuple[sp.csr_matrix, SuperLU, Mask, sp.csr_matrix]:
        turn = self._turn
        matrix = sp.csr_matrix(turn.T @ self.matrix @ turn)
        free = np.ones(matrix.shape[0], dtype=bool)
        fixed = self.fixed(even=even).ravel()
        free[: len(fixed)] = ~fixed
        # positive for displacements, negative for pressures: factors in any order without exchanging rows
        factor = splu(
            sp.csc_matrix(matrix[free][:, free]), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
        return turn, factor, free, matrix
