"""The bench's rays without the prism's borders: what a fit may follow while it moves them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Optics
from zeromethod.optics.mirror import distance_to
from zeromethod.optics.prism import Face, PrismGeometry
from zeromethod.rig.model import Rig


class _OpenFace(Face):
    """A face without borders."""

    def contains(self, point: Float) -> Mask:
        """Whether there is a point at all."""
        return np.asarray(np.isfinite(point).all(axis=-1))


class _OpenPrism(PrismGeometry):
    """A prism whose faces and mirror go on beyond their edges."""

    @cached_property
    def pattern_face(self) -> Face:
        """Face towards the LCD, unbounded."""
        return _opened(PrismGeometry(self.spec).pattern_face)

    @cached_property
    def camera_face(self) -> Face:
        """Face towards the camera, unbounded."""
        return _opened(PrismGeometry(self.spec).camera_face)

    def on_mirror(self, x: Float, y: Float) -> Mask:
        """Whether there is a point at all."""
        return np.asarray(np.isfinite(x) & np.isfinite(y))


def _opened(face: Face) -> Face:
    return _OpenFace(face.edge, face.along, face.normal, face.length_mm, face.half_width_mm)


class UnboundedOptics(Optics):
    """Rays of a rig that no border cuts off, so that what they meet changes smoothly with the rig.

    Rays that meet the mirror's plane before the camera face (x beyond R0) are followed backwards, which
    is needed for an edge seen a little off its place.
    """

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig)
        self.prism = _OpenPrism(rig.prism)


def mirror_point(optics: Optics, u: Float, v: Float) -> Float:
    """Points (..., 2), x and y in mm, at which camera pixels u, v (...) look on the mirror at rest."""
    origin, direction = optics.rubber_rays(u, v)
    return origin[..., :2] + distance_to(optics.rest, origin, direction)[..., None] * direction[..., :2]
