"""The course of camera rays through the bench, corner by corner, for a drawing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics import Lost, Optics
from zeromethod.optics.layers import through_slabs
from zeromethod.optics.prism import Face
from zeromethod.optics.saw_rays import face_left_by
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
        if np.isfinite(trace.q[0]).all():
            outgoing = optics.reflected(entry[None], inside[None], optics.rest)[1][0]
            face = face_left_by(optics, mirror, outgoing)
            points += [*_to_display(optics, face, mirror, outgoing), optics.lcd_to_world(trace.q)[0]]
    return RayPath(np.array(points), Lost(int(trace.lost[0])))


def _through_camera_layers(optics: Optics, entry: Float, air: Float) -> list[Float]:
    """Points on the layers' surfaces in the order met, from the outermost on; the face itself left out."""
    face = optics.prism.camera_face
    slabs = [(slab.index, slab.thickness_mm) for slab in reversed(optics.rig.camera_layers)]
    whole, _ = through_slabs(air, -face.normal, 1.0, slabs, optics.rig.prism.index)
    outermost = entry - whole
    stacks = [(slabs[:count], slabs[count][0]) for count in range(len(slabs))]
    return [outermost + through_slabs(air, -face.normal, 1.0, *stack)[0] for stack in stacks]


def _to_display(optics: Optics, face: Face, mirror: Float, outgoing: Float) -> list[Float]:
    """Points on the pattern face and between its layers, in the order met."""
    rig = optics.rig
    leaves = mirror + float(face.depth_below(mirror)) / float(dot(outgoing, face.normal)) * outgoing
    slabs = [(slab.index, slab.thickness_mm) for slab in rig.pattern_layers]
    stacks = [(slabs[:count], slabs[count][0]) for count in range(1, len(slabs))]
    shifts = (through_slabs(outgoing, face.normal, rig.prism.index, *stack)[0] for stack in stacks)
    return [leaves, *(leaves + shift for shift in shifts)]
