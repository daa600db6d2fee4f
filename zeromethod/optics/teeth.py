"""A saw's teeth: small prisms in a row under one mirror, each with a face to the LCD and one to the camera.

Which tooth a ray takes is found per ray; from there on a tooth's face is a face like a prism's, whose arrays
have the rays' shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.optics.layers import through_slabs
from zeromethod.optics.prism import Face, PrismGeometry
from zeromethod.optics.vectors import dot
from zeromethod.rig.model import Prism

_ENDS = 1e-9
"""Share of a ray's way at either end at which it touches the face that it starts or ends on."""
_NEAREST = 0.25
"""Part of a face's length by which a ray that leaves beside it may miss it and still count as its seam."""

Teeth = NDArray[np.intp]


class Saw:
    """Faces of all teeth of a rig's prism; tooth 0 at P0."""

    def __init__(self, spec: Prism) -> None:
        assert spec.teeth is not None
        geometry, teeth = PrismGeometry(spec), spec.teeth
        pitch_mm = self._pitch_mm = geometry.length_mm / teeth.count
        self.pattern, self.camera = [], []
        for k in range(teeth.count):
            gap, pattern, camera = (
                values[k] if values else 0.0
                for values in (
                    teeth.base_deviation_mm,
                    teeth.pattern_deviation_deg,
                    teeth.camera_deviation_deg,
                )
            )
            tooth = PrismGeometry(
                Prism(
                    pattern_angle_deg=spec.pattern_angle_deg + pattern,
                    camera_angle_deg=spec.camera_angle_deg + camera,
                    mirror_length_mm=pitch_mm,
                    width_mm=spec.width_mm,
                    index=spec.index,
                )
            )
            valley = np.array([k * pitch_mm, 0.0, -teeth.base_mm - gap])
            self.pattern.append(tooth.pattern_face.moved(valley))
            self.camera.append(tooth.camera_face.moved(valley))
        self._pattern, self._camera = Face.stacked(self.pattern), Face.stacked(self.camera)

    def enter(self, origin: Float, direction: Float, index: float) -> tuple[Float, Float, Teeth]:
        """Rays from air, (..., 3) each, in the rubber: where they enter, their direction there, the tooth.

        NaN (and tooth 0) where they meet no tooth's camera face.
        """
        distances = []
        with np.errstate(invalid="ignore", divide="ignore"):
            for face in self.camera:
                distance = face.depth_below(origin) / dot(direction, face.normal)
                on = face.contains(origin + distance[..., None] * direction)
                distances.append(np.where(on & (dot(direction, face.normal) < 0.0), distance, np.inf))
            nearest = np.min(distances, axis=0)
            tooth = np.argmin(distances, axis=0)
            nearest = np.where(np.isfinite(nearest), nearest, np.nan)
        return *self.entered(origin, direction, index, tooth, nearest), tooth

    def entered(
        self, origin: Float, direction: Float, index: float, tooth: Teeth, distance: Float | None = None
    ) -> tuple[Float, Float]:
        """Rays from air, (..., 3) each, in the rubber behind the plane of a tooth's (...) camera face."""
        face = self._camera.at(tooth)
        with np.errstate(invalid="ignore", divide="ignore"):
            distance = (
                face.depth_below(origin) / dot(direction, face.normal) if distance is None else distance
            )
            start = origin + distance[..., None] * direction
            _, inside = through_slabs(direction, -face.normal, 1.0, [], index)
        return start, np.where(np.isnan(start), np.nan, inside)

    def exit_tooth(self, point: Float, outgoing: Float) -> tuple[Teeth, Mask]:
        """Tooth whose pattern face rays from the mirror leave by, and whether they meet it, or all but.

        Where a ray meets none, the one that it misses least.
        """
        costs = []
        with np.errstate(invalid="ignore", divide="ignore"):
            for face in self.pattern:
                distance = face.depth_below(point) / dot(outgoing, face.normal)
                offset = dot(point + distance[..., None] * outgoing - face.edge, face.along) / face.length_mm
                missed = np.maximum(np.maximum(-offset, offset - 1.0), 0.0)
                # of faces that are met, the first
                costs.append(np.where(missed > 0.0, 1e6 * (1.0 + missed), distance))
        cost = np.min(np.where(np.isnan(costs), np.inf, costs), axis=0)
        return np.argmin(np.where(np.isnan(costs), np.inf, costs), axis=0), cost < 1e6 * (1.0 + _NEAREST)

    def exit_face(self, point: Float, outgoing: Float) -> tuple[Face, Mask]:
        """That tooth's pattern face, per ray, and whether they meet it, or all but."""
        tooth, near = self.exit_tooth(point, outgoing)
        return self._pattern.at(tooth), near

    def clear(self, entry: Float, point: Float, leaves: Float, end: Float) -> Mask:
        """Whether no face lies in the way: from entry to mirror, from there to where rays leave, to the LCD.

        Points (..., 3). A ray is so steep that only the tooth it enters or leaves and its neighbours may be.
        """
        blocked = (self._in_the_way(*ends) for ends in ((entry, point), (leaves, point), (leaves, end)))
        return np.asarray(~np.logical_or.reduce(list(blocked)))

    def _in_the_way(self, start: Float, end: Float) -> Mask:
        """Whether a face of the tooth at `start` or of one next to it lies before `end`, both left out."""
        way = end - start
        hit = np.zeros(way.shape[:-1], bool)
        known = np.where(np.isfinite(start[..., 0]), start[..., 0], 0.0)
        tooth = np.clip(known // self._pitch_mm, 0, len(self.pattern) - 1).astype(np.intp)
        with np.errstate(invalid="ignore", divide="ignore"):
            for step in (-1, 0, 1):
                near = np.clip(tooth + step, 0, len(self.pattern) - 1)
                for face in (self._pattern.at(near), self._camera.at(near)):
                    share = face.depth_below(start) / dot(way, face.normal)
                    between = (share > _ENDS) & (share < 1.0 - _ENDS)
                    hit |= between & face.contains(start + share[..., None] * way)
        return hit
