"""Does the camera see the LCD, and the right way round? Four plain pictures tell.

Crossed cosines look the same mirrored or turned by quarters. Half-lit pictures do not: what should light the
image's right half, and then its lower half, shows which way the panel's picture really lies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.control.rest import Rest
from zeromethod.warp.jacobian import jacobian

FULL_CODE = 255
NOISE_GREY_SHARE = 0.02
"""Share of full scale by which a pixel must follow the LCD to count as seeing it."""

MIRROR_DOUBT = 0.2


@dataclass(frozen=True)
class Orientation:
    """seen_share: share of the image that follows the LCD. stray_share: light that does not, over the LCD's.

    turn_deg: the seen picture's turn against the expected one, -180..180, positive from u towards v
    (clockwise in the image), after undoing the mirroring in u where `mirrored`; NaN when the LCD is not seen.
    """

    seen_share: float
    stray_share: float
    turn_deg: float
    mirrored: bool

    @property
    def quarter_turns(self) -> int:
        """Turn in whole quarters, 0..3."""
        return round(self.turn_deg / 90) % 4 if math.isfinite(self.turn_deg) else 0


def plain_pictures(rest: Rest) -> tuple[NDArray[np.uint8], ...]:
    """LCD pictures (rows, cols): black, white, and lit where the rest map expects right and lower half."""
    columns, rows = rest.display_size
    steps = jacobian(rest.q, rest.grid.spacing_px)[rest.seen].mean(axis=0)
    centre = rest.q[rest.seen].mean(axis=0)
    column, row = np.meshgrid(np.arange(columns), np.arange(rows))
    u, v = np.linalg.inv(steps) @ np.stack([(column - centre[0]).ravel(), (row - centre[1]).ravel()])
    black = np.zeros((rows, columns), np.uint8)
    halves = ((FULL_CODE * (part > 0)).astype(np.uint8).reshape(rows, columns) for part in (u, v))
    return (black, np.full_like(black, FULL_CODE), *halves)


def orientation(images: tuple[NDArray[Any], ...], full_grey: float) -> Orientation:
    """Orientation from the images (rows, cols) of `plain_pictures`, in their order."""
    black, white, right, lower = (image.astype(float) for image in images)
    swing = white - black
    lit = swing > max(NOISE_GREY_SHARE * full_grey, 0.1 * float(np.percentile(swing, 99)))
    seen_share = float(lit.mean())
    if not lit.any():
        return Orientation(seen_share, math.nan, math.nan, mirrored=False)
    stray = float(black[lit].mean() / swing[lit].mean())
    row, column = np.nonzero(lit)
    places = np.stack([column, row]) - np.array([[column.mean()], [row.mean()]])
    spread = places / places.std(axis=1, keepdims=True).clip(1e-9)
    shares = (np.clip((half - black)[lit] / swing[lit], 0, 1) for half in (right, lower))
    # columns: where in the image (u, v) the light of "right" and of "lower" went
    went = np.stack([spread @ (share - share.mean()) / share.size for share in shares], axis=1)
    if np.linalg.norm(went, axis=0).min() < MIRROR_DOUBT * 0.4:  # 0.4: of a sharp half, evenly spread
        return Orientation(seen_share, stray, math.nan, mirrored=False)
    mirrored = bool(np.linalg.det(went) < 0)
    if mirrored:
        went[0] *= -1
    turn = math.degrees(math.atan2(went[1, 0] - went[0, 1], went[0, 0] + went[1, 1]))
    return Orientation(seen_share, stray, turn, mirrored)
