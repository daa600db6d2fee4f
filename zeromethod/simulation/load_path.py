"""Loads that are moved over the rig's rubber: how deep or hard they press at an instant, and their dents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import spline_filter

from zeromethod.arrays import Float
from zeromethod.rig.prism_tables import Prism
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.compliance import Compliance
from zeromethod.simulation.elements.prism import PrismKernel
from zeromethod.simulation.load_fields import UnitDent
from zeromethod.simulation.loads import Load
from zeromethod.simulation.path import PathPoint, moves, place_at
from zeromethod.simulation.press import Dent, Shape

_PITCH_MM = 1.25
"""Of the map of what a prism adds: half that changes it by 2e-5 of the depth, at the mirror's corners."""
_BORDER = 4
"""Points that this map goes on beyond the mirror."""
_KEPT = 24


@dataclass(frozen=True, slots=True)
class Pressed:
    """A load at one instant: its middle, and its depth where it is deepest or its force."""

    load: Load
    x_mm: float
    y_mm: float
    depth_mm: float | None = None
    force_n: float | None = None


@dataclass(frozen=True)
class LoadPath:
    """A load that follows a path; points as `PressPath` has them. by_force: their depths are forces, N."""

    load: Load
    points: tuple[PathPoint, ...]
    by_force: bool = False

    def pressed_at(self, time_ns: int) -> Pressed | None:
        """The load at `time_ns`; None while its depth or force is 0."""
        x_mm, y_mm, amount = place_at(self.points, time_ns)
        if amount == 0:
            return None
        depth_mm, force_n = (None, amount) if self.by_force else (amount, None)
        return Pressed(self.load, x_mm, y_mm, depth_mm, force_n)

    def moving(self, from_ns: int, to_ns: int) -> bool:
        """Whether it moves continuously anywhere inside (from, to); jumps do not count."""
        return moves(self.points, from_ns, to_ns)

    def bends_ns(self, from_ns: int, to_ns: int) -> tuple[int, ...]:
        """Times of the points inside (from, to)."""
        return tuple(point.time_ns for point in self.points if from_ns < point.time_ns < to_ns)


def dents_of(pressed: Sequence[Pressed], rubber: Rubber, prism: Prism | None = None) -> tuple[Dent, ...]:
    """Dents of loads on a rig's rubber; they add up, and each is as deep by itself as it says.

    prism: the rig's; it matters where the rubber's support is given per face.
    """
    return _dents(tuple(pressed), Compliance(rubber, prism)) if pressed else ()


@lru_cache(_KEPT)
def _dents(pressed: tuple[Pressed, ...], compliance: Compliance) -> tuple[Dent, ...]:
    body, dents = compliance.body, []
    forces: list[tuple[Float, Float]] = []
    for each in pressed:
        unit = each.load.unit(compliance.rubber)
        per_n = unit.peak / (math.sqrt(2 * math.pi) * each.load.width_mm * compliance.modulus_mpa)
        shares, added = _shares(each, unit), 0.0
        if body is not None:
            places = _places(each, *unit.deepest)
            added = float((compliance.of_body(places, shares[0]) @ shares[1]).max())
        force = each.force_n if each.depth_mm is None else each.depth_mm / (per_n + added)
        assert force is not None
        dents.append(each.load.free_dent(each.x_mm, each.y_mm, per_n * force, compliance.rubber))
        forces.append((shares[0], shares[1] * force))
    if body is not None:
        at, force_n = (np.concatenate(part, axis=-1) for part in zip(*forces, strict=True))
        dents.append(_body_map(body, at, force_n / compliance.youngs_modulus_mpa))
    return tuple(dents)


def _places(pressed: Pressed, x: Float, y: Float) -> Float:
    """(2, n) mm on the mirror of places in widths about the load's middle, along its angle and across."""
    turn, width = np.radians(pressed.load.angle_deg), pressed.load.width_mm
    c, s = np.cos(turn), np.sin(turn)
    return np.stack((pressed.x_mm + width * (c * x - s * y), pressed.y_mm + width * (s * x + c * y)))


def _shares(pressed: Pressed, unit: UnitDent) -> tuple[Float, Float]:
    """Places (2, n) mm and shares of the force that stand for the loads: each by 5 x 5 (Gauss-Hermite)."""
    at, weight = np.polynomial.hermite_e.hermegauss(5)
    weight = weight / weight.sum()
    x, y = (each.ravel() for each in np.meshgrid(at, at))
    pieces = unit.pieces
    places = _places(pressed, np.add.outer(pieces.x, x).ravel(), np.add.outer(pieces.y, y).ravel())
    return places, np.multiply.outer(pieces.share, np.outer(weight, weight).ravel()).ravel()


def _body_map(body: PrismKernel, at_mm: Float, force_n: Float) -> Dent:
    """What the prism adds under forces (n,) at places (2, n), E = 1 MPa, as a map over the mirror."""
    cols = round(body.length_mm / _PITCH_MM)
    pitch = body.length_mm / cols
    half_rows = int(body.half_width_mm / pitch)
    x, y = pitch * np.arange(cols + 1.0), pitch * np.arange(-half_rows, half_rows + 1.0)
    depth = body.on_grid(body.of_forces(at_mm[0], at_mm[1], force_n), x, y)
    depth = np.pad(depth, _BORDER, mode="reflect", reflect_type="odd")
    coefficients = spline_filter(depth, order=3, mode="mirror")
    return Dent(
        Shape.MAP, body.length_mm / 2, 0.0, 1.0, pitch, map=coefficients, map_coefficients=coefficients
    )
