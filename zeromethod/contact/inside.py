"""Depth inside contacts, carried in from around them by how rubber yields.

No light comes back from where something touches, but the slopes around and the border of the contact show how
deep it goes: what presses there follows from them (`zeromethod.contact.force_fit`), and makes the dent inside
as well. It is as deep as the nodes beside the border say; what they and the slopes leave open is sigma, which
grows inwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Mask
from zeromethod.contact.contact import Contact
from zeromethod.contact.force_fit import ForceFit
from zeromethod.contact.in_mm import MirrorPlaces
from zeromethod.contact.load_fields import load_fields
from zeromethod.contact.loads import SHAPES
from zeromethod.surface import Surface

_BODY = 0.03
"""What the half-space and the cells leave open of a pressure's dent, relative."""
_FEWEST = 4
"""Nodes beside a contact that must be read."""
_LARGEST_SHARE = 0.5
_UNEXPLAINED = 0.075
"""Share of the slopes beside contacts that no pressure inside them makes from which something presses around
them, too: at most 0.03 of hard objects, at least 0.18 of a pad that is wet in its middle alone."""
_MOST, _MOST_NORMAL = 0.75, 1.15
"""Share of these slopes of which that is said, as a mirror that folds may be off by any amount; below what
size so many normal numbers are."""
_STEEPEST = 0.5
"""Least change of depth along a ray, over that at one place: where it is less, the mirror folds."""


def carried_inside(
    surface: Surface, contacts: Sequence[Contact], places: MirrorPlaces, fit: ForceFit | None
) -> tuple[Surface | None, tuple[Contact, ...]]:
    """The nodes inside contacts and in the unread rims around them; and the contacts with their depths.

    The surface's valid nodes are those; none of them was measured. Their sigma has what objects' shapes leave
    open. A contact's depth is that in its middle, or of a node that is deeper. No surface, and contacts as
    they were, where nothing can be said of them, as where the mirror is pressed around them, too.
    """
    nothing = None, tuple(contacts)
    if fit is None:
        return nothing
    inside = _holes(surface, contacts)
    count = np.count_nonzero(inside)
    if not 0 < count <= _LARGEST_SHARE * np.count_nonzero(surface.on_mirror):
        return nothing
    beside = _Beside.of(surface, contacts, fit)
    if beside is None or _unexplained(surface, fit) > _UNEXPLAINED:
        return nothing
    nearest = _nearest(np.stack([surface.x_mm[inside], surface.y_mm[inside]], axis=-1), contacts)
    middles = np.array([(one.x_mm, one.y_mm) for one in contacts])
    at = np.concatenate([places.at_depth(inside, beside.depth_mm[nearest]), middles])
    nearest = np.append(nearest, np.arange(len(contacts)))
    terms, steep, depth = _dent(fit, beside, nearest, at)
    slope = np.einsum("nkt,t->nk", steep, fit.mean)
    # deeper nodes are seen elsewhere, where the mirror is as much deeper again as it slopes
    per_mm = places.at_depth(inside, beside.depth_mm[nearest[:count]] + 1.0) - at[:count]
    deeper = (depth - beside.depth_mm[nearest])[:count]
    deeper /= np.maximum(1 - (slope[:count] * per_mm).sum(axis=1), _STEEPEST)
    at[:count] += deeper[:, None] * per_mm
    terms, steep, depth = _dent(fit, beside, nearest, at)
    slope = np.einsum("nkt,t->nk", steep, fit.mean)
    # at a rim that sticks, or a sharp one, depth falls so fast that its place counts
    edge = max(contact.sigma_edge_mm for contact in contacts)
    variance = beside.sigma_mm[nearest] ** 2 + edge**2 * (slope**2).sum(axis=1)
    variance += (np.einsum("nt,tu->nu", terms, fit.spread) * terms).sum(axis=1)
    size = np.repeat([one.sigma_area_mm2 / (2 * one.area_mm2) for one in contacts], SHAPES)
    # shape by shape: where a ball sticks, its pressure and the rim's nearly cancel
    open_share = (size**2 + _BODY**2) * fit.mean[:-2] ** 2
    variance += np.einsum("nt,t->n", terms[:, :-2] ** 2, open_share)
    bent = np.sqrt((np.einsum("nkt,tu->nku", steep, fit.spread) * steep).sum(axis=2))
    found = np.column_stack([depth, np.sqrt(variance), slope, bent, at])
    return _surface(surface, inside, found[:count]), _with_depths(contacts, found, nearest)


def _unexplained(surface: Surface, fit: ForceFit) -> float:
    """Share of the slopes beside contacts that pressures inside them do not make, without noise."""
    read = surface.valid.ravel()[fit.alone]
    slope, sigma = (one.reshape(-1, 2)[fit.alone][read] for one in (surface.slope, surface.sigma_slope))
    made = (fit.terms @ fit.mean).reshape(-1, 2)[fit.blocks.nodes == 1][read]
    left, size = np.quantile(np.abs([slope - made, slope]), _MOST, axis=(1, 2))
    return float(np.sqrt(max(left**2 - (_MOST_NORMAL * np.median(sigma)) ** 2, 0.0)) / size)


def _dent(
    fit: ForceFit, beside: _Beside, nearest: NDArray[np.intp], at_mm: Float
) -> tuple[Float, Float, Float]:
    """Depth less that beside, (n, t), and slope (n, 2, t) by each share, at points (n, 2); depth (n,)."""
    none = np.zeros_like(at_mm)
    fields = np.concatenate([load_fields(load, at_mm, none, within=True) for load in fit.loads], axis=2)
    steep = np.concatenate([fields[:, 1:], np.broadcast_to(np.eye(2), (len(at_mm), 2, 2))], axis=2)
    terms = np.concatenate([fields[:, 0] - beside.terms[nearest], at_mm - beside.at_mm[nearest]], axis=1)
    return terms, steep, beside.depth_mm[nearest] + np.einsum("nt,t->n", terms, fit.mean)


def _with_depths(contacts: Sequence[Contact], found: Float, nearest: NDArray[np.intp]) -> tuple[Contact, ...]:
    """found: (points, 2 + ...) depth and its sigma, the last those in the contacts' middles."""
    deep = []
    for k, contact in enumerate(contacts):
        middle = found[len(found) - len(contacts) + k, :2]
        away = np.hypot(*(found[:, -2:] - (contact.x_mm, contact.y_mm)).T)
        own = found[(nearest == k) & (away < contact.major_mm / 2), :2]
        depth, sigma = max([middle, *own], key=lambda row: abs(row[0]))
        # there may be a tip all the same
        sigma = max(sigma, middle[1])
        deep.append(replace(contact, depth_mm=float(depth), sigma_depth_mm=float(sigma)))
    return tuple(deep)


class _Beside:
    """The mirror beside each contact, where it is read.

    at_mm: (contacts, 2) mean place; depth_mm, sigma_mm: (contacts,) mean depth; terms: (contacts, t) of it by
    each share of a pressure.
    """

    def __init__(self, at_mm: Float, depth_mm: Float, sigma_mm: Float, terms: Float) -> None:
        self.at_mm, self.depth_mm, self.sigma_mm, self.terms = at_mm, depth_mm, sigma_mm, terms

    @classmethod
    def of(cls, surface: Surface, contacts: Sequence[Contact], fit: ForceFit) -> _Beside | None:
        """By the nodes that stand alone in the fit; None where a contact has too few."""
        node = fit.alone
        at = np.stack([surface.x_mm.ravel()[node], surface.y_mm.ravel()[node]], axis=-1)
        depth, sigma = surface.depth_mm.ravel()[node], surface.sigma_depth_mm.ravel()[node]
        read = surface.valid.ravel()[node] & np.isfinite(sigma)
        nearest = _nearest(at, contacts)
        rows = []
        for k in range(len(contacts)):
            own = read & (nearest == k)
            if np.count_nonzero(own) < _FEWEST:
                return None
            left = depth[own] - np.einsum("nt,t->n", fit.depths[own], fit.mean[:-2])
            rows.append(
                (at[own].mean(axis=0), depth[own].mean(), np.hypot(sigma[own].mean(), left.std()),
                 fit.depths[own].mean(axis=0))
            )  # fmt: skip
        return cls(*(np.array(part) for part in zip(*rows, strict=True)))


def _nearest(at_mm: Float, contacts: Sequence[Contact]) -> NDArray[np.intp]:
    """(n,) which contact's border each point (n, 2) is nearest to, as if all were round."""
    away = [np.hypot(*(at_mm - (one.x_mm, one.y_mm)).T) - one.major_mm / 2 for one in contacts]
    return np.asarray(np.argmin(away, axis=0))


def _holes(surface: Surface, contacts: Sequence[Contact]) -> Mask:
    """Nodes (rows, cols) in the holes that contacts make."""
    unknown = surface.on_mirror & ~surface.valid
    _, labels = cv2.connectedComponents(unknown.view(np.uint8), connectivity=4)
    inside = np.zeros(unknown.shape, bool)
    for contact in contacts:
        away = np.hypot(surface.x_mm - contact.x_mm, surface.y_mm - contact.y_mm) - contact.major_mm / 2
        holes = np.unique(labels[(away < 0) & unknown])
        inside |= np.isin(labels, holes[holes > 0])
    return inside


def _surface(surface: Surface, nodes: Mask, found: Float) -> Surface:
    """The carried nodes (rows, cols) as a surface; found: (n, 8) depth, sigma, slope, its sigma, place."""
    filled = np.full((*nodes.shape, found.shape[1]), np.nan)
    filled[..., -2:] = np.stack([surface.x_mm, surface.y_mm], axis=-1)
    filled[nodes] = found
    depth, sigma, _, _, _, _, x, y = np.moveaxis(filled, -1, 0).copy()
    return replace(
        surface,
        depth_mm=depth,
        sigma_depth_mm=sigma,
        slope=filled[..., 2:4].copy(),
        sigma_slope=filled[..., 4:6].copy(),
        x_mm=x,
        y_mm=y,
        valid=nodes,
        cut_off=None,
        curl=None,
    )
