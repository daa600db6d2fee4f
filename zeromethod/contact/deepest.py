"""How deep the mirror goes inside contacts: each contact's depth, and the peak with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from zeromethod.arrays import Mask
from zeromethod.contact.contact import Contact
from zeromethod.surface import Peak, Surface, Where

_BESIDE = np.ones((5, 5), np.uint8)
"""A peak within two nodes of a contact's hole stands beside it."""


def _deepest(inside: Surface, nodes: Mask) -> tuple[int, int]:
    """Node of largest |depth| among some."""
    row, col = np.unravel_index(int(np.argmax(np.where(nodes, np.abs(inside.depth_mm), -1.0))), nodes.shape)
    return int(row), int(col)


def with_depths(surface: Surface, contacts: Sequence[Contact]) -> tuple[Contact, ...]:
    """The contacts, each with the largest depth among the nodes within it."""
    inside, found = surface.inside, []
    for contact in contacts:
        if inside is not None:
            away = np.hypot(inside.x_mm - contact.x_mm, inside.y_mm - contact.y_mm)
            nodes = inside.valid & (away < contact.major_mm / 2)
            if nodes.any():
                at = _deepest(inside, nodes)
                depth, sigma = float(inside.depth_mm[at]), float(inside.sigma_depth_mm[at])
                contact = replace(contact, depth_mm=depth, sigma_depth_mm=sigma)  # noqa: PLW2901 - the same one
        found.append(contact)
    return tuple(found)


def deepest_of_all(surface: Surface, measured: Peak) -> Peak:
    """The peak, inside a contact where that goes deeper than what was measured.

    Its place is known as well as the bottom is flat: the spread of all nodes about as deep.
    """
    inside = surface.inside
    if inside is not None:
        at = _deepest(inside, inside.valid)
        depth, sigma = float(inside.depth_mm[at]), float(inside.sigma_depth_mm[at])
        if not abs(depth) <= abs(measured.depth_mm):
            alike = inside.valid & (np.abs(inside.depth_mm - depth) <= sigma)
            x, y = inside.x_mm, inside.y_mm
            apart = (float(np.sqrt(np.mean((one[alike] - one[at]) ** 2))) for one in (x, y))
            stated = (float(one[at]) for one in (surface.sigma_x_mm, surface.sigma_y_mm))
            sigma_x, sigma_y = (math.hypot(*pair) for pair in zip(apart, stated, strict=True))
            place = float(x[at]), float(y[at])
            return Peak(depth, *place, sigma, 0.0, sigma_x, sigma_y, Where.INSIDE)
    hole = surface.contact if inside is None else inside.valid
    away = np.hypot(surface.x_mm - measured.x_mm, surface.y_mm - measured.y_mm)
    if not np.isfinite(away).any():
        return measured
    node = np.unravel_index(int(np.nanargmin(away)), away.shape)
    beside = cv2.dilate(hole.astype(np.uint8), _BESIDE)[node] > 0
    return replace(measured, where=Where.BESIDE) if beside else measured
