"""Lattice crossings in two images: found, numbered, followed from the first into the second.

Section 5 of the paper picks them by hand, at whole pixels; here between pixels, which `whole` rounds.
Convention: positions (u, v) = (column, row) in px, pixel centres at integers.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Ints
from zeromethod.errors import MeasurementError

_SMOOTHING = 0.09
"""Gaussian sigma over the period: about a dark line's width, so that a crossing becomes a round dip."""
_LIGHTING = 0.8
"""Gaussian sigma over the period of the brightness that the image is divided by."""
_QUADRANT = 0.2
"""Distance over the period, along u and v, at which arms and squares of a crossing are sampled."""
_RISE = 0.15
"""How much brighter than the arms the squares must be, as a share of the local brightness."""
_STILL = 0.2
"""A crossing within this share of the period of its place at rest has not moved."""
_REACH = 1.8
"""Longest way to the next crossing, over the period."""
_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))


@dataclass(frozen=True, slots=True)
class Picks:
    """The same crossings in both images: index (n, 2) whole (along u, along v); before, after (n, 2) px."""

    index: Ints
    before: Float
    after: Float

    def whole(self) -> Picks:
        """The picks as a hand would make them: whole pixels."""
        return Picks(self.index, np.rint(self.before), np.rint(self.after))

    def line(self, row: int) -> Picks:
        """Crossings of one lattice line along u, in order."""
        chosen = np.flatnonzero(self.index[:, 1] == row)
        chosen = chosen[np.argsort(self.index[chosen, 0])]
        return Picks(self.index[chosen], self.before[chosen], self.after[chosen])


def find_crossings(image: NDArray[np.generic], period_px: float) -> Float:
    """Find crossings (n, 2) of dark lines about `period_px` apart (0.6 to 1.6 of it) on a light ground.

    A crossing is a dip of the smoothed image, brightness divided out, with dark arms on all four sides and
    lighter squares between them; its place is where the middles of its lines meet (within 0.1 px).
    """
    grey = np.asarray(image, dtype=np.float64)
    lighting = cv2.GaussianBlur(grey, (0, 0), _LIGHTING * period_px, borderType=cv2.BORDER_REFLECT)
    smooth = cv2.GaussianBlur(grey, (0, 0), _SMOOTHING * period_px, borderType=cv2.BORDER_REFLECT)
    smooth = smooth / np.maximum(lighting, 1e-3 * float(grey.max()) + 1e-9)
    lowest = cv2.erode(smooth, np.ones((3, 3)))
    arm = round(_QUADRANT * period_px)
    margin = arm + 2
    v, u = np.nonzero(smooth[margin:-margin, margin:-margin] == lowest[margin:-margin, margin:-margin])
    u, v = u + margin, v + margin
    squares = np.stack([smooth[v + b, u + a] for a in (-arm, arm) for b in (-arm, arm)])
    arms = np.stack([lowest[v + arm * b, u + arm * a] for a, b in _SIDES])
    crossed = squares.min(axis=0) > arms.max(axis=0) + _RISE
    u, v = u[crossed], v[crossed]
    places = [_between_edges(grey, int(a), int(b), arm) for a, b in zip(u, v, strict=True)]
    return np.array(places, dtype=np.float64).reshape(-1, 2)


def _between_edges(grey: Float, u: int, v: int, arm: int) -> tuple[float, float]:
    """Place (u, v) of a crossing near a whole pixel: the middle of its dark lines, half an arm away from it.

    Each edge lies where the grey passes half way from the line's darkest to the light on that edge's own
    side: the mirror may reflect more on one side of a line than on the other.
    """
    arms = []
    for patch, centre in ((grey, (v, u)), (grey.T, (u, v))):
        along, across = centre
        middles = []
        for side in (-1, 1):
            rows = slice(along + side * arm - 1, along + side * arm + 2)
            profile = patch[rows, max(across - 2 * arm, 0) : across + 2 * arm + 1].mean(axis=0)
            start = min(across, 2 * arm)
            first = start - arm // 2
            bottom = first + int(np.argmin(profile[first : start + arm // 2 + 1]))
            right = _edge(profile[bottom:], arm)
            left = _edge(profile[bottom::-1], arm)
            middles.append(across - start + bottom + (right - left) / 2)
        arms.append(sum(middles) / 2)
    return arms[0], arms[1]


def _edge(profile: Float, reach: int) -> float:
    """Way from the profile's start to where it first passes half way up to the light within `reach`."""
    light = float(profile[: reach + 1].max())
    half = (float(profile[0]) + light) / 2
    above = int(np.argmax(profile >= half))
    if above == 0:
        return 0.0
    return above - (float(profile[above]) - half) / float(profile[above] - profile[above - 1])


def pick(
    before: NDArray[np.generic], after: NDArray[np.generic], period_px: float, origin_px: tuple[float, float]
) -> Picks:
    """Crossings visible in both images, numbered from the one at `origin_px` (u, v) in the first.

    The first image is of the mirror at rest: its lattice is square, `period_px` apart. In the second the
    numbers are carried from crossing to crossing, starting at the lattice's border, where they hardly
    moved: so displacements of more than a period are followed. Crossings whose neighbours contradict them
    (a fold, a missed one) are left out. Raises MeasurementError where an image shows no lattice.
    """
    at_rest = find_crossings(before, period_px)
    index = np.rint((at_rest - origin_px) / period_px).astype(np.int64)
    near = np.max(np.abs(at_rest - origin_px - period_px * index), axis=-1) < _STILL * period_px
    rest = {(int(i), int(j)): place for (i, j), place in zip(index[near], at_rest[near], strict=True)}
    if len(rest) < 4:
        raise MeasurementError("no lattice is visible in the image before the press")
    candidates = find_crossings(after, period_px)
    followed = _follow(rest, candidates, _neighbours(candidates, period_px), period_px)
    if not followed:
        raise MeasurementError("no lattice is visible in the image after the press")
    keys = sorted(followed)
    return Picks(
        np.array(keys, dtype=np.int64),
        np.array([rest[key] for key in keys]),
        np.array([candidates[followed[key]] for key in keys]),
    )


def _neighbours(places: Float, period_px: float) -> Ints:
    """Next crossing (n, 4) on each of the `_SIDES`, -1 where there is none or the two disagree."""
    found = np.full((len(places), 4), -1)
    if len(places) < 2:
        return found
    offset = places[None] - places[:, None]
    distance = np.linalg.norm(offset, axis=-1)
    for side, (a, b) in enumerate(_SIDES):
        along, across = offset @ (a, b), np.abs(offset @ (b, a))
        reached = (along > across) & (distance < _REACH * period_px)
        nearest = np.argmin(np.where(reached, distance, np.inf), axis=1)
        found[:, side] = np.where(reached.any(axis=1), nearest, -1)
    back = found[found, [1, 0, 3, 2]] == np.arange(len(places))[:, None]
    return np.where(back & (found >= 0), found, -1)


def _follow(
    rest: dict[tuple[int, int], Float], candidates: Float, neighbours: Ints, period_px: float
) -> dict[tuple[int, int], int]:
    """Candidate of each lattice point, spread from the border of the lattice along the neighbours."""
    names: dict[int, tuple[int, int]] = {}
    for point, place in rest.items():
        if not rest.keys() >= set(_next_to(point)):
            misses = np.linalg.norm(candidates - place, axis=-1)
            if misses.min(initial=np.inf) < _STILL * period_px:
                names[int(np.argmin(misses))] = point
    around: dict[int, list[tuple[int, tuple[int, int]]]] = {}
    queue = deque(names)
    while queue:
        here = queue.popleft()
        pairs = zip(neighbours[here].tolist(), _next_to(names[here]), strict=True)
        around[here] = [(there, point) for there, point in pairs if there >= 0]
        for there, point in around[here]:
            if there not in names:
                names[there] = point
                queue.append(there)
    agreed = {here: all(names[there] == point for there, point in around[here]) for here in names}
    return {point: here for here, point in names.items() if agreed[here] and point in rest}


def _next_to(point: tuple[int, int]) -> list[tuple[int, int]]:
    return [(point[0] + a, point[1] + b) for a, b in _SIDES]
