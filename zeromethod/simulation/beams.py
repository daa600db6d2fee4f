"""The beams that reach a camera pixel: the main one and the ghosts, each as a map of the LCD."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics import Dented, HeightField, Optics, reflect
from zeromethod.optics.prism import Face
from zeromethod.rig.model import Prism, Rig
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.pupil import Pupil

MOST_FOCUS = 4.0
"""Most that the mirror makes a lamp's light denser: where it would be more the lamp's own size counts."""


@dataclass(frozen=True, slots=True)
class Beam:
    """One way of light from the LCD to every camera pixel.

    q: (rows, cols, 2) LCD px, NaN where it is lost; by_u, by_v: its change per camera pixel; gain:
    (rows, cols) share of the light that arrives, 0 where lost.
    """

    q: Float
    by_u: Float
    by_v: Float
    gain: Float

    @classmethod
    def of(cls, q: Float, gain: Float, spread: Float | None = None) -> Beam:
        """Beam whose footprints are the differences of `q`: central, one-sided next to what is lost.

        spread: (rows, cols, 3) second moments xx, xy, yy of what else spreads a pixel's light on the LCD, in
        units of those of the pixel's own response.
        """
        gain = np.where(np.isnan(q[..., 0]) | np.isnan(gain), 0.0, gain)
        by_u, by_v = _difference(q, axis=1), _difference(q, axis=0)
        if spread is not None:
            by_u, by_v = _widened(by_u, by_v, spread)
        return cls(q, by_u, by_v, gain)

    @property
    def seen_px2(self) -> Float:
        """(rows, cols) LCD px^2 that a pixel sees, 0 where the mirror focuses all light in a line."""
        by_u, by_v = self.by_u, self.by_v
        return np.asarray(np.abs(by_u[..., 0] * by_v[..., 1] - by_u[..., 1] * by_v[..., 0]))

    def lit_by_lamp(self, seen_px2: float) -> Beam:
        """The same where a lamp at the camera lights the pattern: that light came the same way.

        seen_px2: of a pixel at which the pattern is as bright as an LCD would be.
        """
        focused = np.minimum(seen_px2 / np.maximum(self.seen_px2, 1e-6), MOST_FOCUS)
        return replace(self, gain=self.gain**2 * np.where(self.gain > 0, focused, 0.0))


def _difference(q: Float, axis: int) -> Float:
    step = np.diff(q, axis=axis)
    edge = np.full_like(np.take(q, [0], axis=axis), np.nan)
    both = np.stack((np.concatenate((edge, step), axis=axis), np.concatenate((step, edge), axis=axis)))
    known = ~np.isnan(both)
    total: Float = np.where(known, both, 0.0).sum(axis=0)
    mean: Float = total / np.maximum(known.sum(axis=0), 1)
    return mean


class _Single(NamedTuple):
    """Rays through one point of the pupil: see `Beam`; scattered is without the share that is in view."""

    q: Float
    gain: Float
    scattered: Float
    point: Float


def scattered_view(prism: Prism) -> float:
    """Light, 1 = the LCD's mean, that a white object scatters into every direction.

    The LCD's light reaches the mirror from the cone of the critical angle about the pattern face's normal;
    the irradiance of a cone that holds the whole of it is pi cos(tilt) / n^2 times its radiance.
    """
    return float(np.cos(np.radians(prism.pattern_angle_deg)) / prism.index**2)


def _widened(by_u: Float, by_v: Float, spread: Float) -> tuple[Float, Float]:
    """Sides of a parallelogram whose second moments are those of the given one and `spread` together."""
    xx = by_u[..., 0] ** 2 + by_v[..., 0] ** 2 + spread[..., 0]
    xy = by_u[..., 0] * by_u[..., 1] + by_v[..., 0] * by_v[..., 1] + spread[..., 1]
    yy = by_u[..., 1] ** 2 + by_v[..., 1] ** 2 + spread[..., 2]
    wide = np.sqrt(np.maximum(xx, 1e-12))
    slant = xy / wide
    sides = (
        np.stack((wide, slant), axis=-1),
        np.stack((0 * wide, np.sqrt(np.maximum(yy - slant**2, 0))), axis=-1),
    )
    wider = np.any(spread != 0, axis=-1, keepdims=True)
    return np.where(wider, sides[0], by_u), np.where(wider, sides[1], by_v)


class Beams:
    """Rays of a rig for any mirror; what does not depend on the mirror is kept.

    Main beam: camera, camera face, mirror, pattern face, LCD. Ghost of the gap: between the LCD's glass
    and the near side of the last slab light is reflected to and fro. Ghost of the faces: light that is
    reflected inside at the camera face and at the pattern face, meeting the mirror three times.
    """

    def __init__(self, rig: Rig) -> None:
        self._optics = Optics(rig)
        self._spec = rig.simulation
        v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(np.float64)
        self._origin, self._direction = self._optics.rubber_rays(u, v)
        layers = rig.pattern_layers
        self._index = rig.prism.index
        self._gap_index = layers[-1].index if layers else rig.prism.index
        self._gap_mm = layers[-1].thickness_mm if layers else 0.0
        self._pitch_mm = rig.display.pitch_mm
        self._view = scattered_view(rig.prism)
        self._pupil = Pupil.of(rig)
        self._lamp_px2 = 0.0
        at_rest = self.all(Mirror())[0] if self._pupil is not None or rig.light.by_mirror else []
        self._at_rest = [beam.q for beam in at_rest]
        if rig.light.by_mirror:
            self._lamp_px2 = float(np.median(at_rest[0].seen_px2[at_rest[0].gain > 0]))

    def main(self, mirror: Mirror) -> tuple[Float, Float]:
        """(q (rows, cols, 2), gain (rows, cols)) of the main beam, the pupil's mean; NaN where lost."""
        single = self._single(mirror)
        if self._pupil is None or not mirror.dents:
            return single.q, single.gain
        return self._pupil.mean(single.q, single.gain, self._at_rest[0])[:2]

    def all(self, mirror: Mirror) -> tuple[list[Beam], Float | None]:
        """(every beam, the main one first, and the light that objects scatter or None where nothing touches).

        Ghosts' gains are their relative amplitude. Scattered light is (rows, cols), 1 = the LCD's mean.
        """
        single = self._single(mirror)
        ways: list[tuple[Float, Float]] = [(single.q, single.gain)]
        if self._spec.ghost_gap > 0:
            ways.append((self._across_gap(single.q, single.point), self._spec.ghost_gap * single.gain))
        if self._spec.ghost_faces > 0:
            q, gain = self._by_faces(mirror)
            ways.append((q, self._spec.ghost_faces * gain))
        scattered = self._view * single.scattered if mirror.touches or mirror.cloth else None
        if self._pupil is None or not mirror.dents:
            return self._lit([Beam.of(q, gain) for q, gain in ways]), scattered
        pupil = self._pupil
        beams = [
            Beam.of(*pupil.mean(q, gain, rest)) for (q, gain), rest in zip(ways, self._at_rest, strict=True)
        ]
        return self._lit(beams), None if scattered is None else pupil.mean_light(scattered)

    def _lit(self, beams: list[Beam]) -> list[Beam]:
        return [one.lit_by_lamp(self._lamp_px2) for one in beams] if self._lamp_px2 else beams

    def _single(self, mirror: Mirror) -> _Single:
        """The rays through the middle of the pupil."""
        traced = self._optics.trace_rays(self._origin, self._direction, self._surface(mirror))
        x, y = traced.point[..., 0], traced.point[..., 1]
        left, scattered = mirror.light(x, y, traced.cos_incidence, self._index)
        return _Single(traced.q, traced.reflectance * left, scattered, traced.point)

    def _surface(self, mirror: Mirror) -> HeightField:
        return Dented(self._optics.rest, mirror) if mirror.dents else self._optics.rest

    def _across_gap(self, q: Float, point: Float) -> Float:
        """Where the light that crossed the last slab three times comes from.

        Sideways by 2 gap tan(angle in the gap) along the ray's direction in the face; the gap is taken to
        be as thick everywhere as in the panel's middle.
        """
        direction = self._optics.rubber_direction_to_lcd(point, q)
        normal = self._optics.prism.pattern_face.normal
        along = self._index * (direction - (direction @ normal)[..., None] * normal)
        with np.errstate(invalid="ignore"):
            cosine = np.sqrt(self._gap_index**2 - np.einsum("...i,...i->...", along, along))
        shift = 2 * self._gap_mm / self._pitch_mm * along / cosine[..., None]
        panel = self._optics.panel
        source: Float = q + np.stack((shift @ panel.column, shift @ panel.row), axis=-1)
        return source

    def _by_faces(self, mirror: Mirror) -> tuple[Float, Float]:
        """(q, gain) of the ghost of the faces."""
        surface, prism = self._surface(mirror), self._optics.prism
        at, direction = self._origin, self._direction
        gain = np.ones(at.shape[:-1])
        for face in (prism.pattern_face, prism.camera_face):
            at, direction, kept = self._off_mirror(at, direction, surface, mirror)
            at = self._to_face(face, at, direction)
            direction, gain = reflect(direction, face.normal), gain * kept
        traced = self._optics.trace_rays(at, direction, surface)
        x, y = traced.point[..., 0], traced.point[..., 1]
        last = traced.reflectance * mirror.light(x, y, traced.cos_incidence, self._index)[0]
        return traced.q, gain * last

    def _off_mirror(
        self, origin: Float, direction: Float, surface: HeightField, mirror: Mirror
    ) -> tuple[Float, Float, Float]:
        """(point, direction, share of light) after one reflection; NaN where the mirror is missed."""
        point, outgoing, cosine, reflectance = self._optics.reflected(origin, direction, surface)
        kept = reflectance * mirror.light(point[..., 0], point[..., 1], cosine, self._index)[0]
        point[~self._optics.prism.on_mirror(point[..., 0], point[..., 1])] = np.nan
        return point, outgoing, kept

    @staticmethod
    def _to_face(face: Face, point: Float, direction: Float) -> Float:
        """Where rays meet a face from inside; NaN where they do not."""
        with np.errstate(invalid="ignore", divide="ignore"):
            distance = face.depth_below(point) / (direction @ face.normal)
            met = point + distance[..., None] * direction
        met[~(face.contains(met) & (distance >= 0.0))] = np.nan
        return met
