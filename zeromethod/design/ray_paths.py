"""The course of camera rays through the bench, corner by corner, for a drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics import Lost, Optics, reflect
from zeromethod.optics.layers import through_slabs
from zeromethod.optics.mirror import normal_of
from zeromethod.optics.vectors import dot


@dataclass(frozen=True)
class RayPath:
    """One camera pixel's ray against the light. points: (n, 3) mm, from the camera on."""

    points: Float
    lost: Lost


def ray_paths(optics: Optics, u_px: Float, v_px: Float) -> list[RayPath]:
    """Rays of pixels u_px, v_px (n,) by the mirror at rest; one that is lost ends where it still was."""
    return [_path(optics, float(u), float(v)) for u, v in zip(u_px, v_px, strict=True)]


def _path(optics: Optics, u: float, v: float) -> RayPath:
    at = np.array([u]), np.array([v])
    trace = optics.trace(*at, optics.rest)
    start, air = (part[0] for part in optics.camera_rays(*at))
    entry, inside = (part[0] for part in optics.rubber_rays(*at))
    points = [start]
    if np.isfinite(entry).all():
        points += [*_through_camera_layers(optics, entry, air), entry]
    mirror = trace.point[0]
    if np.isfinite(mirror).all():
        points.append(mirror)
        gradient = optics.rest.gradient(mirror[:1], mirror[1:2])
        outgoing = reflect(inside, normal_of(gradient)[0])
        if np.isfinite(trace.q[0]).all():
            points += _to_display(optics, mirror, outgoing)
            points.append(optics.lcd_to_world(trace.q)[0])
    return RayPath(np.array(points), Lost(int(trace.lost[0])))


def _through_camera_layers(optics: Optics, entry: Float, air: Float) -> list[Float]:
    """Points on the layers' surfaces in the order met, from the outermost on; the face itself left out."""
    face = optics.prism.captured_face
    slabs = [(slab.index, slab.thickness_mm) for slab in reversed(optics.rig.camera_layers)]
    whole, _ = through_slabs(air, -face.normal, 1.0, slabs, optics.rig.prism.index)
    outermost = entry - whole
    points = []
    for count in range(len(slabs)):
        shift, _ = through_slabs(air, -face.normal, 1.0, slabs[:count], slabs[count][0])
        points.append(outermost + shift)
    return points


def _to_display(optics: Optics, mirror: Float, outgoing: Float) -> list[Float]:
    """Points on the pattern face and between its layers, in the order met."""
    face, rig = optics.prism.pattern_face, optics.rig
    leaves = mirror + float(face.depth_below(mirror)) / float(dot(outgoing, face.normal)) * outgoing
    slabs = [(slab.index, slab.thickness_mm) for slab in rig.pattern_layers]
    points = [leaves]
    for count in range(1, len(slabs)):
        shift, _ = through_slabs(outgoing, face.normal, rig.prism.index, slabs[:count], slabs[count][0])
        points.append(leaves + shift)
    return points
