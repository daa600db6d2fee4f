"""Pressure under a rigid object: conjugate gradients on the gap, pressures never negative.

Source: Polonsky & Keer 1999, doi:10.1016/S0043-1648(99)00113-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.errors import MeasurementError
from zeromethod.simulation.contact.compliance import LatticeResponse

_TOLERANCE = 1e-6
"""Change of all pressures in a step, relative to their sum, at which they count as found."""
_STEPS = 2000


@dataclass(frozen=True, slots=True)
class Pressed:
    """pressure_mpa, gap_mm (object to rubber, ~0 in contact): (rows, cols). depth_mm: the object's."""

    pressure_mpa: Float
    gap_mm: Float
    depth_mm: float


def press_to_depth(spread: LatticeResponse, profile_mm: Float, depth_mm: float, start: Float) -> Pressed:
    """Pressures under an object whose lowest point is `depth_mm` below the surface at rest.

    profile_mm: (rows, cols) height of the object over its lowest point (what else bends the surface added),
    inf where it has none. start: pressures to begin with.
    """
    lifted = np.isinf(profile_mm)
    room = np.where(lifted, 1e3, profile_mm) - depth_mm
    pressure = np.where(lifted, 0.0, np.maximum(start, 0.0))
    pressure, gap = _search(spread, room, lifted, pressure, force=None)
    return Pressed(pressure, gap, depth_mm)


def press_with_force(
    spread: LatticeResponse, profile_mm: Float, force_n: float, cell_mm2: float, start: Float
) -> Pressed:
    """Pressures that add up to a force; see `press_to_depth`. cell_mm2: area of a cell of the lattice."""
    lifted = np.isinf(profile_mm)
    room = np.where(lifted, 1e3, profile_mm)
    total = force_n / cell_mm2
    pressure = np.where(lifted, 0.0, np.maximum(start, 0.0))
    pressure *= total / pressure.sum()
    pressure, gap = _search(spread, room, lifted, pressure, force=total)
    return Pressed(pressure, gap, float(np.mean((room + spread.displacement(pressure) - gap)[pressure > 0])))


def _search(
    spread: LatticeResponse, room: Float, lifted: Mask, pressure: Float, force: float | None
) -> tuple[Float, Float]:
    """(pressures, gaps) with gap = displacement + room, the gap's mean in contact taken off for a force."""
    way = np.zeros_like(pressure)
    before, conjugate = 1.0, False
    for _ in range(_STEPS):
        touching = pressure > 0
        gap = spread.displacement(pressure) + room
        if force is not None:
            gap -= gap[touching].mean()
        if not touching.any():
            # nothing yet: begin where the object overlaps the rubber at rest
            if not (gap[~lifted] < 0).any():
                return pressure, gap
            pressure = np.where(lifted, 0.0, np.maximum(-gap, 0.0))
            pressure *= -gap.min() / spread.displacement(pressure).max()
            continue
        steepness = float((gap[touching] ** 2).sum())
        way = np.where(touching, gap + (steepness / before if conjugate else 0.0) * way, 0.0)
        before = steepness
        if steepness == 0.0:
            return pressure, gap
        moved = spread.displacement(way)
        if force is not None:
            moved -= moved[touching].mean()
        length = float((gap * way)[touching].sum() / (moved * way)[touching].sum())
        after = np.maximum(pressure - length * way, 0.0)
        overlap = (after == 0) & (gap < 0) & ~lifted & ~touching
        conjugate = not overlap.any()
        after[overlap] -= length * gap[overlap]
        if force is not None:
            after *= force / after.sum()
        change = float(np.abs(after - pressure).sum() / max(after.sum(), 1e-300))
        pressure = after
        if change < _TOLERANCE:
            return pressure, gap
    raise MeasurementError(f"contact: no pressures found in {_STEPS} steps")


def press_on(spread: LatticeResponse, room_mm: Float, touching: Mask) -> Pressed:
    """Pressures, of either sign, that bring the gap to 0 on given cells: an object that sticks.

    room_mm: (rows, cols) gap at no pressure.
    """
    pressure = np.zeros_like(room_mm)
    residual = np.where(touching, -room_mm, 0.0)
    way, size = residual.copy(), float((residual**2).sum())
    goal = size * _TOLERANCE**2
    for _ in range(_STEPS):
        if size <= goal:
            break
        moved = np.where(touching, spread.displacement(way), 0.0)
        length = size / float((way * moved).sum())
        pressure += length * way
        residual -= length * moved
        before, size = size, float((residual**2).sum())
        way = residual + size / before * way
    return Pressed(pressure, spread.displacement(pressure) + room_mm, 0.0)
