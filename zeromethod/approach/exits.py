"""The watch camera's rays in the air: where they leave the mirror at rest, and in which direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.optics import Optics
from zeromethod.optics.camera import CameraModel
from zeromethod.optics.layers import through_slabs
from zeromethod.optics.mirror import distance_to, normal_of
from zeromethod.rig.model import Rig, WatchSpec


@dataclass(frozen=True, slots=True)
class Exits:
    """Rays of one view above the mirror: at height z mm a ray passes x, y = `foot` + z `tangent`.

    foot: (rows, cols, 2) mm, at z = 0. tangent: (rows, cols, 2). valid: (rows, cols) the pixel sees out
    through the mirror; foot and tangent are 0 elsewhere. areas: (rows, cols, 3): in the plane at height z a
    pixel covers |areas @ (1, z, z^2)| mm^2.
    """

    foot: Float
    tangent: Float
    valid: Mask
    areas: Float


def exits_of(rig: Rig, watch: WatchSpec, *, right: bool) -> Exits:
    """Rays of the left or the right view of the rig's watch camera."""
    half, (cx, cy) = watch.columns // 2, watch.centre_px
    shift = (0.5 if right else -0.5) * watch.baseline_mm * CameraModel.place(watch).u_axis
    position, look_at = ((one + shift).tolist() for one in (watch.position_mm, watch.look_at_mm))
    centre = half - 1 - cx if right else cx, cy
    lens = watch.camera(
        columns=half, region_px=None, centre_px=centre, position_mm=position, look_at_mm=look_at
    )
    optics = Optics(rig.model_copy(update={"camera": lens}))
    v, u = np.mgrid[: lens.rows, : lens.columns].astype(np.float64)
    start, inside = optics.rubber_rays(u, v)
    place = start + distance_to(optics.rest, start, inside)[..., None] * inside
    normal = normal_of(optics.rest.gradient(place[..., 0], place[..., 1]))
    direction = through_slabs(inside, normal, rig.prism.index, (), 1.0)[1]
    tangent = direction[..., :2] / direction[..., 2:]
    foot = place[..., :2] - place[..., 2:] * tangent
    valid = np.isfinite(tangent[..., 0]) & optics.prism.on_mirror(place[..., 0], place[..., 1])
    foot, tangent = (np.where(valid[..., None], one, 0.0) for one in (foot, tangent))
    down, along, tilt, turn = (
        np.asarray(np.gradient(one, axis=axis)) for one in (foot, tangent) for axis in (0, 1)
    )
    areas = _cross(down, along), _cross(down, turn) + _cross(tilt, along), _cross(tilt, turn)
    return Exits(foot, tangent, valid, np.stack(areas, axis=-1))


def _cross(first: Float, second: Float) -> Float:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
