"""The prism's faces as points, with what must hold there; and places outside it where forces may act.

Convention: (x, y, w) in mm, x along the mirror from P0 to R0, y across it, w into the rubber.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.rig.tables import FaceSupports, Support

_ACROSS = 16
"""Points along each side of a face, closer to each other at its edges; along y on half of it."""
_OUTWARDS = 2.5
"""Distance of the outer places from a face, over that between its points there."""
_OUTER = 0.75
"""Outer places along each side, over the points."""


@dataclass(frozen=True)
class FacePoints:
    """Points (3, n) on one face, their share of its area, mm^2, its outward normal (3,), and what holds it.

    outside: (3, m) places outside the body next to it.
    """

    at: Float
    area: Float
    normal: Float
    support: Support
    outside: Float


def faces_of(
    length_mm: float, pattern_rad: float, camera_rad: float, half_width_mm: float, supports: FaceSupports
) -> tuple[FacePoints, ...]:
    """Mirror, pattern face, camera face and the end at y > 0 of the half y > 0."""
    leg = length_mm * np.sin(camera_rad) / np.sin(pattern_rad + camera_rad)
    p0, r0 = np.zeros(3), np.array([length_mm, 0.0, 0.0])
    apex = np.array([leg * np.cos(pattern_rad), 0.0, leg * np.sin(pattern_rad)])
    out_pattern = np.array([-np.sin(pattern_rad), 0.0, np.cos(pattern_rad)])
    out_camera = np.array([np.sin(camera_rad), 0.0, np.cos(camera_rad)])
    along_y, up = np.array([0.0, half_width_mm, 0.0]), np.array([0.0, 0.0, -1.0])
    return (
        _wall(p0, r0, along_y, up, "free"),
        _wall(p0, apex, along_y, out_pattern, supports.pattern),
        _wall(r0, apex, along_y, out_camera, supports.camera),
        _end(p0 + along_y, r0 + along_y, apex + along_y, supports.ends),
    )


def _crowded(count: int) -> tuple[Float, Float]:
    """Points between 0 and 1, crowded at both ends, and their weights."""
    t, weight = np.polynomial.legendre.leggauss(count)
    t, weight = 0.5 * (t + 1), 0.5 * weight
    return t, weight


def _wall(start: Float, end: Float, along_y: Float, normal: Float, support: Support) -> FacePoints:
    """A rectangle from a line at y = 0 on, the half y > 0 of it."""

    def lattice(count: int) -> tuple[Float, Float, Float, Float]:
        s, by_s = _crowded(count)
        t, by_t = _crowded(2 * (count // 2))
        upper = t > 0.5
        t, by_t = 2 * t[upper] - 1, 2 * by_t[upper]
        s, t = (each.ravel() for each in np.meshgrid(s, t))
        weight = np.outer(by_t, by_s).ravel()
        at = start[:, None] + (end - start)[:, None] * s + along_y[:, None] * t
        return at, weight, s, t

    at, weight, _, _ = lattice(_ACROSS)
    size = np.linalg.norm(end - start), np.linalg.norm(along_y)
    outside, outer_weight, _, _ = lattice(round(_OUTER * _ACROSS))
    apart = np.sqrt(outer_weight * size[0] * size[1])
    return FacePoints(
        at, weight * size[0] * size[1], normal, support, outside + _OUTWARDS * apart * normal[:, None]
    )


def _end(p0: Float, r0: Float, apex: Float, support: Support) -> FacePoints:
    """The triangle across y."""

    def lattice(count: int) -> tuple[Float, Float]:
        s, by_s = _crowded(count)
        t, by_t = _crowded(count)
        s, t = (each.ravel() for each in np.meshgrid(s, t))
        weight = np.outer(by_t, by_s).ravel() * (1 - t)
        return p0[:, None] + (r0 - p0)[:, None] * s * (1 - t) + (apex - p0)[:, None] * t, weight

    area = np.linalg.norm(np.cross(r0 - p0, apex - p0))
    normal = np.array([0.0, 1.0, 0.0])
    at, weight = lattice(_ACROSS)
    outside, outer_weight = lattice(round(_OUTER * _ACROSS))
    return FacePoints(
        at, weight * area, normal, support,
        outside + _OUTWARDS * np.sqrt(outer_weight * area) * normal[:, None],
    )  # fmt: skip
