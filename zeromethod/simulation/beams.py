"""The beams that reach a camera pixel: the main one and the ghosts, each as a map of the LCD."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics import Dented, HeightField, Optics, reflect
from zeromethod.optics.prism import Face
from zeromethod.rig.model import Rig
from zeromethod.simulation.press import Mirror


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
    def of(cls, q: Float, gain: Float) -> Beam:
        """Beam whose footprints are the differences of `q`: central, one-sided next to what is lost."""
        gain = np.where(np.isnan(q[..., 0]) | np.isnan(gain), 0.0, gain)
        return cls(q, _difference(q, axis=1), _difference(q, axis=0), gain)


def _difference(q: Float, axis: int) -> Float:
    step = np.diff(q, axis=axis)
    edge = np.full_like(np.take(q, [0], axis=axis), np.nan)
    both = np.stack((np.concatenate((edge, step), axis=axis), np.concatenate((step, edge), axis=axis)))
    known = ~np.isnan(both)
    total: Float = np.where(known, both, 0.0).sum(axis=0)
    mean: Float = total / np.maximum(known.sum(axis=0), 1)
    return mean


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

    def main(self, mirror: Mirror) -> tuple[Float, Float, Float]:
        """(q (rows, cols, 2), gain (rows, cols), mirror point (rows, cols, 3)); NaN where lost."""
        traced = self._optics.trace_rays(self._origin, self._direction, self._surface(mirror))
        factor = mirror.reflectance_factor(traced.point[..., 0], traced.point[..., 1])
        return traced.q, traced.reflectance * factor, traced.point

    def all(self, mirror: Mirror) -> list[Beam]:
        """Every beam asked for, the main one first; ghosts' gains are their relative amplitude."""
        q, gain, point = self.main(mirror)
        beams = [Beam.of(q, gain)]
        if self._spec.ghost_gap > 0:
            beams.append(Beam.of(self._across_gap(q, point), self._spec.ghost_gap * gain))
        if self._spec.ghost_faces > 0:
            q, gain = self._by_faces(mirror)
            beams.append(Beam.of(q, self._spec.ghost_faces * gain))
        return beams

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
        last = traced.reflectance * mirror.reflectance_factor(traced.point[..., 0], traced.point[..., 1])
        return traced.q, gain * last

    def _off_mirror(
        self, origin: Float, direction: Float, surface: HeightField, mirror: Mirror
    ) -> tuple[Float, Float, Float]:
        """(point, direction, share of light) after one reflection; NaN where the mirror is missed."""
        point, outgoing, _, reflectance = self._optics.reflected(origin, direction, surface)
        kept = reflectance * mirror.reflectance_factor(point[..., 0], point[..., 1])
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
