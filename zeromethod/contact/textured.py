"""Regions in which something textured rubs: where the carrier is gone, whatever small parts of it touch."""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Image, Mask, Single
from zeromethod.contact.median import median
from zeromethod.contact.pieces import pieces
from zeromethod.contact.region import DIM_SHARE, LOST_SHARE, Region, RegionFinder
from zeromethod.contact.rest import RestPicture
from zeromethod.sensing.residual import Residual

_GAP_NODES = 6
"""Tips up to twice as many nodes apart are one region's."""
_FEWEST_NODES = 30
"""Lost nodes of the smallest region."""
_BORDER_NODES = 2.0
"""Standard deviation of where a region's border lies."""
_DARKEST = 0.02
"""Share of a region's pixels that are darker than the level taken as that of the tips."""


class TexturedFinder(RegionFinder):
    """Finds the regions of cloth, brushes, pile or sandpaper: one for all tips that lie near each other."""

    def find(self, image: Image, residual: Residual, rest: RestPicture) -> list[Region]:
        """Regions, largest first; `scattered` is the light of the tips, the probability 1 within a region."""
        lost = rest.lost(residual, LOST_SHARE, DIM_SHARE)
        if np.count_nonzero(lost) < _FEWEST_NODES:
            return []
        margin = 2 * _GAP_NODES
        wide = cv2.copyMakeBorder(lost.view(np.uint8), *4 * (margin,), cv2.BORDER_CONSTANT)
        side = 2 * _GAP_NODES + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        together = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, disc)[margin:-margin, margin:-margin] > 0
        labels, sizes = pieces(together, connectivity=8)
        drift = rest.drift(residual)
        parts = (self._of(labels == k, image, rest, drift) for k in np.flatnonzero(sizes >= _FEWEST_NODES))
        return sorted(
            (one for one in parts if one is not None), key=lambda region: -np.count_nonzero(region.mask)
        )

    def _of(self, nodes: Mask, image: Image, rest: RestPicture, drift: float) -> Region | None:
        rows, cols = (np.flatnonzero(nodes.any(axis=axis)) for axis in (1, 0))
        spacing = self._grid.spacing_px
        height, width = self._grid.image_shape
        top, left = (
            max(int(axis[at[0]]) - spacing, 0)
            for axis, at in ((self._grid.v_px, rows), (self._grid.u_px, cols))
        )
        bottom = min(int(self._grid.v_px[rows[-1]]) + spacing, height)
        right = min(int(self._grid.u_px[cols[-1]]) + spacing, width)
        if bottom - top < 2 * spacing or right - left < 2 * spacing:
            return None
        mask = self._pixels(nodes, (left, top, right, bottom))
        place = slice(top, bottom), slice(left, right)
        picture = image[place].astype(np.float32) - np.float32(self._black)
        mean = np.maximum(rest.mean[place] * np.float32(drift), 1.0)
        inside = mask & ~rest.static[place]
        if not inside.any():
            return None
        light: Single = picture[inside] / mean[inside]
        scattered, mirrored = float(np.quantile(light, _DARKEST)), median(mean[inside])
        model = self._model(max(scattered, 0.0) * mirrored, mirrored, rest)
        columns = model.index(picture * (mirrored / mean))
        # nodes around are lost, too: their windows reach into it, and the rubber beside its rim is steep
        border_px = _BORDER_NODES * float(spacing)
        likely = mask.astype(np.float32)
        return Region(left, top, mask, likely, columns, model, scattered, parted=True, border_px=border_px)
