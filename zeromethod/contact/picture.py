"""What touches as an image: a contact's light, rectified to mm at the camera's resolution."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Single
from zeromethod.contact.contact import Contact, ContactImage
from zeromethod.surface import Surface
from zeromethod.warp.grid import NodeGrid

_MARGIN_MM = 0.25
"""Margin of an image around the contact."""
_DEGREE = 6
"""Of the polynomials: cubic ones stretch a finger's image by 1.3 %, these by 0.2 %."""
_AROUND = 3
"""Nodes around a contact's box that place it, too."""
_MOST_NODES, _FEWEST_NODES = 500, 56
"""Nodes to which the polynomials are fitted, evenly chosen, and fewest: twice their 28 coefficients."""
_MOST_PX = 1536
"""Longest side of an image; a larger contact's is coarser."""


@dataclass(frozen=True, slots=True)
class Places:
    """Camera position (u, v) as a polynomial of mirror position (x, y).

    powers: (2, degree + 1, degree + 1) factors, for u and v, of y^i x^k, both from the middle over size_mm.
    """

    middle: Float
    size_mm: float
    powers: Float

    def pixels(self, x: Float, y: Float) -> Float:
        """(rows, cols, 2) px of a lattice of world points at x (cols,), y (rows,), mm."""
        up_to = np.arange(_DEGREE + 1)
        along = ((x - self.middle[0]) / self.size_mm)[:, None] ** up_to
        across = ((y - self.middle[1]) / self.size_mm)[:, None] ** up_to
        return np.stack([across @ one @ along.T for one in self.powers], axis=-1)

    @property
    def finest_mm(self) -> float:
        """Shorter side of a camera pixel on the mirror, in the middle."""
        by_x, by_y = self.powers[:, 0, 1], self.powers[:, 1, 0]
        return float(self.size_mm / max(np.hypot(*by_x), np.hypot(*by_y)))


def _fitted(x: Float, y: Float, values: Float) -> Float:
    """(2, degree + 1, degree + 1) powers, as `Places` has them, of values (n, 2) at points (n,)."""
    used = [(i, n - i) for n in range(_DEGREE + 1) for i in range(n + 1)]
    terms = np.stack([y**i * x**k for i, k in used], axis=-1)
    found = np.linalg.lstsq(terms, values, rcond=None)[0]
    powers = np.zeros((2, _DEGREE + 1, _DEGREE + 1))
    for (i, k), factor in zip(used, found, strict=True):
        powers[:, i, k] = factor
    return powers


def places_of(contact: Contact, surface: Surface, grid: NodeGrid) -> Places | None:
    """Where the camera sees the mirror about a contact; None where too few nodes have a depth."""
    low, high = contact.outline_px.min(axis=0), contact.outline_px.max(axis=0)
    first = np.array([grid.u_px[0], grid.v_px[0]])
    begin = np.maximum(np.floor((low - first) / grid.spacing_px).astype(int) - _AROUND, 0)
    end = np.ceil((high - first) / grid.spacing_px).astype(int) + _AROUND + 1
    part = slice(begin[1], end[1]), slice(begin[0], end[0])
    u, v = (axis[part] for axis in grid.mesh())
    x, y, known = surface.x_mm[part].copy(), surface.y_mm[part].copy(), surface.valid[part].copy()
    if surface.inside is not None:
        carried = surface.inside.valid[part]
        x[carried], y[carried] = surface.inside.x_mm[part][carried], surface.inside.y_mm[part][carried]
        known |= carried
    if np.count_nonzero(known) < _FEWEST_NODES:
        return None
    every = max(1, round(float(np.sqrt(np.count_nonzero(known) / _MOST_NODES))))
    thin = np.zeros_like(known)
    thin[::every, ::every] = True
    known &= thin
    middle = np.array([contact.x_mm, contact.y_mm])
    size = 0.5 * max(float(np.ptp(x[known])), float(np.ptp(y[known])))
    seen = np.stack((u[known], v[known]), axis=-1).astype(np.float64)
    powers = _fitted((x[known] - middle[0]) / size, (y[known] - middle[1]) / size, seen)
    return Places(middle, size, powers)


def image_of(
    contact: Contact, image: Image, mean: Single, drift: float, black: float, places: Places
) -> ContactImage:
    """The image of a contact: light over that of the picture in the null.

    mean: (rows, cols) grey levels of that at rest. drift: light over that at rest.
    """
    low = contact.outline_mm.min(axis=0) - _MARGIN_MM
    span = contact.outline_mm.max(axis=0) + _MARGIN_MM - low
    pitch = max(places.finest_mm, float(span.max()) / (_MOST_PX - 1))
    cols, rows = (int(np.ceil(side / pitch)) + 1 for side in span)
    at = places.pixels(low[0] + pitch * np.arange(cols), low[1] + pitch * np.arange(rows))
    first = np.clip(np.floor(at.min(axis=(0, 1))).astype(int) - 3, 0, None)
    last = np.ceil(at.max(axis=(0, 1))).astype(int) + 4
    part = slice(first[1], max(last[1], 0)), slice(first[0], max(last[0], 0))
    if image[part].size == 0:
        return ContactImage(np.full((rows, cols), np.nan, np.float32), pitch, float(low[0]), float(low[1]))
    light = (image[part].astype(np.float32) - np.float32(black)) / np.maximum(
        np.float32(drift) * mean[part], 1.0
    )
    off = (at - first).astype(np.float32)
    seen = cv2.remap(
        light, off[..., 0], off[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )  # fmt: skip
    return ContactImage(np.asarray(seen, np.float32), pitch, float(low[0]), float(low[1]))
