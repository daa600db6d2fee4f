"""The peak of a mirror that something touches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from zeromethod.arrays import Mask
from zeromethod.contact.contact import LEAST_MM2, Contact
from zeromethod.surface import Peak, Surface, Where
from zeromethod.surface.holes import tip_in_holes_mm

_BESIDE = np.ones((5, 5), np.uint8)
"""A peak within two nodes of a contact's hole stands beside it."""


def _deepest(inside: Surface, nodes: Mask) -> tuple[int, int]:
    """Node of largest |depth| among some."""
    row, col = np.unravel_index(int(np.argmax(np.where(nodes, np.abs(inside.depth_mm), -1.0))), nodes.shape)
    return int(row), int(col)


def deepest_of_all(
    surface: Surface, measured: Peak, contacts: Sequence[Contact], lit: Mask | None = None
) -> Peak:
    """The peak, inside a contact where that goes deeper than what was measured.

    Its place is known as well as the bottom is flat: the spread of all nodes about as deep. Beside a hole
    that went dark, in which no contact could be outlined, sigma has what a tip may reach there. lit: nodes
    (rows, cols) that had light before; others, as next to where the view ends, have lost none. None: all.
    """
    inside = surface.inside
    if inside is not None:
        at = _deepest(inside, inside.valid)
        x, y = inside.x_mm, inside.y_mm
        peaks = [(one.depth_mm, one.sigma_depth_mm, one.x_mm, one.y_mm) for one in contacts]
        here = inside.depth_mm[at], inside.sigma_depth_mm[at], x[at], y[at]
        depth, sigma, *place = (float(one) for one in max([*peaks, here], key=lambda one: abs(one[0])))
        if not abs(depth) <= abs(measured.depth_mm):
            alike = inside.valid & (np.abs(inside.depth_mm - depth) <= sigma)
            alike[at] = True
            apart = (
                float(np.sqrt(np.mean((one[alike] - here) ** 2)))
                for one, here in zip((x, y), place, strict=True)
            )
            stated = (float(one[at]) for one in (surface.sigma_x_mm, surface.sigma_y_mm))
            sigma_x, sigma_y = (math.hypot(*pair) for pair in zip(apart, stated, strict=True))
            return Peak(depth, place[0], place[1], sigma, 0.0, sigma_x, sigma_y, Where.INSIDE)
    hole = inside.valid if inside is not None else surface.contact if lit is None else surface.contact & lit
    away = np.hypot(surface.x_mm - measured.x_mm, surface.y_mm - measured.y_mm)
    if not np.isfinite(away).any():
        return measured
    node = np.unravel_index(int(np.nanargmin(away)), away.shape)
    near = np.zeros(hole.shape, np.uint8)
    near[node] = 1
    beside = hole & (cv2.dilate(near, _BESIDE) > 0)
    if not beside.any():
        return measured
    tip_mm = 0.0
    if inside is None and surface.cut_off is None and not contacts:
        tip_mm = tip_in_holes_mm(surface, beside, measured.depth_mm, LEAST_MM2)
    sigma_mm, deeper_mm = (math.hypot(one, tip_mm) for one in (measured.sigma_mm, measured.deeper_mm))
    return replace(measured, where=Where.BESIDE, sigma_mm=sigma_mm, deeper_mm=deeper_mm)
