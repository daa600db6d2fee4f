"""A lattice about one object's contact, in the object's own frame, and the pressures found on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from zeromethod.arrays import Float, Mask
from zeromethod.errors import InputError
from zeromethod.simulation.contact.adhesion import BallContact
from zeromethod.simulation.contact.compliance import Compliance, LatticeResponse
from zeromethod.simulation.contact.objects import Form, Held
from zeromethod.simulation.contact.solver import Pressed, press_on, press_to_depth, press_with_force

CELLS = 192**2
"""Cells of a patch; a contact fills most of them."""
_FIRST_CELLS = 48**2
_MARGIN = 1.14
_LARGEST = 6
_BLOCKS = 20
_BACKGROUND = 25


@dataclass(frozen=True)
class Lattice:
    """Cells (rows across, cols along) of one pitch, centred on the object."""

    rows: int
    cols: int
    pitch_mm: float

    @classmethod
    def over(cls, half_mm: tuple[float, float], cells: int) -> Lattice:
        """Lattice that reaches (along, across) mm from the middle with about that many cells."""
        along, across = half_mm
        pitch = float(np.sqrt(4 * along * across / cells))
        return cls(max(8, int(np.ceil(2 * across / pitch))), max(8, int(np.ceil(2 * along / pitch))), pitch)

    @property
    def along_mm(self) -> Float:
        """(cols,) mm."""
        return np.asarray(self.pitch_mm * (np.arange(self.cols) - (self.cols - 1) / 2), dtype=np.float64)

    @property
    def across_mm(self) -> Float:
        """(rows,) mm."""
        return np.asarray(self.pitch_mm * (np.arange(self.rows) - (self.rows - 1) / 2), dtype=np.float64)

    def mesh(self) -> tuple[Float, Float]:
        """(along, across), each (rows, cols)."""
        along, across = np.meshgrid(self.along_mm, self.across_mm)
        return along, across


@dataclass(frozen=True)
class Patch:
    """An object's contact: pressures (rows, cols) MPa, gaps mm, which cells are in contact.

    sharp_mm: radius of a contact whose border is known and sharp.
    """

    held: Held
    lattice: Lattice
    pressed: Pressed
    touching: Mask
    sharp_mm: float | None = None

    @property
    def force_n(self) -> float:
        """Sum of the pressures."""
        return float(self.pressed.pressure_mpa.sum()) * self.lattice.pitch_mm**2

    def loads(self) -> tuple[Float, Float, Float]:
        """(x mm, y mm, N), each (n,): the pressures as forces at the middles of their cells."""
        at = self.pressed.pressure_mpa != 0
        along, across = self.lattice.mesh()
        x, y = self.held.world(along[at], across[at])
        return x, y, self.pressed.pressure_mpa[at] * self.lattice.pitch_mm**2

    def blocks(self) -> tuple[Float, Float, Float]:
        """`loads` gathered into some hundred forces, each where its part's middle of force is."""
        x, y, force = self.loads()
        along, across = self.held.local(x, y)
        size = 2 * max(np.abs(along).max(), np.abs(across).max(), 1e-9) / _BLOCKS
        key = np.floor(along / size).astype(int) * 1000 + np.floor(across / size).astype(int)
        _, index = np.unique(key, return_inverse=True)
        total = np.asarray(np.bincount(index, force), dtype=np.float64)
        total[total == 0] = 1e-300
        return np.bincount(index, x * force) / total, np.bincount(index, y * force) / total, total


class Presser:
    """Finds the patch of an object in front of what the other objects do to the surface."""

    def __init__(self, held: Held, compliance: Compliance) -> None:
        self._held = held
        self._compliance = compliance
        self._lattice: Lattice | None = None
        self._spread: LatticeResponse | None = None
        self._pressure: Float | None = None

    def patch(self, others: list[Patch]) -> Patch:
        """The contact beside `others`. Raises InputError where objects run into each other."""
        if self._lattice is None:
            self._lattice = self._sized(others)
            self._spread = self._spread_on(self._lattice)
            self._pressure = np.zeros((self._lattice.rows, self._lattice.cols))
        assert self._spread is not None
        found = self._found(self._lattice, self._spread, self._pressure, others)
        self._pressure = found.pressed.pressure_mpa
        return found

    def _sized(self, others: list[Patch]) -> Lattice:
        """The lattice that the contact fills: found on a rough one that is made larger until it holds it."""
        solid, modulus = self._held.solid, self._compliance.modulus_mpa
        depth = self._held.depth_mm
        if depth is None:
            depth = solid.depth_guess_mm(self._held.force_n or 0.0, modulus)
        half = np.array(solid.reach_mm(1.1 * depth)) * 1.05
        if solid.adhesion_j_m2:
            half = np.full(2, 1.02 * self._ball_radius_mm())
        for _ in range(_LARGEST):
            rough = Lattice.over((float(half[0]), float(half[1])), _FIRST_CELLS)
            spread = self._spread_on(rough)
            found = self._found(rough, spread, np.zeros((rough.rows, rough.cols)), others)
            rows, cols = np.nonzero(found.touching)
            if not rows.size:
                return rough
            reach = np.array([np.abs(rough.along_mm[cols]).max(), np.abs(rough.across_mm[rows]).max()])
            reach += rough.pitch_mm
            held_by = np.array(solid.reach_mm(0.0 if solid.flat else np.inf))
            if np.all((reach < half) | (reach > held_by)):
                half = np.minimum(reach, held_by) * _MARGIN
                return Lattice.over((float(half[0]), float(half[1])), CELLS)
            half *= 1.5
        raise InputError("object: held so deep that its contact has no end: a smaller depth or force")

    def _spread_on(self, lattice: Lattice) -> LatticeResponse:
        shape = lattice.rows, lattice.cols
        return LatticeResponse(self._compliance, shape, lattice.pitch_mm, world=self._held.world)

    def _ball(self) -> BallContact:
        """A sticking ball's contact, which is so small that what a prism adds is the same all over it."""
        at = np.array([[self._held.x_mm], [self._held.y_mm]])
        added = float(self._compliance.of_body(at, at)[0, 0])
        return BallContact(self._compliance.rubber, self._held.solid.radius_mm, added)

    def _ball_radius_mm(self) -> float:
        ball = self._ball()
        work = 1e-3 * self._held.solid.adhesion_j_m2  # J/m^2 are N/m
        return ball.radius_for(work, depth_mm=self._held.depth_mm, force_n=self._held.force_n)

    def _found(
        self, lattice: Lattice, spread: LatticeResponse, start: Float | None, others: list[Patch]
    ) -> Patch:
        held, solid = self._held, self._held.solid
        along, across = lattice.mesh()
        profile = held.profile(along, across) + self._background(lattice, others)
        start = np.zeros_like(profile) if start is None else start
        if solid.adhesion_j_m2:
            radius = self._ball_radius_mm()
            depth = held.depth_mm
            if depth is None:
                depth = self._ball().within(radius, 1e-3 * solid.adhesion_j_m2).depth_mm
            touching = along**2 + across**2 < radius**2
            return Patch(held, lattice, press_on(spread, profile - depth, touching), touching, radius)
        if held.force_n is not None:
            if not start.any():
                start = np.where(np.isinf(profile), 0.0, 1.0)
            pressed = press_with_force(spread, profile, held.force_n, lattice.pitch_mm**2, start)
        else:
            pressed = press_to_depth(spread, profile, held.depth_mm or 0.0, start)
        touching = pressed.pressure_mpa > 0
        whole = solid.form is Form.PUNCH and bool((touching == np.isfinite(profile)).all())
        return Patch(held, lattice, pressed, touching, solid.radius_mm if whole else None)

    def _background(self, lattice: Lattice, others: list[Patch]) -> Float:
        """(rows, cols) mm that the other objects' pressures push the surface in."""
        if not others:
            return np.zeros((lattice.rows, lattice.cols))
        along = np.linspace(lattice.along_mm[0], lattice.along_mm[-1], _BACKGROUND)
        across = np.linspace(lattice.across_mm[0], lattice.across_mm[-1], _BACKGROUND)
        x, y = self._held.world(*np.meshgrid(along, across))
        rough = np.zeros_like(x)
        for other in others:
            if not other.touching.any():
                continue
            bx, by, force = other.blocks()
            away = np.hypot(x[..., None] - bx, y[..., None] - by)
            rough += self._compliance.of_force(np.maximum(away, other.lattice.pitch_mm)) @ force
            places = np.stack((x.ravel(), y.ravel()))
            rough += (self._compliance.of_body(places, np.stack((bx, by))) @ force).reshape(x.shape)
        smooth = scipy.interpolate.RectBivariateSpline(across, along, rough)
        return np.asarray(smooth(lattice.across_mm, lattice.along_mm))
