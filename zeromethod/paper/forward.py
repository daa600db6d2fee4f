"""What the lattice sensor would pick on a known surface, camera at infinity and normal to the captured face.

Convention: as in `zeromethod.paper.equations`; (x, z) with x along the mirror from P0, z out of the rubber.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.paper.equations import captured_distance, pattern_distance, reflected_angle


def exact_picks(
    l: Float,  # noqa: E741
    d: Float,
    theta: Float,
    *,
    alpha0: float,
    beta0: float,
    length: float,
) -> tuple[Float, Float]:
    """Exact m, w (n,) of mirror points (l, -d) of slope angle theta, (n,) each, by plane geometry alone.

    The camera's rays are parallel, beta0 from the normal. m is where the reflected ray meets the pattern
    face's line through P0 (negative or beyond the face where it misses), w the camera ray's on the captured.
    """
    normal = np.stack([-np.sin(theta), -np.cos(theta)], axis=-1)
    to_camera = np.array([np.sin(beta0), -np.cos(beta0)])
    outgoing = 2.0 * (normal @ to_camera)[..., None] * normal - to_camera
    point = np.stack([l, -d], axis=-1)
    m = _along_face(point, outgoing, np.array([np.cos(alpha0), -np.sin(alpha0)]))
    from_r0 = point - np.array([length, 0.0])
    w = _along_face(
        from_r0, np.broadcast_to(to_camera, point.shape), np.array([-np.cos(beta0), -np.sin(beta0)])
    )
    return m, w


def printed_picks(
    l: Float,  # noqa: E741
    d: Float,
    theta: Float,
    *,
    alpha0: float,
    beta0: float,
    length: float,
) -> tuple[Float, Float]:
    """The paper's own approximate m, w (n,): equations 9, 12 and 14 with gamma = gamma' = 0."""
    alpha = reflected_angle(beta0, -theta)
    m = pattern_distance(l, d, alpha, alpha0, gamma=0.0)
    return m, captured_distance(length - l, d, beta0, beta0, gamma=0.0)


def _along_face(point: Float, direction: Float, face: Float) -> Float:
    """Distance from the origin along `face` (2,) at which rays (n, 2) cross it."""
    across = np.array([-face[1], face[0]])
    travel = -(point @ across) / (direction @ across)
    return np.asarray((point + travel[..., None] * direction) @ face)
