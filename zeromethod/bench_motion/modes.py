"""Modes: the few patterns that rigid motion of camera, LCD or prism makes in the warp at rest.

The parts have 18 numbers. Only how they lie to one another counts, and the camera sees no more than the
mirror image of a flat LCD: at most six patterns are left (shift along two axes, turn, size, two keystones).
Different motions make the same pattern, so that a pattern names a group of motions, never one part. A
telecentric lens sees nothing of its motion along its axis: there stands the pattern of a wrong scale, its
pixel's or the LCD's, which no motion makes.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial.polynomial import polyvander2d

from zeromethod.arrays import Float
from zeromethod.optics import Optics
from zeromethod.optics.vectors import rotation
from zeromethod.warp.grid import NodeGrid

_STEP_MM, _STEP_RAD = 1e-3, 1e-5
"""Motions by which the patterns are found."""
_CLEAR_MM = 0.05
"""A panel that touches the prism is taken this far off: it must not enter the prism when it is turned."""

_SAMPLES = 15
"""Nodes along each axis from which the patterns are distinguished, and carried on to all others."""

_DEGREE = 5
"""Of the polynomials of camera px that carry the patterns from node to node: off by 1e-4 of them at most."""

_LEAST = 1e-2
"""Singular value, relative to the largest, below which a pattern counts as another one's."""

_ALIKE = 0.97
"""Cosine between two patterns from which they go by the same name."""

_LEAST_SEEN = 0.1
"""Share of a motion's pattern that must show for it to be named."""

_NAMES = {
    "camera": (
        "camera slid sideways", "camera slid up or down", "camera moved along its axis",
        "camera turned up or down", "camera turned sideways", "camera rolled",
    ),
    "LCD": (
        "LCD slid along its columns", "LCD slid along its rows", "LCD moved off the prism",
        "LCD tilted about its columns' axis", "LCD tilted about its rows' axis", "LCD turned in its plane",
    ),
    "prism": (
        "prism slid along x", "prism slid along y", "prism sank or rose",
        "prism turned about x", "prism turned about y", "prism turned about z",
    ),
}  # fmt: skip
"""Motions of each part: along, then about its three axes (u, v, view; column, row, normal; x, y, z)."""

_SCALE = "camera's pixel_mm or LCD's pitch_mm is wrong"
"""Of a telecentric lens, in place of its motion along the axis."""

_FIRST = (4, 3, 5, 0, 1, 2)
"""Order in which the motions of a part are named: of those alike, a turn before a slide."""

_ORDER = {"camera": _FIRST, "LCD": (0, 1, 5, 2, 3, 4), "prism": (2, 0, 1, 3, 4, 5)}


@dataclass(frozen=True)
class BenchModes:
    """Patterns of rigid motion, each of rms 1 LCD px over the view and at right angles to the others.

    values: (12,) singular values of the patterns of camera and LCD, the largest 1. motions: (18, modes) each
    motion of `_NAMES` as a sum of modes, LCD px per mm or rad. camera_px: camera px per LCD px.
    telecentric: whether the camera's motion along its axis stands for a wrong scale.
    """

    values: Float
    motions: Float
    camera_px: float
    telecentric: bool
    _coefficients: Float
    _middle: Float
    _half: Float

    @classmethod
    @lru_cache(maxsize=1)
    def of(cls, optics: Optics, grid: NodeGrid) -> BenchModes:
        """Modes of a rig; traces some 200 nodes 36 times, once for all who ask with the same optics."""
        u, v = (one[grid.inner] for one in grid.mesh())
        rows, cols = (np.unique(np.linspace(0, n - 1, _SAMPLES).astype(int)) for n in u.shape)
        u, v = u[np.ix_(rows, cols)], v[np.ix_(rows, cols)]
        patterns = np.stack([_pattern(optics, part, k, u, v) for part in _NAMES for k in range(6)], axis=-1)
        seen = np.isfinite(patterns).all(axis=(-1, -2))
        u, v, patterns = u[seen], v[seen], patterns[seen]
        flat = patterns.reshape(-1, 18) / np.sqrt(len(u))
        size = np.sqrt((flat[:, :12] ** 2).sum(axis=0))
        size = np.where(size > 1e-9 * size.max(), size, np.inf)
        left, values, right = np.linalg.svd(flat[:, :12] / size, full_matrices=False)
        kept = values > _LEAST * values[0]
        combined = (right[kept] / (size * values[kept, None])).T
        middle = np.array([np.mean(u), np.mean(v)])
        # at least a pixel: nodes may share a column where little of the LCD is seen
        half = np.maximum(np.array([np.ptp(u), np.ptp(v)]) / 2.0, 1.0)
        terms = polyvander2d((u - middle[0]) / half[0], (v - middle[1]) / half[1], [_DEGREE, _DEGREE])
        modes = (patterns[..., :12] @ combined).reshape(len(u), -1)
        coefficients = np.linalg.lstsq(terms, modes, rcond=None)[0]
        here = optics.rest_map(u, v), optics.rest_map(u + 1.0, v), optics.rest_map(u, v + 1.0)
        (a, b), (c, d) = (here[1] - here[0]).T, (here[2] - here[0]).T
        per_px = float(np.sqrt(np.nanmedian(np.abs(a * d - b * c))))
        motions = flat.T @ left[:, kept]
        telecentric = optics.camera.spec.projection == "orthographic"
        return cls(values / values[0], motions, 1.0 / per_px, telecentric, coefficients, middle, half)

    @property
    def count(self) -> int:
        """Number of modes, at most 6, of a telecentric lens 7."""
        return int(self.motions.shape[1])

    def at(self, u: Float, v: Float) -> Float:
        """Modes at camera pixels u, v (...): (..., 2, modes) LCD px."""
        x, y = (u - self._middle[0]) / self._half[0], (v - self._middle[1]) / self._half[1]
        result: Float = polyvander2d(x, y, [_DEGREE, _DEGREE]) @ self._coefficients
        return result.reshape(*np.shape(u), 2, self.count)

    @cached_property
    def _directions(self) -> Float:
        """(18, modes) of length 1, or 0 for motions that nothing shows."""
        size = np.linalg.norm(self.motions, axis=-1, keepdims=True)
        return np.where(size > 1e-6 * size.max(), self.motions / np.maximum(size, 1e-300), 0.0)

    @cached_property
    def scale(self) -> Float | None:
        """(modes,) of length 1: what only a wrong scale makes, and no motion; None where there is none."""
        _, values, right = np.linalg.svd(np.delete(self._directions, 2, axis=0))
        return right[-1] if self.telecentric and values[-1] < _LEAST * values[0] else None

    def group(self, motion: Float, seen: Float | None = None) -> str:
        """Names of the motions, at most one of each part, that alone explain a sum (modes,) of modes.

        seen: (modes, directions) orthonormal sums of modes, where no others show.
        """
        alike = self._directions @ motion / max(float(np.linalg.norm(motion)), 1e-300)
        if seen is not None:
            size = np.linalg.norm(self._directions @ seen, axis=-1)
            alike = np.where(size > _LEAST_SEEN, alike / np.maximum(size, _LEAST_SEEN), 0.0)
        found = []
        for number, (part, names) in enumerate(_NAMES.items()):
            own = np.abs(alike[6 * number : 6 * number + 6])
            if own.max() > _ALIKE:
                alone = next(k for k in _ORDER[part] if own[k] > own.max() - 0.005)
                scale = self.telecentric and (part, alone) == ("camera", 2)
                found.append(_SCALE if scale else names[alone])
        return ", or ".join(found) if found else "more than one motion of camera, LCD or prism"

    def words(self, motion: Float, seen: Float | None = None) -> str:
        """By how much and which group, for a sum (modes,) of modes; `seen` as `group` takes it."""
        lcd_px = float(np.linalg.norm(motion))
        return f"by {lcd_px * self.camera_px:.2g} camera px ({lcd_px:.2g} LCD px): {self.group(motion, seen)}"


def _pattern(optics: Optics, part: str, number: int, u: Float, v: Float) -> Float:
    """Change of q (..., 2), LCD px per mm or rad, when one part moves along or about one axis."""
    step = _STEP_MM if number < 3 else _STEP_RAD
    ahead, back = (_moved(optics, part, number, sign * step).rest_map(u, v) for sign in (1.0, -1.0))
    change: Float = (ahead - back) / (2.0 * step)
    return change


def _moved(optics: Optics, part: str, number: int, by: float) -> Optics:
    """The same optics with one part moved by mm or rad; the prism, by moving the two others back."""
    other = copy.copy(optics)
    panel, camera = optics.panel, optics.camera
    panel = replace(panel, centre=panel.centre + _CLEAR_MM * panel.normal)
    axis = number % 3
    if part == "prism":
        about, along, by = np.array([optics.length_mm / 2, 0.0, 0.0]), np.eye(3)[axis], -by
    elif part == "camera":
        about, along = camera.position, (camera.u_axis, camera.v_axis, camera.axis)[axis]
    else:
        about, along = panel.centre, (panel.column, panel.row, panel.normal)[axis]

    turn = np.eye(3) if number < 3 else rotation(along, by)
    shift = by * along if number < 3 else np.zeros(3)

    def point(place: Float) -> Float:
        moved: Float = about + turn @ (place - about) + shift
        return moved

    if (part, number) == ("camera", 2) and camera.spec.pixel_mm is not None:
        wider = {"pixel_mm": camera.spec.pixel_mm * (1.0 + by)}
        camera = replace(camera, spec=camera.spec.model_copy(update=wider))
    elif part != "LCD":
        camera = replace(
            camera,
            position=point(camera.position),
            axis=turn @ camera.axis,
            u_axis=turn @ camera.u_axis,
            v_axis=turn @ camera.v_axis,
        )
    if part != "camera":
        panel = replace(
            panel,
            centre=point(panel.centre),
            column=turn @ panel.column,
            row=turn @ panel.row,
            normal=turn @ panel.normal,
        )
    other.camera, other.panel = camera, panel
    return other
