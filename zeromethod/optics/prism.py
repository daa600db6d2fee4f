"""The prism: its faces as bounded planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.optics.vectors import dot
from zeromethod.rig.model import Prism


@dataclass(frozen=True)
class Face:
    """A rectangle from an edge on the mirror to the apex.

    Convention: `edge` (3,) is the point at y = 0 where the face meets the mirror, `along` (3,) the unit
    vector from there to the apex, `normal` (3,) the unit normal out of the rubber. Lengths in mm. Or a face
    per ray: all arrays with the rays' shape in front (`at`).
    """

    edge: Float
    along: Float
    normal: Float
    length_mm: float | Float
    half_width_mm: float

    @property
    def end_mm(self) -> Float:
        """(3,) point at y = 0 where the face ends, away from its edge."""
        return self.edge + self.length_mm * self.along

    @classmethod
    def stacked(cls, faces: Sequence[Face]) -> Face:
        """Faces of equal width as one, arrays with as many rows."""
        names = "edge", "along", "normal", "length_mm"
        arrays = {name: np.array([getattr(face, name) for face in faces]) for name in names}
        return cls(**arrays, half_width_mm=faces[0].half_width_mm)

    def at(self, index: NDArray[np.intp]) -> Face:
        """The face per ray, (...), out of stacked ones."""
        assert isinstance(self.length_mm, np.ndarray)
        edge, along, normal = self.edge[index], self.along[index], self.normal[index]
        return Face(edge, along, normal, self.length_mm[index], self.half_width_mm)

    def moved(self, by_mm: Float) -> Face:
        """The face shifted by (3,)."""
        return replace(self, edge=self.edge + by_mm)

    def depth_below(self, point: Float) -> Float:
        """Distance (...) in mm of points (..., 3) from the face, positive on the rubber's side."""
        return -dot(point - self.edge, self.normal)

    def contains(self, point: Float) -> Mask:
        """Whether points (..., 3) of the face's plane lie on the face, borders included; NaN does not."""
        offset = dot(point - self.edge, self.along)
        inside = (offset >= 0.0) & (offset <= self.length_mm)
        return np.asarray(inside & (np.abs(point[..., 1]) <= self.half_width_mm))


@dataclass(frozen=True)
class PrismGeometry:
    """The triangle P0, R0, apex of a rig's prism.

    Convention: P0 = (0, 0, 0), R0 = (L0, 0, 0), rubber at z < 0; angles to the mirror in radians. Of a saw
    both faces are the plane that its teeth stand on, parallel to the mirror (`teeth.Saw` has the teeth's
    own).
    """

    spec: Prism

    @cached_property
    def pattern_angle_rad(self) -> float:
        """Angle alpha0 of the pattern face, at P0."""
        return float(np.radians(self.spec.pattern_angle_deg))

    @cached_property
    def camera_angle_rad(self) -> float:
        """Angle beta0 of the camera face, at R0."""
        return float(np.radians(self.spec.camera_angle_deg))

    @cached_property
    def length_mm(self) -> float:
        """Length L0 of the mirror, P0 to R0 (law of sines where the leg is given)."""
        if self.spec.pattern_length_mm is None:
            assert self.spec.mirror_length_mm is not None
            return self.spec.mirror_length_mm
        apex = np.sin(self.pattern_angle_rad + self.camera_angle_rad)
        return float(self.spec.pattern_length_mm * apex / np.sin(self.camera_angle_rad))

    @property
    def half_width_mm(self) -> float:
        """Half the prism's extent along y."""
        return self.spec.width_mm / 2

    @cached_property
    def pattern_face(self) -> Face:
        """Face towards the LCD, from P0 to the apex."""
        if self.spec.teeth is not None:
            return self._under
        return self._face(0.0, 1.0, self.pattern_angle_rad, self.camera_angle_rad)

    @cached_property
    def camera_face(self) -> Face:
        """Face towards the camera, from R0 to the apex."""
        if self.spec.teeth is not None:
            return self._under
        return self._face(self.length_mm, -1.0, self.camera_angle_rad, self.pattern_angle_rad)

    @cached_property
    def thickness_mm(self) -> float:
        """From the mirror to the apex, or to the tips of a saw's teeth."""
        teeth = self.spec.teeth
        count, base_mm = (1, 0.0) if teeth is None else (teeth.count, teeth.base_mm)
        pattern, camera = np.tan([self.pattern_angle_rad, self.camera_angle_rad])
        return float(base_mm + self.length_mm / count * pattern * camera / (pattern + camera))

    @cached_property
    def _under(self) -> Face:
        """The plane on which a saw's teeth stand."""
        edge = np.array([0.0, 0.0, -self.thickness_mm])
        along, normal = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0])
        return Face(edge, along, normal, self.length_mm, self.half_width_mm)

    def _face(self, edge_x_mm: float, sense: float, angle: float, other: float) -> Face:
        """Face from (edge_x_mm, 0, 0) on, at an angle (rad) to the mirror, the other face's being `other`."""
        cosine, sine = np.cos(angle), np.sin(angle)
        return Face(
            edge=np.array([edge_x_mm, 0.0, 0.0]),
            along=np.array([sense * cosine, 0.0, -sine]),
            normal=np.array([-sense * sine, 0.0, -cosine]),
            length_mm=float(self.length_mm * np.sin(other) / np.sin(angle + other)),
            half_width_mm=self.half_width_mm,
        )

    @property
    def apex_mm(self) -> Float:
        """(3,) point at y = 0 where the two faces meet."""
        return self.pattern_face.end_mm

    def on_mirror(self, x: Float, y: Float) -> Mask:
        """Whether (x, y) in mm lie on the mirror, borders included; NaN does not."""
        return np.asarray((x >= 0.0) & (x <= self.length_mm) & (np.abs(y) <= self.half_width_mm))
