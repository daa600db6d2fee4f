"""How the pressure is spread over a contact, as far as the slopes around it say.

The pressure of a ball, a flat punch or a cone, and differences from it that are smooth over half a contact's
radius. Which of them, how large the differences are, and where within its sigma the border is, evidence says:
the probability of all slopes around if what is not known is averaged out. No pressure is below 0,
unless evidence says that the rubber sticks: then a punch's pressure, infinite at the border, is taken off, as
Johnson, Kendall & Roberts 1971 have it (doi:10.1098/rspa.1971.0141).
Source: MacKay 1992, Bayesian interpolation, doi:10.1162/neco.1992.4.3.415.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from zeromethod.arrays import Float, Image
from zeromethod.contact import load_fields
from zeromethod.contact.contact import Contact
from zeromethod.contact.force_fit import ForceFit, Overlap
from zeromethod.contact.loads import RINGS, SHAPES, Loads
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
_BALL, _PUNCH, _CONE = range(3)
_PULL = 3.0
"""Standard deviation of a punch's share of the force, if the rubber sticks."""
_SURELY = 5.0
"""Logarithm of the odds from which something presses otherwise than a ball does, or sticks. Source: Kass &
Raftery 1995, doi:10.1080/01621459.1995.10476572: very strong evidence."""
_DOUBTED = 0.5
"""Share of the evidence that counts: what the kernel leaves open of slopes is alike in many of them."""
_SIZES = np.geomspace(0.03, 3.0, 13)
"""Sizes of the differences that are compared, over the mean pressure."""


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
    rig: Rig | str | Path, surface: Surface, contacts: Sequence[Contact] | Image, number: int = 0
) -> PressureMap:
    """Pressure on one of the contacts of a frame.

    Parameters
    ----------
    rig : Rig, str or Path
        That says how stiff the rubber is.
    surface : Surface
        As measured around the contacts: a step's.
    contacts : sequence of Contact, or rows of `Recording.contacts`
        All that press in that frame.
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
    contacts = _checked(surface, contacts, number)
    yielding = Yielding.of(rig)
    if math.isnan(yielding.modulus_mpa):
        raise InputError(f"pressure map: {NO_MODULUS}")
    found = _read(yielding, Overlap.of(rig), surface, contacts, number)
    if not found.sticks:
        return found
    # light leaks beside a ball, of which half is taken off its border: not beside rubber that sticks
    one = contacts[number]
    wide = _grown(one, math.pi * (math.sqrt(one.area_mm2 / math.pi) + one.leak_mm) ** 2)
    wider = [*contacts[:number], wide, *contacts[number + 1 :]]
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
    known = _Known.of(fit, contacts[number], number, force)
    models = [known.averaged(shape, pulls=False) for shape in (_BALL, _PUNCH, _CONE)]
    sticking = known.averaged(_BALL, pulls=True)
    if sticking.pull < 0:
        models.append(sticking)
    doubted = [one._replace(evidence=_DOUBTED * one.evidence) for one in models]
    # a ball's, unless something else is surely likelier; what it may be all the same is in sigma
    chosen = max(range(len(models)), key=lambda k: doubted[k].evidence + _SURELY * (k == _BALL))
    sticks = models[chosen] is sticking
    found = models[chosen]
    variance = _mixed(doubted, found.forces).variance
    load = fit.loads[number]
    per_area = np.pi * yielding.modulus_mpa / load.area_mm2
    x, y = (load.middle_mm + math.sqrt(1 + found.grown) * (load.cells - load.middle_mm)).T
    pressure = per_area * found.forces
    sigma = np.hypot(per_area * np.sqrt(variance), known.open_area / 2 * _by_growth(load, pressure))
    return PressureMap(x, y, load.area_mm2 * (1 + found.grown), pressure, sigma, found.size, sticks)


def _by_growth(load: Loads, pressure: Float) -> Float:
    """Change of pressure (n,) at a place over the border's growth, relative, if that is even."""
    away = np.hypot(*(load.cells - load.middle_mm).T).reshape(RINGS, -1)
    rise, step = (np.diff(one, axis=0, append=one[-1:]) for one in (pressure.reshape(RINGS, -1), away))
    rise[-1], step[-1] = rise[-2], step[-2]
    return np.asarray((away * rise / step).ravel())


def _checked(surface: object, contacts: Any, number: int) -> list[Contact]:
    if not isinstance(surface, Surface):
        raise InputError(f"pressure map: surface: {type(surface).__name__}: a step's surface")
    if isinstance(contacts, np.ndarray) and "outline_mm" in (contacts.dtype.names or ()):
        contacts = [Contact.of_row(row) for row in contacts]
    if contacts is None or not all(isinstance(contact, Contact) for contact in contacts):
        raise InputError("pressure map: contacts: a step's, or a recording's rows of that step")
    if len(contacts) == 0:
        raise InputError("pressure map: contacts: nothing touches")
    if number not in range(len(contacts)):
        raise InputError(f"pressure map: number: {number}: from 0 to {len(contacts) - 1}")
    return list(contacts)


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
    """Over the sizes that differences may have: by the logarithm of their evidence, forces of cells.

    grown: area over that of the contact's border, less 1. pull: a punch's share.
    """

    evidence: float
    size: float
    grown: float
    pull: float
    forces: Float
    variance: Float


def _mixed(each: Sequence[_Average], about: Float | None = None) -> _Average:
    """All of them as likely as their evidence has it; variance about forces, if not about their mean."""
    evidence = float(np.logaddexp.reduce([one.evidence for one in each])) - math.log(len(each))
    weight = np.exp([one.evidence - evidence for one in each]) / len(each)
    size, grown, pull = (float(weight @ [one[k] for one in each]) for k in (1, 2, 3))
    forces = np.einsum("s,sc->c", weight, np.stack([one.forces for one in each]))
    about = forces if about is None else about
    apart = np.stack([one.variance + (one.forces - about) ** 2 for one in each])
    return _Average(evidence, size, grown, pull, forces, np.einsum("s,sc->c", weight, apart))


class _Known(NamedTuple):
    """Normal equations of: forces of a ball, punch and cone; growth of each; differences; body; a tilt.

    by_cell: (cells, t) forces of cells by each. force: of the contact. open_area: of its area, relative.
    """

    normal: Float
    right: Float
    by_cell: Float
    force: float
    open_area: float

    @classmethod
    def of(cls, fit: ForceFit, contact: Contact, number: int, force: float) -> _Known:
        """From the slopes of a fit, what the other contacts do taken off."""
        load = fit.loads[number]
        own = slice(SHAPES * number, SHAPES * (number + 1))
        others = fit.mean.copy()
        others[own], others[-2:] = 0.0, 0.0
        wanted = load_fields.left_over(fit.terms, fit.slopes, others)

        def steep(one: Loads) -> Float:
            fields = load_fields.load_fields(one, fit.blocks.at_mm, fit.blocks.spread_mm2)
            return fields[:, 1:].reshape(-1, SHAPES)

        unlike = _unlike(load)
        differences = [
            steep(replace(load, forces=part)) for part in unlike.reshape(-1, SHAPES, len(load.cells))
        ]
        each = fit.terms[:, own][:, :3].copy()
        each[:, 1:] += each[:, :1]
        open_area = contact.sigma_area_mm2 / contact.area_mm2
        wider = steep(Loads.of(_grown(contact, contact.area_mm2 * (1 + open_area))))
        growth = wider[:, :3] - steep(load)[:, :3]
        growth[:, 1:] += growth[:, :1]
        body = np.zeros(len(wanted)) if fit.open_slopes is None else fit.open_slopes
        terms = np.concatenate([each, force * growth, *differences, body[:, None], fit.terms[:, -2:]], axis=1)
        shapes = load.forces[:3].copy()
        shapes[1:] += shapes[0]
        by_cell = np.vstack(
            [shapes, -force * open_area * shapes, unlike, np.zeros((_NO_FORCE, len(load.cells)))]
        )
        normal, right = load_fields.normal_equations(terms, wanted, fit.weight)
        return cls(normal, right, by_cell.T, force, open_area)

    def averaged(self, shape: int, *, pulls: bool) -> _Average:
        """By all sizes of the differences from one shape; pulls: less a punch."""
        kept = [shape, 3 + shape, *range(6, len(self.right))]
        # before anything is read, force and tilt may be anything, body and border are open by their sigma
        scale = np.array([np.inf, 1.0, *[self.force] * _MODES, 1.0, np.inf, np.inf])
        if pulls:
            kept.insert(1, _PUNCH)
            scale = np.insert(scale, 1, _PULL * self.force)
        part = _Known(
            self.normal[np.ix_(kept, kept)],
            self.right[kept],
            self.by_cell[:, kept],
            self.force,
            self.open_area,
        )
        sized = np.zeros(len(scale), bool)
        sized[-_MODES - _NO_FORCE : -_NO_FORCE] = True
        each = [
            part._solved(np.where(sized, size * scale, scale), pulls)._replace(size=float(size))
            for size in _SIZES
        ]
        return _mixed(each)

    def _solved(self, scale: Float, pulls: bool) -> _Average:
        """Answer for standard deviations (t,) of the unknowns; unless it pulls, no cell is below 0.

        Variances are without that; the evidence is but for a constant.
        """
        known = self.normal + np.diag(scale**-2)
        mean = np.linalg.solve(known, self.right)
        factor = np.linalg.slogdet(known)[1] + 2 * np.log(scale[np.isfinite(scale)]).sum()
        evidence = 0.5 * float(self.right @ mean - factor)
        lower = np.linalg.cholesky(known)
        reach = np.linalg.solve(lower, self.by_cell.T)
        variance = (reach**2).sum(axis=0)
        if not pulls:
            # its dual: pushes >= 0 on the cells that would be below 0; of columns of one size, or it may fail
            sigma = np.sqrt(variance)
            push = nnls(reach / sigma, -np.einsum("ut,u->t", lower, mean))[0] / sigma
            mean = mean + np.linalg.solve(known, np.einsum("ct,c->t", self.by_cell, push))
        pull = float(mean[1]) if pulls else 0.0
        grown = float(mean[2 if pulls else 1])
        forces = np.einsum("ct,t->c", self.by_cell, mean)
        return _Average(evidence, 0.0, self.open_area * grown, pull, forces, variance)
