"""How hard each contact presses, read from the mirror around it.

No light comes back from inside a contact, but the rubber around it carries the whole load. So the slopes
there are fitted by those that pressures on each contact make (`zeromethod.contact.loads`): one with a net
force, and others without, which change how it is spread. Slopes are used, as they need no constant, unlike
depth. Two further unknowns are a tilt of the whole mirror.

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
from zeromethod.contact.contact import Contact
from zeromethod.contact.force_fit import ForceFit, Overlap
from zeromethod.mechanics.yielding import Yielding
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface

_FORCES = 0.0008
"""Relative error of forces by the kernel and the shapes of pressure: means over frames of 15 balls, cones,
punches and rods were off by 0.07 %, rms, on the simulated bench."""
_PULLS = 0.04
"""The same of a pull. It is a small difference of a push in the middle and a pull at the rim, and the slopes
around hardly show how large the two are: 2 mN were read as 2.08."""
_CLOTH = 0.025
"""The same through a cloth, where borders are rough: 125 planted fingers were 2.0 % off, rms."""


@dataclass(frozen=True, slots=True)
class TotalForce:
    """Sum over all contacts, N, and its standard deviation."""

    force_n: float = math.nan
    sigma_n: float = math.nan


class ForceReader:
    """Forces of the contacts of surface after surface; `fit` is what presses in the last one."""

    def __init__(self, rig: Rig) -> None:
        self._yielding = Yielding.of(rig)
        self._geometry = rig.geometry
        self._shapes = _CLOTH if rig.under_cloth else _FORCES
        self._overlap = Overlap.of(rig)
        self.fit: ForceFit | None = None

    def read(
        self, surface: Surface, contacts: Sequence[Contact], unnamed: Sequence[Contact] = ()
    ) -> tuple[tuple[Contact, ...], TotalForce]:
        """The contacts with their forces and torques, and the sum; NaN where too little is read around them.

        Parameters
        ----------
        surface : Surface
            As measured around the contacts.
        contacts : sequence of Contact
            What presses in that frame.
        unnamed : sequence of Contact, optional
            What presses, too, and has no name yet: else its dent would count as that of the others.

        Returns
        -------
        tuple of Contact, TotalForce
            The same contacts, in order.
        """
        named, contacts = len(contacts), (*contacts, *unnamed)
        fit = self.fit
        if not contacts:
            fit = None
        elif fit is None or not (fit.serves(contacts) and fit.follow(surface)):
            fit = ForceFit.of(surface, contacts, self._yielding, self._overlap)
        self.fit = fit
        if fit is None or math.isnan(self._yielding.modulus_mpa):
            return contacts[:named], TotalForce()
        arms = np.pi * self._yielding.modulus_mpa * fit.arms
        constant_mm = surface.anchor.sigma_mm
        pairs = zip(contacts, arms, strict=True)
        found = tuple(self._with(contact, fit, arm, constant_mm) for contact, arm in pairs)
        total, sigma = _summed(fit, arms[:, 0].sum(axis=0)[None], constant_mm)
        middle = np.mean([(contact.x_mm, contact.y_mm) for contact in contacts], axis=0)
        pulls = (_PULLS * one.force_n for one in found if one.force_n < 0)
        return found[:named], TotalForce(
            float(total[0]), math.hypot(sigma[0], self._open(*middle) * total[0], *pulls)
        )

    def _with(self, contact: Contact, fit: ForceFit, arms: Float, constant_mm: float) -> Contact:
        """The contact with its force and torques and their sigmas; arms (3, n)."""
        values, sigmas = _summed(fit, arms, constant_mm)
        sigmas = np.hypot(sigmas, self._open(contact.x_mm, contact.y_mm) * values)
        if values[0] < 0:
            sigmas[0] = math.hypot(sigmas[0], _PULLS * values[0])
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
        known = math.hypot(self._yielding.relative_sigma, self._shapes)
        if not self._geometry.depth:
            return known
        x, y = x_mm + np.array([0.0, 1.0, 0.0]), y_mm + np.array([0.0, 0.0, 1.0])
        depth, along, across = np.moveaxis(self._geometry.fields(x, y), 1, 0)
        stretch = (along[:, 1] - along[:, 0] + across[:, 2] - across[:, 0]) / 2
        return float(np.hypot(known, np.sqrt(((depth[:, 0] + stretch) ** 2).sum())))


def _summed(fit: ForceFit, arms: Float, constant_mm: float) -> tuple[Float, Float]:
    """Sums (m,) of shares times arms (m, n), and their standard deviations.

    constant_mm: standard deviation of depth's constant.
    """
    noise = np.sqrt(np.einsum("mt,tu,mu->m", arms, fit.spread, arms))
    return arms @ fit.mean, np.hypot(noise, constant_mm * (arms @ fit.by_constant))
