"""The bench's rays without the prism's borders: what a fit may follow while it moves them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Lost, Optics
from zeromethod.optics.mirror import distance_to
from zeromethod.optics.prism import Face, PrismGeometry
from zeromethod.optics.saw_rays import seams
from zeromethod.optics.teeth import Saw, Teeth
from zeromethod.rig.model import Prism, Rig

_STEP_PX = 0.5


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


class _OpenSaw(Saw):
    """A saw whose rays each enter and leave by a tooth of their own, whatever its borders."""

    def __init__(self, spec: Prism, entry: Teeth, leaving: Teeth) -> None:
        super().__init__(spec)
        self._entry, self._leaving = entry, leaving

    def enter(self, origin: Float, direction: Float, index: float) -> tuple[Float, Float, Teeth]:
        """By the plane of each ray's tooth."""
        return *self.entered(origin, direction, index, self._entry), self._entry

    def exit_tooth(self, point: Float, outgoing: Float) -> tuple[Teeth, Mask]:  # noqa: ARG002
        """Each ray's own."""
        return self._leaving, np.ones(self._leaving.shape, bool)


class UnboundedOptics(Optics):
    """Rays of a rig that no border cuts off, so that what they meet changes smoothly with the rig.

    teeth: of a saw, those by which each ray enters and leaves; without, the rig's own.

    Rays that meet the mirror's plane before the camera face (x beyond R0) are followed backwards, which
    is needed for an edge seen a little off its place.
    """

    def __init__(self, rig: Rig, teeth: tuple[Teeth, Teeth] | None = None) -> None:
        super().__init__(rig)
        self.prism = _OpenPrism(rig.prism)
        if teeth is not None:
            self.saw = _OpenSaw(rig.prism, *teeth)


def mirror_point(optics: Optics, u: Float, v: Float) -> Float:
    """Points (..., 2), x and y in mm, at which camera pixels u, v (...) look on the mirror at rest."""
    origin, direction = optics.rubber_rays(u, v)
    return origin[..., :2] + distance_to(optics.rest, origin, direction)[..., None] * direction[..., :2]


def tooth_phase(rig: Rig, u: Float, v: Float) -> tuple[Float, Float]:
    """Distance (...), px along u, of pixels from the nearest tip's image, and the px from tip to tip.

    Seams that the camera sees are the tips' images, whatever the rubber is.
    """
    optics = Optics(rig)
    assert optics.saw is not None
    tips = np.array([face.edge + face.length_mm * face.along for face in optics.saw.camera])
    height_mm = float(tips[:, 2].mean())
    origin, direction = optics.camera_rays(np.stack([u, u + _STEP_PX, u - _STEP_PX]), v)
    way = (height_mm - origin[..., 2]) / direction[..., 2]
    x, ahead, back = origin[..., 0] + way * direction[..., 0]
    per_px = (ahead - back) / (2.0 * _STEP_PX)
    # a tip that stands out is met elsewhere by an oblique ray
    slant = direction[0, ..., 0] / direction[0, ..., 2]
    away = x[..., None] + slant[..., None] * (tips[:, 2] - height_mm) - tips[:, 0]
    nearest = np.take_along_axis(away, np.abs(away).argmin(axis=-1)[..., None], axis=-1)[..., 0]
    pitch_mm = optics.length_mm / len(tips)
    return nearest / per_px, np.abs(pitch_mm / per_px)


def teeth_seen(rig: Rig) -> set[int]:
    """Teeth of a saw by which rays of the view enter or leave at rest."""
    optics = Optics(rig)
    u, v = np.meshgrid(np.arange(rig.camera.columns), np.array([0.0, 0.5, 1.0]) * (rig.camera.rows - 1))
    lost, *teeth = seams(optics, u, v)
    return set(np.unique(np.stack(teeth)[:, (lost == Lost.NONE) | (lost == Lost.SEAM)]).tolist())
