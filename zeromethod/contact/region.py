"""Regions of a frame in which something touches: flat, darker than the picture was, and not so at rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Image, Mask, Single
from zeromethod.contact.flat import flat_places
from zeromethod.contact.likelihood import UNKNOWN, GreyModel, grey_model
from zeromethod.contact.median import median
from zeromethod.contact.parts import BRIGHTEST, MOST_FILLED, Parts, closed_over, narrow_parts
from zeromethod.contact.pieces import disc, pieces
from zeromethod.contact.rest import RestPicture
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import NodeGrid

LOST_SHARE = 0.6
"""Share of a node's carrier at rest below which a contact is looked for around it."""
DIM_SHARE = 0.92
"""Share of a node's light at rest below which it is, too. A contact of 1 mm^2, 12 px across, takes a tenth of
a node's even where it is white; noise and flicker take less than a hundredth."""
DARKER_SHARE = 0.6
"""Share of the picture's mean light below which flat light may be an object's. A white one scatters 0.3 of
it; a picture that is lost in a fold, or finer than the LCD, keeps the mean."""
SEED_PX = 6
"""Flat pixels in one piece from which on a region is looked at. All 7 x 7 px around each are of one level, so
that a contact of 9 px across has them."""
NARROW_PX, NARROW_SEED_PX = 4, 24
"""Side of the flat squares of a narrow contact, a rod's, and how many in one piece, no brighter than an
object. They cover about as much as SEED_PX of the wider ones; dark spots and stripes of pictures that were
bent as far as folds had 8 at most."""
_NOISES = 2.0
"""Deviation, in those of the camera, up to which a place counts as flat."""
_SHADOW_SHARE = 0.03
"""Light over the mean below which a region next to a brighter one is its shadow: a slope too steep for total
reflection."""
_SMOOTH_PX = 5
"""Side of the square over which the evidence of pixels is averaged; they count as `_SMOOTH_PX` independent
ones."""
_ALIKE_NOISES = 2.0
"""Deviation, in those of one pixel, up to which 3 x 3 px count as of one level."""
_WIDE_PX, _WIDE_NARROW_PX, _NEAR_PX = 5, 3, 7
"""Least width of what is of one level, and that in narrow contacts; how far beyond it a region reaches where
a border blurs."""
_LEAST_WHOLE = 0.7
"""Share of a region that its widest piece must have."""
_LEAST_PART_PX, _LEAST_WIDE_PX, _SMOOTH_PARTS_PX = 10, 7, 3
"""Where what touches has narrow parts: pixels of the smallest part; least width of all parts together, gaps
closed; side of the square over which evidence is averaged."""


@dataclass(frozen=True, slots=True)
class Region:
    """mask, probability, columns (`GreyModel.index`): (rows, cols) from pixel (left, top) on.

    parted: it has parts with something else between, which its mask takes in. border_px: standard deviation
    of how much further in or out its whole border may lie.
    """

    left: int
    top: int
    mask: Mask
    probability: Single
    columns: Bytes
    model: GreyModel
    scattered: float
    parted: bool = False
    border_px: float = 0.0


class RegionFinder:
    """Finds the regions of frames."""

    def __init__(self, rig: Rig, grid: NodeGrid, blur_px: float) -> None:
        noise = rig.camera.noise
        self._black, self._blur_px = noise.black_grey, blur_px
        per_grey = 0.0 if noise.electrons_per_grey is None else 1 / noise.electrons_per_grey
        self.noise = noise.read_grey**2 + 1 / 12, per_grey
        self._grid = grid
        self._models: dict[tuple[float, float], GreyModel] = {}

    def find(self, image: Image, residual: Residual, rest: RestPicture) -> list[Region]:
        """Regions in contact, largest first."""
        lost = rest.lost(residual, LOST_SHARE, DIM_SHARE)
        if not lost.any():
            return []
        drift = rest.drift(residual)
        found = []
        for box in self._boxes(lost):
            inside = self._in_box(box, image, rest, drift, lost)
            found += self._together([region for region in inside if not _is_shadow(region, inside)])
        found.sort(key=lambda region: -np.count_nonzero(region.mask))
        return [region for region in found if not _is_shadow(region, found)]

    def _together(self, regions: list[Region]) -> list[Region]:
        """Regions of one box, those nearer than a period to each other as one: it has the largest's light."""
        if len(regions) < 2:
            return regions
        whole = np.logical_or.reduce([region.mask for region in regions])
        _, labels = cv2.connectedComponents(closed_over(whole, self._grid.period_px).astype(np.uint8))
        found = []
        # between three, a piece may close over that hangs together with none of them
        for k in np.unique(labels[whole]):
            parts = [region for region in regions if (labels[region.mask] == k).any()]
            largest = max(parts, key=lambda region: np.count_nonzero(region.mask))
            if len(parts) > 1:
                likely = np.maximum.reduce([region.probability for region in parts])
                largest = replace(largest, mask=labels == k, probability=likely, parted=True)
            found.append(largest)
        return found

    def _boxes(self, lost: Mask) -> Iterator[tuple[int, int, int, int]]:
        """(left, top, right, bottom) px around groups of nodes, three half periods wider."""
        row, col = (int(np.flatnonzero(lost.any(axis=axis))[0]) for axis in (1, 0))
        last_row, last_col = (int(np.flatnonzero(lost.any(axis=axis))[-1]) for axis in (1, 0))
        row, col = max(row - 2, 0), max(col - 2, 0)
        wide = cv2.dilate(
            lost[row : last_row + 3, col : last_col + 3].view(np.uint8), np.ones((5, 5), np.uint8)
        )
        count, _, stats, _ = cv2.connectedComponentsWithStats(wide, connectivity=8)
        rows, cols = self._grid.image_shape
        spacing = self._grid.spacing_px
        u, v = self._grid.u_px[col:], self._grid.v_px[row:]
        for left, top, width, height, _ in stats[1:count]:
            first = max(int(u[left]) - spacing, 0), max(int(v[top]) - spacing, 0)
            last = int(u[left + width - 1]) + spacing, int(v[top + height - 1]) + spacing
            right, bottom = min(last[0], cols), min(last[1], rows)
            if right - first[0] > 2 * spacing and bottom - first[1] > 2 * spacing:
                yield (*first, right, bottom)

    def _in_box(
        self, box: tuple[int, int, int, int], image: Image, rest: RestPicture, drift: float, lost: Mask
    ) -> list[Region]:
        left, top, right, bottom = box
        place = slice(top, bottom), slice(left, right)
        picture = image[place].astype(np.float32) - np.float32(self._black)
        mean = rest.mean[place] * np.float32(drift)
        clean = ~rest.static[place]
        taken = np.zeros(clean.shape, np.bool_)

        def grown(flat: Mask, least_px: int, wide_px: int) -> list[Region]:
            labels, sizes = pieces(clean & flat)
            result = []
            for k in np.argsort(-sizes)[: np.count_nonzero(sizes >= least_px)]:
                seed = labels == k
                if taken[seed].any():
                    continue
                region = self._grown(seed, picture, mean, rest, (left, top), wide_px)
                if region is not None:
                    taken[region.mask] = True
                    result.append(region)
            return result

        found = grown(flat_places(picture, DARKER_SHARE * mean, self.noise, _NOISES), SEED_PX, _WIDE_PX)
        light = picture / mean
        middle = median(mean[::4, ::4])
        noise = float(np.sqrt(self.noise[0] + self.noise[1] * 0.3 * middle)) / middle
        dark = self._pixels(lost, box) & clean
        parts = narrow_parts(light, noise, dark, self._grid.period_px, taken)
        if parts is not None:
            wide = self._of_parts(parts, picture, mean, rest, (left, top))
            found = [one for one in found if not any((one.mask & each.mask).any() for each in wide)] + wide
        if found:
            return found
        narrow = flat_places(picture, BRIGHTEST * mean, self.noise, _NOISES, NARROW_PX)
        return grown(narrow, NARROW_SEED_PX, _WIDE_NARROW_PX)

    def _pixels(self, nodes: Mask, box: tuple[int, int, int, int]) -> Mask:
        """Pixels of a box that are nearest to some nodes."""
        left, top, right, bottom = box
        near = [
            np.clip(np.rint((np.arange(low, high) - first) / self._grid.spacing_px).astype(int), 0, count - 1)
            for low, high, first, count in (
                (top, bottom, self._grid.v_px[0], nodes.shape[0]),
                (left, right, self._grid.u_px[0], nodes.shape[1]),
            )
        ]
        return np.asarray(nodes[near[0]][:, near[1]])

    def _of_parts(
        self, parts: Parts, picture: Single, mean: Single, rest: RestPicture, corner: tuple[int, int]
    ) -> list[Region]:
        """The regions of narrow parts, the gaps between them taken in."""
        mirrored = median(mean[parts.where])
        model = self._model(parts.light * mirrored, mirrored, rest)
        # tips of the parts run out of where they are common
        side = 2 * self._grid.period_px + 1
        near = cv2.dilate(parts.where.view(np.uint8), np.ones((side, side), np.uint8))
        across, down, width, height = cv2.boundingRect(near)
        box = slice(down, down + height), slice(across, across + width)
        columns = model.index(picture[box] * (mirrored / mean[box]))
        evidence = cv2.boxFilter(model.evidence[columns], -1, (_SMOOTH_PARTS_PX, _SMOOTH_PARTS_PX))
        evidence[near[box] == 0] = -np.inf
        likely = evidence > 0
        labels, sizes = pieces(likely, connectivity=8)
        small = sizes < _LEAST_PART_PX
        small[0] = False
        gone = small[labels]
        likely[gone], evidence[gone] = False, -np.inf
        closed = closed_over(likely, self._grid.period_px).view(np.uint8)
        # dark fringes that happen to join on are narrow
        whole = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((_LEAST_WIDE_PX, _LEAST_WIDE_PX), np.uint8))
        count, labels = cv2.connectedComponents(whole)
        found = []
        for k in range(1, count):
            here = labels == k
            if (here & parts.where[box]).any() and np.mean(likely[here]) <= MOST_FILLED:
                mask, own = np.zeros(parts.where.shape, np.bool_), np.zeros(parts.where.shape, np.float32)
                mask[box] = here
                own[box][here] = 1 / (1 + np.exp(-_SMOOTH_PARTS_PX * evidence[here]))
                unknown = np.full(mask.shape, UNKNOWN, np.uint8)
                found.append(Region(*corner, mask, own, unknown, model, parts.light, parted=True))
        return found

    def _grown(
        self,
        seed: Mask,
        picture: Single,
        mean: Single,
        rest: RestPicture,
        corner: tuple[int, int],
        wide_px: int,
    ) -> Region | None:
        """The region about a flat seed, `wide_px` wide and more."""
        left, top = corner
        dirt = rest.static[top : top + seed.shape[0], left : left + seed.shape[1]]
        scattered, mirrored = median(picture[seed]), median(mean[seed])
        model = self._model(scattered, mirrored, rest)
        grey = picture * (mirrored / mean)
        columns = model.index(grey)
        columns[dirt] = UNKNOWN
        # pixels of one window are not as independent as their product has it: one carrier for all of them
        evidence = cv2.boxFilter(model.evidence[columns], -1, (_SMOOTH_PX, _SMOOTH_PX))
        probability = (1 / (1 + np.exp(-_SMOOTH_PX * evidence))).astype(np.float32)
        count, labels = cv2.connectedComponents((probability > 0.5).astype(np.uint8), connectivity=4)
        inside = labels[seed]
        label = int(np.bincount(inside, minlength=count)[1:].argmax()) + 1 if count > 1 else 0
        mask = labels == label
        if not label or not mask.any():
            return None
        mask = _with_dirt(self._without_fringes(mask, grey, scattered, wide_px), dirt)
        return Region(*corner, mask, probability, columns, model, scattered / mirrored)

    def _without_fringes(self, mask: Mask, grey: Single, scattered: float, wide_px: int) -> Mask:
        """A region less what sticks out of it and is not of one grey level: dark fringes that join on.

        grey: (rows, cols) levels over that of the picture beside. What would lose most of itself stays.
        """
        noise = np.sqrt(self.noise[0] + self.noise[1] * max(scattered, 0.0))
        alike = mask & (np.abs(cv2.boxFilter(grey, -1, (3, 3)) - scattered) < _ALIKE_NOISES * noise)
        whole = cv2.morphologyEx(alike.astype(np.uint8), cv2.MORPH_OPEN, disc(wide_px))
        near = np.asarray(cv2.dilate(whole, disc(_NEAR_PX)), np.uint8)
        labels, sizes = pieces(mask & (near > 0))
        if len(sizes) < 2:
            return mask
        largest = int(np.argmax(sizes))
        enough = sizes[largest] > _LEAST_WHOLE * np.count_nonzero(mask)
        return np.asarray(labels == largest) if enough else mask

    def _model(self, scattered: float, mirrored: float, rest: RestPicture) -> GreyModel:
        key = round(scattered), round(mirrored)
        if key not in self._models:
            if len(self._models) > 32:
                self._models.clear()
            self._models[key] = grey_model(*key, rest.levels, rest.shares, self._blur_px, self.noise)
        return self._models[key]


def _with_dirt(mask: Mask, dirt: Mask) -> Mask:
    """A region with the dirt that bites into it: what a line round it takes in and hangs together with it."""
    if not (dirt & (cv2.dilate(mask.view(np.uint8), disc(3)) > 0)).any():
        return mask
    hull = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(cv2.findNonZero(mask.view(np.uint8))), 1)
    _, labels = cv2.connectedComponents((mask | (dirt & (hull > 0))).view(np.uint8))
    return np.asarray(np.isin(labels, np.unique(labels[mask])))


def _is_shadow(region: Region, others: list[Region]) -> bool:
    """Whether a dark region lies against a brighter one."""
    if region.scattered > _SHADOW_SHARE:
        return False
    for other in others:
        if other.scattered > region.scattered + _SHADOW_SHARE and _next_to(region, other):
            return True
    return False


def _next_to(one: Region, other: Region) -> bool:
    left, top = min(one.left, other.left), min(one.top, other.top)
    ends = [(r.left + r.mask.shape[1], r.top + r.mask.shape[0]) for r in (one, other)]
    whole = np.zeros((2, max(e[1] for e in ends) - top, max(e[0] for e in ends) - left), np.uint8)
    for layer, region in zip(whole, (one, other), strict=True):
        row, col = region.top - top, region.left - left
        layer[row : row + region.mask.shape[0], col : col + region.mask.shape[1]] = region.mask
    return bool((cv2.dilate(whole[0], np.ones((9, 9), np.uint8)) & whole[1]).any())
