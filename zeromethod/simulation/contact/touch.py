"""What lies against the mirror: the gap in front of it, the light that crosses it, and the contact's truth.

Gaps are kept as levels that run straight through a contact's border, so that it is found between the points
of the lattice: gap^(2/3) where the gap is open, less than 0 in contact.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.simulation.contact.patch import Patch

WAVELENGTH_MM = 550e-6
"""Of the LCD's light."""
LEAST_ROOT = 0.1
"""Least of sqrt(n^2 sin^2 - 1): at and below the critical angle the wave beyond the mirror reaches 0.9 µm."""
FAR = 1.0
"""Level beyond the lattice."""


def evanescent_mm(cos_incidence: Float, index: float) -> Float:
    """Distance, mm, in which the field behind a totally reflecting mirror falls to 1/e.

    125 nm at 60 degrees, 215 nm at 50 (index 1.41). Source: Born & Wolf, Principles of Optics, 1.5.4.
    """
    beyond = index**2 * (1 - np.asarray(cos_incidence) ** 2) - 1
    return np.asarray(WAVELENGTH_MM / (2 * np.pi * np.sqrt(np.maximum(beyond, LEAST_ROOT**2))))


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """An object in contact.

    x_mm, y_mm: middle of the lattice, turned by `angle_deg`. level: (rows across, cols along) mm^(2/3).
    albedo: share of light that it scatters. The truth: number of the object, force_n, and of the contact
    area_mm2 and its centroid.
    """

    number: int
    x_mm: float
    y_mm: float
    angle_deg: float
    pitch_mm: float
    level: Float = field(repr=False)
    albedo: float
    force_n: float
    area_mm2: float
    centroid_mm: tuple[float, float]

    @property
    def key(self) -> tuple[object, ...]:
        """All that makes it up, hashable."""
        return (self.number, self.x_mm, self.y_mm, self.angle_deg, self.pitch_mm, self.albedo, id(self.level))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Touch) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    def moved(self, x_mm: float, y_mm: float) -> Touch:
        """The same, that far away."""
        centroid = self.centroid_mm[0] + x_mm, self.centroid_mm[1] + y_mm
        return replace(self, x_mm=self.x_mm + x_mm, y_mm=self.y_mm + y_mm, centroid_mm=centroid)

    def level_at(self, x: Float, y: Float) -> Float:
        """Level at world points, bilinear between the lattice's; `FAR` beyond it and for NaN."""
        angle = np.radians(self.angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        rows, cols = self.level.shape
        col = (c * (x - self.x_mm) + s * (y - self.y_mm)) / self.pitch_mm + (cols - 1) / 2
        row = (c * (y - self.y_mm) - s * (x - self.x_mm)) / self.pitch_mm + (rows - 1) / 2
        with np.errstate(invalid="ignore"):
            inside = (col >= 0) & (col < cols - 1) & (row >= 0) & (row < rows - 1)
        return np.where(
            inside, _bilinear(self.level, np.where(inside, row, 0.0), np.where(inside, col, 0.0)), FAR
        )

    def covers(self, x: Float, y: Float) -> Mask:
        """Whether world points lie in contact."""
        return np.asarray(self.level_at(x, y) < 0)

    def crossing(self, x: Float, y: Float, evanescent: Float) -> Float:
        """Share of the light that crosses the gap at world points; `evanescent`: of `evanescent_mm`."""
        gap = np.maximum(self.level_at(x, y), 0.0) ** 1.5
        return np.asarray(np.exp(-2 * gap / evanescent))


def _bilinear(values: Float, row: Float, col: Float) -> Float:
    i, j = np.floor(row).astype(np.intp), np.floor(col).astype(np.intp)
    s, t = row - i, col - j
    upper = (1 - t) * values[i, j] + t * values[i, j + 1]
    lower = (1 - t) * values[i + 1, j] + t * values[i + 1, j + 1]
    return np.asarray((1 - s) * upper + s * lower)


def touch_of(patch: Patch) -> Touch:
    """The touch of a solved contact."""
    level = _level(patch)
    area, along, across = _moments(level, patch.lattice.pitch_mm)
    held = patch.held
    x, y = held.world(np.asarray(along), np.asarray(across))
    return Touch(
        held.number, held.x_mm, held.y_mm, held.solid.angle_deg, patch.lattice.pitch_mm, level,
        held.solid.albedo, patch.force_n, area, (float(x), float(y)),
    )  # fmt: skip


def _level(patch: Patch) -> Float:
    """Both pressure^2 inside and gap^(2/3) outside grow as the distance from the border (Hertz).

    A sharp border (a punch's, a sticking ball's), where pressures run to infinity, lies where it is known.
    """
    touching = patch.touching
    if patch.sharp_mm is not None:
        away = np.hypot(*patch.lattice.mesh()) - patch.sharp_mm
        near = (away > 0) & (away < 2 * patch.lattice.pitch_mm)
        return np.asarray(away * (patch.pressed.gap_mm[near] ** (2 / 3) / away[near]).mean())
    outside = np.where(touching, 0.0, np.maximum(patch.pressed.gap_mm, 0.0)) ** (2 / 3)
    inside = patch.pressed.pressure_mpa**2
    padded = np.pad(touching, 1, mode="edge")
    some = [padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j] for i, j in _NEXT]
    any_near, all_near = np.logical_or.reduce(some), np.logical_and.reduce(some)
    rim_in, rim_out = touching & ~all_near, ~touching & any_near
    # on average the cells on either side of the border are as far from it, but for what is counted as contact
    scale = _INNER * outside[rim_out].mean() / inside[rim_in].mean()
    return np.asarray(np.where(touching, -np.maximum(scale * inside, 1e-9), np.minimum(outside, FAR)))


_INNER = 0.5
"""A cell counts as in contact from a small covered part on, which puts the border some 0.1 cells too far out.
Source: Yastrebov, Anciaux & Molinari 2017, doi:10.1016/j.jmps.2017.07.016."""
_NEXT = ((0, 1), (1, 0), (0, -1), (-1, 0))
_PARTS = 8


def _moments(level: Float, pitch_mm: float) -> tuple[float, float, float]:
    """(area mm^2, centroid along, across mm) of where the level is below 0, as `Touch.level_at` has it."""
    rows, cols = level.shape
    total = along = across = 0.0
    for s in (np.arange(_PARTS) + 0.5) / _PARTS:
        for t in (np.arange(_PARTS) + 0.5) / _PARTS:
            upper = (1 - t) * level[:-1, :-1] + t * level[:-1, 1:]
            lower = (1 - t) * level[1:, :-1] + t * level[1:, 1:]
            row, col = np.nonzero((1 - s) * upper + s * lower < 0)
            total += row.size
            across += float((row + s - (rows - 1) / 2).sum())
            along += float((col + t - (cols - 1) / 2).sum())
    if not total:
        return 0.0, 0.0, 0.0
    return total * (pitch_mm / _PARTS) ** 2, along / total * pitch_mm, across / total * pitch_mm
