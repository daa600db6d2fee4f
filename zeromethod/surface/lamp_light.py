"""Expected light over that at rest, where a lamp at the camera lights the pattern by way of the mirror.

Light is reflected twice, going and coming: the share of the reflectance counts squared. Where the mirror
focuses the lamp, so that a camera pixel sees less of the pattern than at rest, that little gets as much of
the lamp's light: the share is that at rest over now of the area which a pixel sees.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.optics import Optics
from zeromethod.surface.expected_light import LEAST_SHARE, ExpectedLight
from zeromethod.warp.jacobian import areas
from zeromethod.warp.rest import Rest

MOST_SHARE = 4.0
"""Most that the mirror is taken to focus: beyond, a lamp's size and the lens blur it."""


class LampLight(ExpectedLight):
    """As `ExpectedLight`, by a lamp at the camera's lens. Always `needed`."""

    def __init__(self, optics: Optics, rest: Rest) -> None:
        super().__init__(optics, rest)
        self._partial, self.needed = self.needed, True
        grid = rest.grid
        self._rest_areas = rest.areas
        step = 1.0 / grid.spacing_px
        self._nodes = np.array([[step, 0.0, -step * grid.u_px[0]], [0.0, step, -step * grid.v_px[0]]])
        self._size = grid.image_shape[::-1]

    def share(self, q: Float) -> Single:
        """(rows, cols) of the image: light expected over that at rest, where nodes look at `q` (LCD px)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            focused = np.nan_to_num(np.abs(self._rest_areas / areas(q)), nan=1.0, posinf=MOST_SHARE)
        focused = np.clip(focused, LEAST_SHARE, MOST_SHARE).astype(np.float32)
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        border = cv2.BORDER_REPLICATE
        spread = cv2.warpAffine(focused, self._nodes, self._size, flags=flags, borderMode=border)
        reflected = super().share(q) ** 2 if self._partial else np.float32(1.0)
        share: Single = np.maximum(spread * reflected, np.float32(LEAST_SHARE))
        return share
