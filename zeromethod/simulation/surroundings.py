"""Light that reaches the camera from around the prism: the room, lamps on the mains, the sun, a ring light.

It comes by the faces' reflections and through the mirror, never straight through total reflection. A ray
followed from a pixel meets the camera face, which reflects a little of what is around the camera; then the
mirror, which lets through what it does not reflect; then the pattern face and the LCD's glass, which send a
little back by the mirror a second time, and out to the camera's side. An object that touches takes all
light at that place, from both sides, and is itself lit through the camera face.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
from scipy.special import ndtr

from zeromethod.arrays import Float, Single
from zeromethod.optics import Dented, HeightField, Optics, reflect
from zeromethod.optics.layers import through_slabs
from zeromethod.optics.prism import Face
from zeromethod.optics.vectors import dot
from zeromethod.rig.model import LightSpec, Rig
from zeromethod.simulation.nuisances import swing
from zeromethod.simulation.press import Mirror

GLASS_INDEX = 1.5
"""Of the LCD's cover glass, or of what a print is covered with."""

EVERY_PX = 4
"""Pixels between rays where nothing touches: all but the ring's edge is smooth there, and that is drawn
between them."""

CLOUDED = 0.2
SUN_PER_MINUTE = 0.1


class Seen(NamedTuple):
    """(rows, cols) each: light over the luminance of the room, and of the ring."""

    room: Single
    ring: Single


def interface_share(indices: Sequence[float]) -> float:
    """Light that a stack of interfaces sends back near its normal, each once."""
    return sum(((a - b) / (a + b)) ** 2 for a, b in pairwise(indices))


def sent_back_share(rig: Rig) -> float:
    """Light that pattern face, layers and the LCD's glass send back near their normal."""
    return interface_share([rig.prism.index, *(one.index for one in rig.pattern_layers), GLASS_INDEX])


def room_level(light: LightSpec, from_ns: int, to_ns: int) -> float:
    """Mean luminance of the surroundings in an exposure, over the white LCD's."""
    time_s = 0.5e-9 * (from_ns + to_ns)
    cloud = 0.5 * (1 - math.cos(2 * math.pi * time_s / light.cloud_s))
    sun = light.sun * (1 + SUN_PER_MINUTE * time_s / 60) * (1 - (1 - CLOUDED) * cloud)
    return light.room + light.mains * swing(light.mains_hz, from_ns, to_ns) + sun


class Surroundings:
    """What a rig's simulated camera sees of `[light]` besides the pattern; nothing where nothing is lit."""

    def __init__(self, rig: Rig) -> None:
        self._light, self._camera = rig.light, rig.camera
        light = rig.light
        self._any = bool(light.room or light.mains or light.sun or light.ring)
        self.move(rig)

    def move(self, rig: Rig) -> None:
        """Have the bench as `rig` has it."""
        if not self._any:
            return
        self._optics = Optics(rig)
        rubber = rig.prism.index
        outer = [1.0, *(one.index for one in reversed(rig.camera_layers)), rubber]
        self._front, self._back = interface_share(outer), sent_back_share(rig)
        # as much light reaches an object through this face as the LCD's through the other
        self._on_object = float(np.cos(np.radians(rig.prism.camera_angle_deg)) / rubber**2)
        self._seen = lru_cache(3)(self.seen)

    def on(self, light: Single, mirror: Mirror, from_ns: int, to_ns: int) -> Single:
        """The light (rows, cols) of an exposure with that of the surroundings."""
        if not self._any:
            return light
        seen = self._seen(mirror)
        level = np.float32(room_level(self._light, from_ns, to_ns))
        total: Single = light + level * seen.room + np.float32(self._light.ring) * seen.ring
        return total

    def seen(self, mirror: Mirror) -> Seen:
        """What each pixel sees of room and ring by a mirror."""
        optics, camera = self._optics, self._camera
        touched = bool(mirror.touches or mirror.cloth) or any(dent.touches for dent in mirror.dents)
        every = 1 if touched else EVERY_PX
        v, u = (np.arange(0, n + every - 1, every, dtype=np.float64) for n in (camera.rows, camera.columns))
        columns, lines = np.meshgrid(u, v)
        surface = Dented(optics.rest, mirror) if mirror.dents else optics.rest
        origin, direction = optics.rubber_rays(columns, lines)
        point, passed, kept, scattered = self._meet(origin, direction, surface, mirror)
        back, direction = self._off_pattern(point[0], point[1])
        again, passed2, kept2, _ = self._meet(back, direction, surface, mirror)
        by_mirror = kept * self._back
        room = self._front + passed + by_mirror * (passed2 + kept2) + self._on_object * scattered
        if not self._light.ring:
            return Seen(self._spread(room, every), np.zeros(1, np.float32))
        front = self._ring(self._off_front(columns, lines), every)
        behind = self._ring(self._out_to_camera(*again), every)
        share = self._spread(np.nan_to_num(by_mirror * kept2), every)
        ring: Single = np.float32(self._front) * front + share * behind
        return Seen(self._spread(room, every), ring)

    def _meet(
        self, origin: Float, direction: Float, surface: HeightField, mirror: Mirror
    ) -> tuple[tuple[Float, Float], Float, Float, Float]:
        """((point, direction) after the mirror, shares let through, reflected, and scattered by objects)."""
        optics = self._optics
        point, outgoing, cosine, reflectance = optics.reflected(origin, direction, surface)
        x, y = point[..., 0], point[..., 1]
        left, scattered = mirror.light(x, y, cosine, optics.rig.prism.index)
        on = optics.prism.on_mirror(x, y) & np.isfinite(reflectance)
        reflectance = np.where(on, reflectance, 0.0)
        passed = np.where(on, (1 - reflectance) * left, 0.0)
        return (point, outgoing), passed, reflectance * left, np.where(on, scattered, 0.0)

    def _off_pattern(self, point: Float, direction: Float) -> tuple[Float, Float]:
        """Rays sent back by the pattern face; the slabs behind it are taken to be thin."""
        face = self._optics.prism.pattern_face
        return at_face(face, point, direction), reflect(direction, face.normal)

    def _off_front(self, u: Float, v: Float) -> Float:
        """(..., 2) mm from the lens, in its plane, of what pixels see in the camera face's outer side."""
        origin, direction = self._optics.camera_rays(u, v)
        face = self._optics.prism.camera_face
        stack = sum(one.thickness_mm for one in self._optics.rig.camera_layers)
        away = (-face.depth_below(origin) - stack) / -dot(direction, face.normal)
        return self._in_lens_plane(origin + away[..., None] * direction, reflect(direction, face.normal))

    def _out_to_camera(self, point: Float, direction: Float) -> Float:
        """(..., 2) mm from the lens, in its plane, where rays from the mirror come to by the camera face."""
        optics, face = self._optics, self._optics.prism.camera_face
        slabs = [(one.index, one.thickness_mm) for one in optics.rig.camera_layers]
        with np.errstate(invalid="ignore", divide="ignore"):
            shift, outside = through_slabs(direction, face.normal, optics.rig.prism.index, slabs, 1.0)
        return self._in_lens_plane(at_face(face, point, direction) + shift, outside)

    def _in_lens_plane(self, point: Float, direction: Float) -> Float:
        camera = self._optics.camera
        with np.errstate(invalid="ignore", divide="ignore"):
            away = dot(camera.position - point, camera.axis) / dot(direction, camera.axis)
            offset = point + np.where(away > 0, away, np.nan)[..., None] * direction - camera.position
        return np.stack((offset @ camera.u_axis, offset @ camera.v_axis), axis=-1)

    def _ring(self, offset_mm: Float, every: int) -> Single:
        """(rows, cols) share of the ring in what pixels see, `offset_mm` from the lens; blurred by lens."""
        lost = ~np.isfinite(offset_mm[..., 0])
        x, y = (self._spread(np.where(lost, 0.0, offset_mm[..., k]), every) for k in (0, 1))
        per_px = np.sqrt(sum(step**2 for one in (x, y) for step in np.gradient(one)) / 2)
        soft = np.maximum(max(self._camera.psf_px, 0.3) * per_px, 1e-3)
        away, (inner, outer) = np.hypot(x, y), self._light.ring_mm
        ring = ndtr((outer - away) / soft) * ndtr((away - inner) / soft)
        ring[self._spread(lost, every) > 0] = 0.0  # nothing is known between what is seen and what is lost
        return np.asarray(ring, np.float32)

    def _spread(self, values: Float, every: int) -> Single:
        """Values of rays every so many pixels on all pixels (rows, cols)."""
        few = values.astype(np.float32)
        shape = self._camera.rows, self._camera.columns
        if every == 1:
            return few
        step = np.array([[1 / every, 0.0, 0.0], [0.0, 1 / every, 0.0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        border = cv2.BORDER_REPLICATE
        return np.asarray(cv2.warpAffine(few, step, shape[::-1], flags=flags, borderMode=border), np.float32)


def at_face(face: Face, point: Float, direction: Float) -> Float:
    """Where rays in the rubber meet a face from inside; NaN where they do not."""
    with np.errstate(invalid="ignore", divide="ignore"):
        met: Float = point + (face.depth_below(point) / dot(direction, face.normal))[..., None] * direction
    met[~face.contains(met)] = np.nan
    return met
