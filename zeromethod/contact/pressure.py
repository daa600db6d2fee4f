"""How the pressure is spread over a contact, as far as the slopes around it say.

A ball's pressure, and differences from it that are smooth over half a contact's radius. How large these are,
evidence says: the probability of all slopes around if the differences themselves are averaged out. What they
do not say stays as a ball has it, within sigma; a peak that is narrower than half a radius is not seen. No
pressure is below 0, unless evidence says that the rubber sticks: then a flat punch's pressure, infinite at
the border, is taken off, as Johnson, Kendall & Roberts 1971 have it (doi:10.1098/rspa.1971.0141).
Source: MacKay 1992, Bayesian interpolation, doi:10.1162/neco.1992.4.3.415.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
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
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.surface import Surface

_SMOOTH = 0.5
"""Distance over a contact's radius within which pressure differs from a ball's by about as much."""
_MODES = 3 * SHAPES
"""Differences that are fitted; smoother ones than the next do not reach the slopes outside."""
_NO_FORCE = 3
"""Unknowns at the end: what is open of the body, and a tilt of the mirror along x and y."""
_PULL = 3.0
"""Standard deviation of a punch's share of the force, if the rubber sticks."""
_STICKS = 5.0
"""Logarithm of the odds from which it is said to. Source: Kass & Raftery 1995,
doi:10.1080/01621459.1995.10476572: very strong evidence."""
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
        Size of the smooth differences from a ball's pressure, over the mean pressure, as evidence has it.
    sticks : bool
        Whether the rubber is seen to pull at the border: only then are pressures below 0.
    """

    x_mm: Float
    y_mm: Float
    area_mm2: Float
    pressure_mpa: Float
    sigma_mpa: Float
    unlike: float
    sticks: bool

    @property
    def force_n(self) -> float:
        """Sum of pressure times area."""
        return float(self.pressure_mpa @ self.area_mm2)


def pressure_map(
    rig: Rig | str | Path, surface: Surface, contacts: Sequence[Contact], number: int = 0
) -> PressureMap:
    """Pressure on one of the contacts of a frame.

    Parameters
    ----------
    rig : Rig, str or Path
        That says how stiff the rubber is.
    surface : Surface
        As measured around the contacts: a step's.
    contacts : sequence of Contact
        All that press in that frame: the step's. The rows of a recording's table are none.
    number : int
        Which of them, from 0.

    Returns
    -------
    PressureMap
        On cells within the contact's border.

    Raises
    ------
    InputError
        The rig does not say how stiff the rubber is, there is no such surface or contact, too little is read
        around it, or it pulls.

    Examples
    --------
    >>> import zeromethod as zm
    >>> rig = zm.load_rig("simulated").replace({"scenario": "hertz"})
    >>> with zm.Session(rig) as session:
    ...     step = [one for one in session.run(seconds=0.6) if one.contacts][-1]
    >>> zm.pressure_map(rig, step.surface, step.contacts).pressure_mpa.max()  # doctest: +SKIP
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    _check(surface, contacts, number)
    yielding = Yielding.of(rig)
    if yielding is None:
        raise InputError(f"pressure map: {NO_MODULUS}")
    found = _read(yielding, Overlap.of(rig), surface, contacts, number)
    if not found.sticks:
        return found
    # light leaks beside a ball, of which half is taken off its area: not beside rubber that sticks
    one = contacts[number]
    wider = [*contacts[:number], _grown(one, one.area_mm2 + one.sigma_area_mm2), *contacts[number + 1 :]]
    grown = _read(yielding, Overlap.of(rig), surface, wider, number)
    by_border = grown.pressure_mpa - found.pressure_mpa
    return replace(grown, sigma_mpa=np.hypot(grown.sigma_mpa, by_border))


def _grown(contact: Contact, area_mm2: float) -> Contact:
    by = math.sqrt(area_mm2 / contact.area_mm2)
    middle = np.array([contact.x_mm, contact.y_mm])
    return replace(
        contact,
        outline_mm=middle + by * (contact.outline_mm - middle),
        area_mm2=area_mm2,
        major_mm=by * contact.major_mm,
        minor_mm=by * contact.minor_mm,
    )


def _read(
    yielding: Yielding, overlap: Overlap, surface: Surface, contacts: Sequence[Contact], number: int
) -> PressureMap:
    """The map for these borders, as if they were exact."""
    fit = ForceFit.of(surface, contacts, yielding, overlap)
    if fit is None:
        raise InputError("pressure map: too few slopes are read around the contact")
    force = float(fit.arms[number, 0] @ fit.mean)
    if force <= 0:
        raise InputError("pressure map: the contact pulls: no pressure makes that")
    load = Loads.of(contacts[number])
    unlike = _unlike(load)
    by_cell = np.vstack([load.forces[:2], unlike, np.zeros((_NO_FORCE, len(load.cells)))]).T
    whole = _Known.of(fit, load, unlike, number)
    found = whole.without_punch.averaged(force, np.delete(by_cell, 1, axis=1), pulls=False)
    sticking = whole.averaged(force, by_cell, pulls=True)
    odds = sticking.evidence - found.evidence if sticking.punch < 0 else -math.inf
    sticks = odds > _STICKS
    if sticks:
        found = sticking
    else:
        doubt = math.exp(odds) / (1 + math.exp(odds)) * (sticking.forces - found.forces) ** 2
        found = found._replace(variance=found.variance + doubt)
    per_area = np.pi * yielding.modulus_mpa / load.area_mm2
    x, y = load.cells.T
    pressure, sigma = per_area * found.forces, per_area * np.sqrt(found.variance)
    return PressureMap(x, y, load.area_mm2, pressure, sigma, found.size, sticks)


def _check(surface: object, contacts: Sequence[object] | None, number: int) -> None:
    if not isinstance(surface, Surface):
        raise InputError(f"pressure map: surface: {type(surface).__name__}: a step's surface")
    if contacts is None or not all(isinstance(contact, Contact) for contact in contacts):
        raise InputError("pressure map: contacts: a step's; a recording's rows are none")
    if len(contacts) == 0:
        raise InputError("pressure map: contacts: nothing touches")
    if number not in range(len(contacts)):
        raise InputError(f"pressure map: number: {number}: from 0 to {len(contacts) - 1}")


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


class _Average(NamedTuple):
    """Over the sizes that differences may have: by the logarithm of their evidence, forces of cells."""

    evidence: float
    size: float
    punch: float
    forces: Float
    variance: Float


class _Known(NamedTuple):
    """Normal equations: a ball's force, a punch's share, the differences, the open body, a tilt."""

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
        ball_and_punch = fit.terms[:, own.start : own.start + 2]
        terms = np.concatenate([ball_and_punch, *steep, fit.open_slopes[:, None], fit.terms[:, -2:]], axis=1)
        return cls(*load_slopes.normal_equations(terms * fit.weight[:, None], wanted * fit.weight))

    @property
    def without_punch(self) -> _Known:
        """The same of what does not stick."""
        return _Known(np.delete(np.delete(self.normal, 1, 0), 1, 1), np.delete(self.right, 1))

    def averaged(self, force: float, by_cell: Float, *, pulls: bool) -> _Average:
        """Forces by all sizes of the differences; by_cell: (cells, t); pulls: a punch's share is one of t."""
        # before anything is read, ball and tilt may be anything, the body is open by one standard deviation
        punch = [_PULL * force] if pulls else []
        each = [
            self._solved(
                np.array([np.inf, *punch, *[size * force] * _MODES, 1.0, np.inf, np.inf]), by_cell, pulls
            )
            for size in _SIZES
        ]
        evidence = np.array([one.evidence for one in each])
        share = np.exp(evidence - evidence.max())
        total = math.log(share.sum() / len(share)) + evidence.max()
        share /= share.sum()
        forces = np.einsum("s,sc->c", share, np.stack([one.forces for one in each]))
        variance = sum(
            part * (one.variance + (one.forces - forces) ** 2) for part, one in zip(share, each, strict=True)
        )
        mean_punch = float(share @ [one.punch for one in each])
        return _Average(total, float(share @ _SIZES), mean_punch, forces, np.asarray(variance))

    def _solved(self, scale: Float, by_cell: Float, pulls: bool) -> _Average:
        """Answer for standard deviations (t,) of the unknowns; unless it pulls, no cell is below 0.

        Variances are without that; the evidence is but for a constant.
        """
        known = self.normal + np.diag(scale**-2)
        mean = np.linalg.solve(known, self.right)
        factor = np.linalg.slogdet(known)[1] + 2 * np.log(scale[np.isfinite(scale)]).sum()
        evidence = 0.5 * float(self.right @ mean - factor)
        lower = np.linalg.cholesky(known)
        reach = np.linalg.solve(lower, by_cell.T)
        variance = (reach**2).sum(axis=0)
        if not pulls:
            # its dual: pushes >= 0 on the cells that would be below 0; of columns of one size, or it may fail
            sigma = np.sqrt(variance)
            push = nnls(reach / sigma, -np.einsum("ut,u->t", lower, mean))[0] / sigma
            mean = mean + np.linalg.solve(known, np.einsum("ct,c->t", by_cell, push))
        return _Average(evidence, 0.0, float(mean[1]), np.einsum("ct,t->c", by_cell, mean), variance)
