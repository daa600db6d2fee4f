"""How the pressure is spread over a contact, as far as the slopes around it say.

A ball's pressure, and differences from it that are smooth over half a contact's radius. How large these are,
evidence says: the probability of all slopes around if the differences themselves are averaged out. What they
do not say stays as a ball has it, within sigma; a peak that is narrower than half a radius is not seen. No
pressure is below 0: a contact that sticks is none of these.
Source: MacKay 1992, Bayesian interpolation, doi:10.1162/neco.1992.4.3.415.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from zeromethod.arrays import Float
from zeromethod.contact import load_slopes
from zeromethod.contact.contact import Contact
from zeromethod.contact.force_fit import ForceFit, Overlap
from zeromethod.contact.loads import SHAPES, Loads
from zeromethod.errors import InputError
from zeromethod.mechanics.yielding import NO_MODULUS, Yielding
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface

_SMOOTH = 0.5
"""Distance over a contact's radius within which pressure differs from a ball's by about as much."""
_MODES = 3 * SHAPES
"""Differences that are fitted; smoother ones than the next do not reach the slopes outside."""
_NO_FORCE = 3
"""Unknowns after these: what is open of the body, and a tilt of the mirror along x and y."""
_SIZES = np.geomspace(0.3, 3.0, 11)
"""Sizes of the differences that are compared, over the mean pressure; hard objects differ by no less."""


@dataclass(frozen=True, slots=True, eq=False)
class PressureMap:
    """Pressure on the cells of a contact.

    Attributes
    ----------
    x_mm, y_mm : (n,)
        Middles of the cells, which are smaller where pressure changes fast.
    area_mm2 : (n,)
        Their areas.
    pressure_mpa, sigma_mpa : (n,)
        Into the rubber, and its standard deviation, without what is open of the modulus.
    unlike : float
        Size of the differences from a ball's pressure, over the mean pressure, as evidence has it.
    """

    x_mm: Float
    y_mm: Float
    area_mm2: Float
    pressure_mpa: Float
    sigma_mpa: Float
    unlike: float

    @property
    def force_n(self) -> float:
        """Sum of pressure times area."""
        return float(self.pressure_mpa @ self.area_mm2)


def pressure_map(rig: Rig, surface: Surface, contacts: Sequence[Contact], number: int = 0) -> PressureMap:
    """Pressure on one of the contacts of a frame.

    Parameters
    ----------
    rig : Rig
        That says how stiff the rubber is.
    surface : Surface
        As measured around the contacts.
    contacts : sequence of Contact
        All that press in that frame.
    number : int
        Which of them.

    Returns
    -------
    PressureMap
        On cells within the contact's border.

    Raises
    ------
    InputError
        The rig does not say how stiff the rubber is, or too little is read around the contact.
    """
    yielding = Yielding.of(rig)
    if yielding is None:
        raise InputError(f"pressure map: {NO_MODULUS}")
    fit = ForceFit.of(surface, contacts, yielding, Overlap.of(rig))
    if fit is None:
        raise InputError("pressure map: too few slopes are read around the contact")
    force = float(fit.arms[number, 0] @ fit.mean)
    if force <= 0:
        raise InputError("pressure map: the contact pulls: no pressure makes that")
    load = Loads.of(contacts[number])
    unlike = _unlike(load)
    known = _Known.of(fit, load, unlike, number)
    by_cell = np.vstack([load.forces[:1], unlike, np.zeros((_NO_FORCE, len(load.cells)))]).T
    evidence = np.array([known.evidence(force * size) for size in _SIZES])
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    each = [known.solved(force * size, by_cell) for size in _SIZES]
    mean = np.einsum("s,sc->c", share, np.stack([forces for forces, _ in each]))
    variance = sum(
        one * (spread + (forces - mean) ** 2) for one, (forces, spread) in zip(share, each, strict=True)
    )
    per_area = np.pi * yielding.modulus_mpa / load.area_mm2
    x, y = load.cells.T
    return PressureMap(
        x, y, load.area_mm2, per_area * mean, per_area * np.sqrt(variance), float(share @ _SIZES)
    )


def _unlike(load: Loads) -> Float:
    """(modes, cells) forces without a sum, by which a unit force differs from a ball's, smoothly.

    With random factors of variance 1 they are pressures as large as the mean pressure.
    """
    whole = load.area_mm2.sum()
    away2 = ((load.cells[:, None] - load.cells) ** 2).sum(axis=-1)
    alike = (
        np.exp(-away2 / (2 * _SMOOTH**2 * whole / np.pi)) * np.outer(load.area_mm2, load.area_mm2) / whole**2
    )
    alike -= np.outer(load.forces[0], alike.sum(axis=0))
    alike -= np.outer(alike.sum(axis=1), load.forces[0])
    values, vectors = np.linalg.eigh(alike)
    largest = slice(-_MODES, None)
    return np.asarray((vectors[:, largest] * np.sqrt(np.maximum(values[largest], 0.0))).T)


class _Known(NamedTuple):
    """Normal equations: a ball's force, the factors of the differences, what is open of the body, a tilt."""

    normal: Float
    right: Float

    @classmethod
    def of(cls, fit: ForceFit, load: Loads, unlike: Float, number: int) -> _Known:
        """From the slopes of a fit, what the other contacts do taken off."""
        own = slice(SHAPES * number, SHAPES * (number + 1))
        others = fit.mean.copy()
        others[own], others[-2:] = 0.0, 0.0
        wanted = fit.slopes - np.einsum("nt,t->n", fit.terms, others)
        steep = [
            load_slopes.load_slopes(replace(load, forces=part), fit.at_mm).reshape(len(wanted), SHAPES)
            for part in unlike.reshape(-1, SHAPES, len(load.cells))
        ]
        terms = np.concatenate(
            [fit.terms[:, own.start : own.start + 1], *steep, fit.open_slopes[:, None], fit.terms[:, -2:]],
            axis=1,
        )
        return cls(*load_slopes.normal_equations(terms * fit.weight[:, None], wanted * fit.weight))

    def _with_prior(self, size: float) -> Float:
        prior = np.zeros(len(self.right))
        prior[1:-_NO_FORCE] = size**-2
        # one standard deviation of the body
        prior[-_NO_FORCE] = 1.0
        return self.normal + np.diag(prior)

    def evidence(self, size: float) -> float:
        """Logarithm of the slopes' probability if the differences are so large, but for a constant."""
        known = self._with_prior(size)
        factor = np.linalg.slogdet(known)[1] + 2 * math.log(size) * (len(self.right) - 1 - _NO_FORCE)
        return 0.5 * float(self.right @ np.linalg.solve(known, self.right) - factor)

    def solved(self, size: float, by_cell: Float) -> tuple[Float, Float]:
        """Forces (cells,), none below 0, and their variance without that."""
        known = self._with_prior(size)
        lower = np.linalg.cholesky(known)
        mean = np.linalg.solve(known, self.right)
        reach = np.linalg.solve(lower, by_cell.T)
        # its dual: pushes >= 0 on the cells that would be below 0
        push = nnls(reach, -np.einsum("ut,u->t", lower, mean))[0]
        mean = mean + np.linalg.solve(known, np.einsum("ct,c->t", by_cell, push))
        return np.einsum("ct,t->c", by_cell, mean), (reach**2).sum(axis=0)
