"""Depth inside contacts, carried in from around them by how rubber yields.

No light comes back from where something touches, but the dent around it and the border of the contact show
how deep it goes: outside, depth is what the pressure inside makes of it, and rigid objects press in few ways
(`zeromethod.contact.loads`). They are mixed as the nodes around say; what these leave open is sigma, which
grows inwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.contact.contact import Contact
from zeromethod.contact.in_mm import MirrorPlaces
from zeromethod.contact.loads import SHAPES, Loads, shares
from zeromethod.surface import Surface

_BODY = 0.03
"""What the half-space and the cells leave open of a pressure's dent, relative."""
_ALIKE = 10.0
"""Nodes whose depths are off together, as windows overlap and slopes are summed up."""
_NEAR, _NEAR_MM, _FAR, _FAR_MM = 1.0, 0.5, 4.0, 3.0
_MOST = 400
"""All nodes within a half width and 0.5 mm of a contact are used, and some to 4 of them and 3 mm; so many
together."""
_FEWEST = 24
_LARGEST_SHARE = 0.5
_PASSES = 3


class _Fit(NamedTuple):
    """Unknowns' mean (n,) and covariance (n, n); where the quadratic has its middle, and its size."""

    mean: Float
    spread: Float
    middle: Float
    size_mm: float


def carried_inside(surface: Surface, contacts: Sequence[Contact], places: MirrorPlaces) -> Surface | None:
    """The nodes inside contacts and in the unread rims around them; None where nothing can be said of them.

    The result's valid nodes are those; none of them was measured. Their sigma has what objects' shapes leave
    open.
    """
    if not contacts:
        return None
    inside, around = _choose(surface, contacts)
    sigma = surface.sigma_depth_mm[around]
    if not inside.any() or sigma.size < _FEWEST or not np.isfinite(sigma).all():
        return None
    if np.count_nonzero(inside) > _LARGEST_SHARE * np.count_nonzero(surface.on_mirror):
        return None
    loads = [Loads.of(contact) for contact in contacts]
    at = np.stack([surface.x_mm[around], surface.y_mm[around]], axis=-1)
    fit = _fitted(loads, at, surface.depth_mm[around], sigma)
    depth = np.zeros(np.count_nonzero(inside))
    for _ in range(_PASSES):
        where = places.at_depth(inside, depth)
        terms = _depth_terms(loads, where, fit)
        depth = (terms * fit.mean).sum(axis=1)
    steep = _slope_terms(loads, where, fit)
    slope = np.einsum("ntk,t->nk", steep, fit.mean)
    # at a rim that sticks, or a sharp one, depth falls so fast that its place counts
    edge = max(contact.sigma_edge_mm for contact in contacts)
    variance = np.einsum("nt,tu,nu->n", terms, fit.spread, terms) + edge**2 * (slope**2).sum(axis=1)
    for k, contact in enumerate(contacts):
        own = slice(SHAPES * k, SHAPES * (k + 1))
        size = contact.sigma_area_mm2 / (2 * contact.area_mm2)
        # shape by shape: where a ball sticks, its pressure and the rim's nearly cancel
        variance += (size**2 + _BODY**2) * ((terms[:, own] * fit.mean[own]) ** 2).sum(axis=1)
    bent = np.sqrt(np.einsum("ntk,tu,nuk->nk", steep, fit.spread, steep))
    return _surface(surface, inside, where, (depth, np.sqrt(variance)), (slope, bent))


def _choose(surface: Surface, contacts: Sequence[Contact]) -> tuple[Mask, Mask]:
    """Nodes (rows, cols) in the holes that contacts make, and the measured ones around that are used."""
    unknown = surface.on_mirror & ~surface.valid
    _, labels = cv2.connectedComponents(unknown.view(np.uint8), connectivity=4)
    inside, near, far = (np.zeros(unknown.shape, bool) for _ in range(3))
    for contact in contacts:
        away = np.hypot(surface.x_mm - contact.x_mm, surface.y_mm - contact.y_mm) - contact.major_mm / 2
        holes = np.unique(labels[(away < 0) & unknown])
        inside |= np.isin(labels, holes[holes > 0])
        near |= away < _NEAR * contact.minor_mm / 2 + _NEAR_MM
        far |= away < _FAR * contact.minor_mm / 2 + _FAR_MM
    near, far = near & surface.valid, far & surface.valid
    return inside, _thinned(near, _MOST // 2) | _thinned(far & ~near, _MOST // 2)


def _thinned(nodes: Mask, most: int) -> Mask:
    """At most that many of the nodes, evenly."""
    found = np.flatnonzero(nodes)
    few = np.zeros(nodes.shape, bool)
    few.ravel()[found[:: -(-len(found) // most) or 1]] = True
    return few


def _quadratic(at_mm: Float, fit_middle: Float, size_mm: float) -> Float:
    x, y = ((at_mm - fit_middle) / size_mm).T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def _depth_terms(loads: list[Loads], at_mm: Float, fit: _Fit) -> Float:
    """(n, terms) depth of each unknown: a contact's pressures, then a quadratic.

    The quadratic stands for everything further away, and for the body's other faces.
    """
    return np.concatenate(
        [*(one.depth(at_mm) for one in loads), _quadratic(at_mm, fit.middle, fit.size_mm)], 1
    )


def _slope_terms(loads: list[Loads], at_mm: Float, fit: _Fit) -> Float:
    """(n, terms, 2) slope of each unknown."""
    x, y = ((at_mm - fit.middle) / fit.size_mm).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    along = np.stack([zero, one, zero, 2 * x, y, zero], axis=-1)
    across = np.stack([zero, zero, one, zero, x, 2 * y], axis=-1)
    quadratic = np.stack([along, across], axis=-1) / fit.size_mm
    return np.concatenate([*(one.slope(at_mm) for one in loads), quadratic], axis=1)


def _fitted(loads: list[Loads], at_mm: Float, depth: Float, sigma: Float) -> _Fit:
    """The pressures that the depths (n,) around say, sigma (n,) their standard deviation."""
    middle = np.mean([one.cells.mean(axis=0) for one in loads], axis=0)
    blank = _Fit(np.zeros(0), np.zeros((0, 0)), middle, float(np.abs(at_mm - middle).max()))
    terms = _depth_terms(loads, at_mm, blank) / sigma[:, None]
    wanted = depth / sigma
    count = terms.shape[1]
    force = np.arange(0, SHAPES * len(loads), SHAPES)
    alone = np.concatenate([force, np.arange(SHAPES * len(loads), count)])
    # balls alone say how large the forces are, and so how much is open
    newtons = np.asarray(np.linalg.lstsq(terms[:, alone], wanted, rcond=None)[0][: len(loads)], np.float64)
    normal = np.einsum("nt,nu->tu", terms, terms)
    mean, known = shares(normal, (terms * wanted[:, None]).sum(axis=0), newtons, _ALIKE)
    left = float(((wanted - (terms * mean).sum(axis=1)) ** 2).sum()) / max(len(depth) - count, 1)
    return blank._replace(mean=mean, spread=_ALIKE * max(left, 1.0) * np.linalg.inv(known))


def _surface(
    surface: Surface, nodes: Mask, at_mm: Float, depth: tuple[Float, Float], slope: tuple[Float, Float]
) -> Surface:
    """The carried nodes (rows, cols) as a surface; depth (n,), slope (n, 2), each with its sigma."""

    def filled(values: Float) -> Float:
        lattice = np.full(nodes.shape + values.shape[1:], np.nan)
        lattice[nodes] = values
        return lattice

    x_mm, y_mm = surface.x_mm.copy(), surface.y_mm.copy()
    x_mm[nodes], y_mm[nodes] = at_mm.T
    return replace(
        surface,
        depth_mm=filled(depth[0]),
        sigma_depth_mm=filled(depth[1]),
        slope=filled(slope[0]),
        sigma_slope=filled(slope[1]),
        x_mm=x_mm,
        y_mm=y_mm,
        valid=nodes,
        cut_off=None,
        curl=None,
    )
