"""The section of a long body of rubber: a mesh of triangles, and its faces with what holds them.

Convention: (x, w) in mm, x along the mirror, w into the rubber; the mirror is the line w = 0 and always free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import MeshTri

from zeromethod.arrays import Float, Mask
from zeromethod.rig.tables import Support

_GRADING = 1.4
"""Power by which triangles grow away from the faces and edges of a prism."""
_NEAR = 1e-7
"""Distance from a face, relative to the section's size, at which a point lies on it."""


@dataclass(frozen=True)
class SectionFace:
    """A straight face but the mirror: two points (x, w), the outward normal, and what holds it."""

    start: tuple[float, float]
    end: tuple[float, float]
    normal: tuple[float, float]
    support: Support

    def touches(self, points: Float) -> Mask:
        """Whether points (2, n) lie on the face."""
        (x0, w0), (x1, w1) = self.start, self.end
        size = np.hypot(x1 - x0, w1 - w0)
        along = ((points[0] - x0) * (x1 - x0) + (points[1] - w0) * (w1 - w0)) / size**2
        away = np.abs((points[0] - x0) * self.normal[0] + (points[1] - w0) * self.normal[1])
        return np.asarray((away < _NEAR * size) & (along > -_NEAR) & (along < 1 + _NEAR))


@dataclass(frozen=True)
class Section:
    """Mesh and faces. mirror_mm: ends of the mirror along x."""

    mesh: MeshTri
    faces: tuple[SectionFace, ...]
    mirror_mm: tuple[float, float]


def prism_section(
    length_mm: float, pattern_rad: float, camera_rad: float, supports: tuple[Support, Support], cells: int
) -> Section:
    """Triangle P0, R0, apex; angles of pattern and camera face to the mirror, their supports in that order.

    cells: triangles along each side.
    """
    sin, cos = np.sin(pattern_rad), np.cos(pattern_rad)
    leg = length_mm * np.sin(camera_rad) / np.sin(pattern_rad + camera_rad)
    corners = np.array([[0.0, length_mm, leg * cos], [0.0, 0.0, leg * sin]])
    i, j = (index.ravel() for index in np.meshgrid(*(np.arange(cells + 1),) * 2, indexing="ij"))
    inside = i + j <= cells
    i, j = i[inside], j[inside]
    shares = np.stack((cells - i - j, i, j)) / cells
    shares = shares**_GRADING / (shares**_GRADING).sum(axis=0)
    number = {pair: n for n, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    upright = [(a, b) for a, b in number if a + b < cells]
    turned = [(a, b) for a, b in upright if a + b < cells - 1]
    triangles = [[number[a, b], number[a + 1, b], number[a, b + 1]] for a, b in upright]
    triangles += [[number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]] for a, b in turned]
    p0, r0, apex = ((float(x), float(w)) for x, w in corners.T)
    faces = (
        SectionFace(p0, apex, (-float(sin), float(cos)), supports[0]),
        SectionFace(r0, apex, (float(np.sin(camera_rad)), float(np.cos(camera_rad))), supports[1]),
    )
    return Section(MeshTri(corners @ shares, np.array(triangles).T), faces, (0.0, length_mm))
