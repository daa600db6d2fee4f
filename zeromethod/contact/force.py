"""How hard each contact presses, read from the mirror around it.

No light comes back from inside a contact, but the rubber around it carries the whole load: the slopes there
are those that the pressures of every contact make (`zeromethod.contact.loads`), of which the first has a net
force and the others differ from it by none. Their shares are fitted to the slopes, which need no constant as
depth does; two numbers are a tilt of the whole mirror, that nothing else here needs to know.

Convention: force > 0 presses into the rubber, < 0 pulls; a torque presses deeper on its positive side: that
about y (N mm) is the sum of force times x from the contact's centroid, that about x of force times -y.
Friction moves the surface of nearly incompressible rubber only sideways: it does not disturb the reading, and
cannot be read. Creep is not modelled: a force that is held long reads high as the rubber yields on.
Source: Johnson 1985, Contact Mechanics, 3.2, doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact import load_slopes, slope_blocks
from zeromethod.contact.contact import Contact
from zeromethod.contact.loads import SHAPES, Loads, shares
from zeromethod.contact.median import median
from zeromethod.contact.slope_blocks import SlopeBlocks
from zeromethod.mechanics.yielding import Yielding
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface

_FEWEST = 24
_PASSES = 3
_MEDIAN = 0.6745
"""Median of the size of a standard normal number."""
_DOUBTED = 2.5
"""Slopes that are farther off than so many standard deviations count less. Source: Huber 1964,
doi:10.1214/aoms/1177703732."""
_MODEL = 0.003
"""What the kernel and the contact's border leave open of slopes, relative to them."""
_FORCES = 0.0015
"""The same of forces: those of a ball, a punch, a cone and a rod were read 0.01 to 0.25 % low."""


@dataclass(frozen=True, slots=True)
class TotalForce:
    """Sum over all contacts, N, and its standard deviation."""

    force_n: float = math.nan
    sigma_n: float = math.nan


@dataclass(frozen=True, slots=True)
class _Fit:
    """Shares (n,) of all contacts' pressures, and their covariance."""

    mean: Float
    spread: Float


class ForceReader:
    """Forces of the contacts of surface after surface."""

    def __init__(self, rig: Rig) -> None:
        self._yielding = Yielding.of(rig)
        self._geometry = rig.geometry
        if self._yielding is not None:
            for module in (load_slopes, slope_blocks):
                module.compile_ahead()

    def read(self, surface: Surface, contacts: Sequence[Contact]) -> tuple[tuple[Contact, ...], TotalForce]:
        """The contacts with their forces and torques, and the sum; NaN where too little is read around them.

        Parameters
        ----------
        surface : Surface
            As measured around the contacts.
        contacts : sequence of Contact
            What presses in that frame.

        Returns
        -------
        tuple of Contact, TotalForce
            The same contacts, in order.
        """
        if self._yielding is None or not contacts:
            return tuple(contacts), TotalForce()
        blocks = SlopeBlocks.of(surface, contacts)
        if len(blocks.slope) < _FEWEST + SHAPES * len(contacts):
            return tuple(contacts), TotalForce()
        loads = [Loads.of(contact) for contact in contacts]
        fit = self._fitted(blocks, loads)
        arms = np.zeros((len(contacts), 3, len(fit.mean)))
        for k, (contact, load) in enumerate(zip(contacts, loads, strict=True)):
            x, y = (load.cells - (contact.x_mm, contact.y_mm)).T
            by_cell = np.stack([np.ones_like(x), -y, x])
            arms[k, :, SHAPES * k : SHAPES * (k + 1)] = np.einsum("mc,sc->ms", by_cell, load.forces)
        arms *= np.pi * self._yielding.modulus_mpa
        found = tuple(self._with(contact, fit, arm) for contact, arm in zip(contacts, arms, strict=True))
        total, sigma = _summed(fit, arms[:, 0].sum(axis=0)[None])
        middle = np.mean([(contact.x_mm, contact.y_mm) for contact in contacts], axis=0)
        return found, TotalForce(float(total[0]), math.hypot(sigma[0], self._open(*middle) * total[0]))

    def _fitted(self, blocks: SlopeBlocks, loads: list[Loads]) -> _Fit:
        """Shares of the pressures by slopes all over the mirror."""
        terms = [self._terms(load, blocks.at_mm) for load in loads]
        tilt = np.broadcast_to(np.eye(2), (len(blocks.slope), 2, 2))
        weight = 1 / np.sqrt(blocks.variance + (_MODEL * blocks.slope) ** 2)
        weighted = (np.concatenate([*terms, tilt], axis=2) * weight[..., None]).reshape(weight.size, -1)
        wanted = (blocks.slope * weight).ravel()
        trust = np.ones(wanted.size)
        for _ in range(_PASSES):
            fit = _regular(
                *load_slopes.normal_equations(weighted * trust[:, None], wanted * trust), len(loads)
            )
            left = np.abs(wanted - np.einsum("nt,t->n", weighted, fit.mean))
            usual = max(median(left) / _MEDIAN, 1.0)
            # slopes beside a border, where the mirror may fold, can be off by any amount
            trust = np.sqrt(np.minimum(1.0, _DOUBTED * usual / np.maximum(left, 1e-12)))
        return _Fit(fit.mean, usual**2 * fit.spread)

    def _terms(self, load: Loads, at_mm: Float) -> Float:
        """(n, 2, SHAPES) mean slopes at points (n, 4, 2) by one contact; the body adds to its net force."""
        assert self._yielding is not None
        slopes = load_slopes.load_slopes(load, at_mm)
        middle = np.einsum("c,ck->k", load.forces[0], load.cells)
        added = self._yielding.added_slopes(at_mm.reshape(-1, 2), middle)
        if added is not None:
            slopes[:, :, 0] += added.reshape(at_mm.shape).mean(axis=1)
        return slopes

    def _with(self, contact: Contact, fit: _Fit, arms: Float) -> Contact:
        """The contact with its force and torques and their sigmas; arms (3, n)."""
        values, sigmas = _summed(fit, arms)
        sigmas = np.hypot(sigmas, self._open(contact.x_mm, contact.y_mm) * values)
        # a centroid that is off makes a torque of the force
        sigmas = np.hypot(sigmas, np.array([0.0, contact.sigma_y_mm, contact.sigma_x_mm]) * values[0])
        return replace(
            contact,
            force_n=float(values[0]),
            torque_x_nmm=float(values[1]),
            torque_y_nmm=float(values[2]),
            sigma_force_n=float(sigmas[0]),
            sigma_torque_x_nmm=float(sigmas[1]),
            sigma_torque_y_nmm=float(sigmas[2]),
        )

    def _open(self, x_mm: float, y_mm: float) -> float:
        """Relative standard deviation that all forces share: the rubber's, and what the geometry leaves open.

        Force goes as depth times distance; a mode of the geometry changes both.
        """
        assert self._yielding is not None
        known = math.hypot(self._yielding.relative_sigma, _FORCES)
        if not self._geometry.depth:
            return known
        x, y = x_mm + np.array([0.0, 1.0, 0.0]), y_mm + np.array([0.0, 0.0, 1.0])
        depth, along, across = np.moveaxis(self._geometry.fields(x, y), 1, 0)
        stretch = (along[:, 1] - along[:, 0] + across[:, 2] - across[:, 0]) / 2
        return float(np.hypot(known, np.sqrt(((depth[:, 0] + stretch) ** 2).sum())))


def _summed(fit: _Fit, arms: Float) -> tuple[Float, Float]:
    """Sums (m,) of shares times arms (m, n), and their standard deviations."""
    return arms @ fit.mean, np.sqrt(np.einsum("mt,tu,mu->m", arms, fit.spread, arms))


def _regular(normal: Float, right: Float, count: int) -> _Fit:
    """Shares of the pressures of so many contacts, of which balls alone say how large the forces are."""
    alone = np.concatenate([np.arange(0, SHAPES * count, SHAPES), [-2, -1]])
    newtons = np.linalg.solve(normal[np.ix_(alone, alone)], right[alone])[:count]
    mean, known = shares(normal, right, newtons)
    return _Fit(mean, np.asarray(np.linalg.inv(known), np.float64))
