"""Does the camera see the LCD, the right way round, and where the rig file expects it? By plain pictures.

Crossed cosines look the same mirrored, turned by quarters, or a period further on. Pictures that are partly
lit do not: which part of the image lights up for what should be its right half, its lower half and the middle
of its width and height shows how the panel's picture really lies. They are black and white only, so that the
LCD's response does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Float, Image, Mask
from zeromethod.warp.interpolant import sample
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.rest import Rest

FULL_CODE = 255
NOISE_GREY_SHARE = 0.02
"""Share of full scale by which a pixel, smoothed, must follow the LCD to count as seeing it."""
SMOOTHING_PX = 5

GLARE_SHARE, GLARE_BELOW = 0.02, 20.0
"""Share of the white LCD's light from which a bright place with the LCD black is an image of a lamp;
percentile of that picture which is taken for the even light."""

LEAST_LEANING = 0.1
"""Covariance of light and place, in units of the lit pixels' spread, below which no side is known: a sharp
half of an evenly lit view has 0.43."""

LEAST_PIXELS = 100
LEAST_SEEN = 0.5
"""Share of the pixels that should see the LCD which must, before the picture's place is given."""


@dataclass(frozen=True)
class Alignment:
    """The seen picture against the one that the rig file predicts.

    wider, higher: its size along u and v over the expected one, minus 1. turn_deg: its turn, positive from u
    towards v (clockwise in the image). right_px, down_px: how far its middle lies along u and v from where
    it should, camera px.
    """

    wider: float
    higher: float
    turn_deg: float
    right_px: float
    down_px: float


@dataclass(frozen=True)
class Glare:
    """Image of a lamp in the faces or the mirror, seen with the LCD black.

    share: its light over the white LCD's. u_px, v_px: its middle. size_px: its larger side.
    """

    share: float
    u_px: float
    v_px: float
    size_px: float


@dataclass(frozen=True)
class Orientation:
    """How the LCD is seen. Shares are 0..1.

    seen_share: of the image that follows the LCD. stray_grey: grey levels of light that does not, above the
    camera's black; stray_share: it over the white LCD's light. mirrored: in u, before the turn. turn_deg: as
    `Alignment` has it, -180..180; NaN when the LCD is not seen. place: None where the LCD is not seen, or
    mirrored or turned by quarters; good to about a pixel. glare: None where stray light is even.
    """

    seen_share: float
    stray_grey: float = math.nan
    stray_share: float = math.nan
    mirrored: bool = False
    turn_deg: float = math.nan
    place: Alignment | None = None
    glare: Glare | None = None

    @property
    def quarter_turns(self) -> int:
        """Turn in whole quarters, 0..3."""
        return round(self.turn_deg / 90) % 4 if math.isfinite(self.turn_deg) else 0

    @property
    def upright(self) -> bool:
        """Whether it is neither mirrored nor turned by quarters, as far as it is known."""
        return not self.mirrored and not self.quarter_turns


class PlainPictures:
    """The pictures to show, and what images of them say.

    pictures: LCD codes (rows, cols) uint8: black, white, and lit where the rest map expects the right half,
    the lower half, and the middle half of the view's width and of its height.
    """

    def __init__(self, rest: Rest) -> None:
        """Rest: as the rig file predicts it."""
        columns, rows = rest.display_size
        self._centre = rest.q[rest.visible].mean(axis=0)
        self._steps = np.linalg.inv(jacobian(rest.q, rest.grid.spacing_px)[rest.visible].mean(axis=0))
        self._quarter = [0.25 * float(np.ptp(axis[rest.visible])) for axis in rest.grid.mesh()]
        column, row = np.meshgrid(np.arange(columns), np.arange(rows))
        black = np.zeros((rows, columns), np.uint8)
        parts = self._inside_px(np.stack([column, row], axis=-1).astype(float))
        lit = (FULL_CODE * (part > 0).astype(np.uint8) for part in parts)
        self.pictures: tuple[Bytes, ...] = (black, np.full_like(black, FULL_CODE), *lit)
        height, width = rest.grid.image_shape
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        q = sample(
            rest.q,
            *((px - at[0]) / rest.grid.spacing_px for px, at in ((u, rest.grid.u_px), (v, rest.grid.v_px))),
        )
        with np.errstate(invalid="ignore"):
            self._expected = ((q >= 0) & (q <= np.array(rest.display_size) - 1)).all(axis=-1)
        # a camera pixel sees a mean of what is around it
        self._predicted = [np.clip(part + 0.5, 0, 1) for part in self._inside_px(np.nan_to_num(q))]

    def judge(self, images: Sequence[Image], black_grey: float, full_grey: float) -> Orientation:
        """Judge images (rows, cols) of `pictures`, in their order.

        black_grey, full_grey: the camera's grey without light and at full scale.
        """
        black, white, *parts = (image.astype(float) - black_grey for image in images)
        swing = white - black
        even = cv2.blur(swing, (SMOOTHING_PX, SMOOTHING_PX))
        lit = even > max(NOISE_GREY_SHARE * full_grey, 0.1 * float(np.percentile(even, 99)))
        seen_share = float(lit.mean())
        if np.count_nonzero(lit) < LEAST_PIXELS:
            return Orientation(seen_share)
        stray_grey = max(float(black[lit].mean()), 0.0)
        white_grey = float(even[lit].mean())
        stray = stray_grey, stray_grey / white_grey
        glare = _glare(black, white_grey, 3 * NOISE_GREY_SHARE * full_grey / SMOOTHING_PX)
        # noise is left in, of either sign, as cutting it off would shift every mean
        shares = [np.clip((part - black)[lit] / even[lit], -1, 2) for part in parts]
        row, column = np.nonzero(lit)
        places = np.stack([column, row]) - np.array([[column.mean()], [row.mean()]])
        # in a disc a half's light leans straight across its edge, however that is turned
        radius_px = 0.5 * min(float(np.ptp(column)), float(np.ptp(row)))
        disc = np.hypot(*places) <= radius_px
        spread = places[:, disc] / (0.5 * radius_px)
        halves = [share[disc] for share in shares[:2]]
        # columns: where in the image (u, v) the light of "right" and of "lower" went
        went = np.stack([spread @ (half - half.mean()) / half.size for half in halves], axis=1)
        if np.linalg.norm(went, axis=0).min() < LEAST_LEANING:
            return Orientation(seen_share, *stray, glare=glare)
        mirrored = bool(np.linalg.det(went) < 0)
        if mirrored:
            went[0] *= -1
        turn = math.degrees(math.atan2(went[1, 0] - went[0, 1], went[0, 0] + went[1, 1]))
        seen = Orientation(seen_share, *stray, mirrored, turn, glare=glare)
        if not seen.upright:
            return seen
        return replace(seen, place=self._place(lit, shares, turn))

    def _inside_px(self, q: Float) -> list[Float]:
        """How far LCD positions (..., 2) lie inside each partly lit picture's light, camera px."""
        # camera px from the view's middle, by the rest map's mean steps
        u, v = np.moveaxis((q - self._centre) @ self._steps.T, -1, 0)
        return [u, v, self._quarter[0] - abs(u), self._quarter[1] - abs(v)]

    def _place(self, lit: Mask, shares: list[Float], turn_deg: float) -> Alignment | None:
        """Place and size by how much of the image lights up against how much should."""
        both = lit & self._expected
        if np.count_nonzero(both) < LEAST_SEEN * max(int(np.count_nonzero(self._expected)), 1):
            return None
        seen = [float(share[both[lit]].sum()) for share in shares]
        right, lower, width, height = (float(part[both].sum()) for part in self._predicted)
        if not (width and height):
            return None
        rows, columns = (int(np.count_nonzero(both.any(axis=axis))) for axis in (1, 0))
        return Alignment(
            wider=seen[2] / width - 1,
            higher=seen[3] / height - 1,
            turn_deg=turn_deg,
            right_px=(right - seen[0]) / rows,
            down_px=(lower - seen[1]) / columns,
        )


def _glare(black: Float, white_grey: float, noise_grey: float) -> Glare | None:
    """What stands out of the picture of a black LCD, by more than noise and `GLARE_SHARE` of white."""
    even = cv2.blur(black, (SMOOTHING_PX, SMOOTHING_PX))
    above = even - float(np.percentile(even, GLARE_BELOW))
    limit = max(GLARE_SHARE * white_grey, noise_grey)
    bright = above > limit
    if np.count_nonzero(bright) < LEAST_PIXELS:
        return None
    v, u = np.nonzero(bright)
    sides = [(float(axis.min()), float(axis.max())) for axis in (u, v)]
    u_px, v_px = (0.5 * (first + last) for first, last in sides)
    size_px = max(last - first for first, last in sides)
    return Glare(float(np.percentile(above[bright], 90)) / white_grey, u_px, v_px, size_px)
