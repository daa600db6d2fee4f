"""Teeth of a saw that rays of a bench take at rest."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Bytes, Float
from zeromethod.optics.bench import Optics
from zeromethod.optics.prism import Face
from zeromethod.optics.teeth import Teeth


def exit_tooth(optics: Optics, origin: Float, direction: Float) -> Teeth:
    """Tooth (...) by which rays in the rubber, (..., 3) each, leave at rest, from P0 on; 0 of a prism."""
    if optics.saw is None:
        return np.zeros(direction.shape[:-1], np.intp)
    point, outgoing, *_ = optics.reflected(origin, direction, optics.rest)
    return optics.saw.exit_tooth(point, outgoing)[0]


def face_left_by(optics: Optics, point: Float, outgoing: Float) -> Face:
    """The face by which rays from mirror points (..., 3) leave, per ray; the pattern face of a prism."""
    return optics.prism.pattern_face if optics.saw is None else optics.saw.exit_face(point, outgoing)[0]


def seams(optics: Optics, u: Float, v: Float) -> tuple[Bytes, Teeth, Teeth]:
    """Why rays of camera pixels (...) are lost (`Lost`), and a saw's teeth that they enter and leave by."""
    assert optics.saw is not None
    origin, direction, entry = optics.saw.enter(*optics.camera_rays(u, v), optics.rig.prism.index)
    leaving = exit_tooth(optics, origin, direction)
    return optics.trace_rays(origin, direction, optics.rest).lost, entry, leaving
