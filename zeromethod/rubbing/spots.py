"""The spots in which a texture touches, in a contact's image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.contact.contact import Contact, ContactImage
from zeromethod.contact.median import median
from zeromethod.contact.pieces import disc, pieces

RIM_MM = 1.0
"""Rim of the contact that is left out: fringes of the carrier there are as dark as spots."""
_DARKEST = 0.02
"""Share of the pixels that are certainly dark."""
_UNLIT = 0.6
"""Rubber between spots has at least this share of the light of the picture at rest."""
_LIT, _LIT_SHARE, _LIT_MM, _AROUND = 1.35, 0.5, (0.4, 1.5), 2.0
"""Rubber that the LCD lights white has more than the first number times the light at rest. A pixel is lit if
this share of the rubber around it is so: within the last number times the radius of a large spot, but not
less or more than the two distances."""
_REACH, _RING_PX = 2.0, 2
"""A border's blur reaches so many of its standard deviations; width of the ring beyond, in which the light
beside a spot is measured."""
_LEAST_PX = 5
"""Pixels of the smallest spot; what is smaller is noise."""
_FEWEST, _FEWEST_PX = 3, 400
"""Least number of spots, and of pixels inside the contact's rim, for anything to be said."""
_MARGIN_PX = 12
"""Margin of the cropped image, so that blurs reach beyond the contact."""
_GREY = 0.22, 0.18
"""Steep rubber beside a spot looks grey, so that its border seems further out than it is: by how much, and
the standard deviation of that, over the standard deviation of the blur. (0 where the grey rim is wider than
the blur, 0.45 where it is as wide.)"""
_MIDDLE = 1.35
"""Width of the middle half of a blurred step, in standard deviations of the blur."""


@dataclass(frozen=True, slots=True, eq=False)
class Spots:
    """Spots of one image.

    looked: (rows, cols) the area looked at. cover: (rows, cols) share of each pixel in contact, 0 outside
    that area. labels: (rows, cols) number of the spot, 0 for none. pitch_mm: side of a pixel. x_mm, y_mm:
    place on the mirror of the middle of pixel (0, 0). sunk_mm: (2,) how far the mirror's depth shifted it
    (`ContactImage`). places_mm: (n, 2) centroids. sizes_mm2: (n,). cut: (n,) spots that reach out of the area
    looked at. edge_mm: length of all borders. blur_mm: standard deviation of their blur.
    """

    cover: Single
    looked: Mask
    labels: np.ndarray
    pitch_mm: float
    x_mm: float
    y_mm: float
    sunk_mm: Float
    places_mm: Float
    sizes_mm2: Float
    cut: Mask
    edge_mm: float
    blur_mm: float

    @property
    def looked_mm2(self) -> float:
        """Area looked at."""
        return float(np.count_nonzero(self.looked)) * self.pitch_mm**2

    @property
    def share(self) -> tuple[float, float]:
        """(share of that area in contact, its standard deviation)."""
        area = self.looked_mm2
        blurred = np.pi * self.blur_mm**2 * (len(self.cut) - 0.5 * float(np.count_nonzero(self.cut)))
        grey, sigma = (self.edge_mm * each * self.blur_mm for each in _GREY)
        own = (float(self.cover.sum()) * self.pitch_mm**2 + blurred - grey) / area
        return own, sigma / area


def spots_of(contact: Contact, blur_px: float) -> Spots | str:
    """Spots of a contact whose borders are blurred by `blur_px`, or why there are none."""
    image = contact.image
    if image is None:
        return "where it lies on the mirror is not known"
    inside = _within(image, contact)
    if np.count_nonzero(inside) < _FEWEST_PX:
        return "too small to look at"
    image, inside = _cropped(image, inside)
    raw = np.nan_to_num(image.light, nan=1.0)
    light = np.asarray(cv2.medianBlur(raw, 3), np.float32)
    tip = _level(light[inside])
    dark = np.asarray(light < tip + 0.5 * (1 - tip)) & inside
    inside &= _lit(light, dark, image.mm_per_px)
    if np.count_nonzero(inside) < _FEWEST_PX:
        return "the LCD does not light it yet"
    labels, sizes = pieces(dark & inside, connectivity=8)
    small = sizes < _LEAST_PX
    labels[small[labels]] = 0
    numbers = np.flatnonzero(~small & (np.arange(len(sizes)) > 0))
    if numbers.size < _FEWEST:
        return f"fewer than {_FEWEST} spots in contact"
    looked = inside & _hull(labels > 0)
    return _measured(
        image, np.asarray((labels > 0) & looked), looked, _covered(raw, labels > 0, tip, blur_px)
    )


def _level(light: Single) -> float:
    """Light of the spots, over that at rest: the median of the dark pixels.

    The darkest are no measure: shadows beside the spots of a white object are darker.
    """
    darkest = float(np.quantile(light, _DARKEST))
    if darkest >= _UNLIT:  # lifted: nothing is in contact
        return 0.0
    for _ in range(2):
        darkest = median(light[light < darkest + 0.5 * (_UNLIT - darkest)])
    return darkest


def _covered(light: Single, seed: Mask, tip: float, blur_px: float) -> Single:
    """Share of each pixel that spots cover, by its light between that beside the spots (0) and theirs (1).

    The first and last quarter of that range count as 0 and 1: they are noise, and steep rubber, which is
    grey.
    """
    reach = max(1, round(_REACH * blur_px))
    grown = [cv2.dilate(seed.view(np.uint8), disc(2 * k + 1)) > 0 for k in (reach, reach + _RING_PX)]
    ring = (grown[1] & ~grown[0]).astype(np.float32)
    weight = cv2.GaussianBlur(ring, (0, 0), reach)
    beside = cv2.GaussianBlur(ring * light, (0, 0), reach) / np.maximum(weight, 1e-6)
    share = (beside - light) / np.maximum(beside - tip, 0.1)
    return np.where(grown[0] & (weight > 1e-3), np.clip(2 * share - 0.5, 0, 1), seed).astype(np.float32)


def _measured(image: ContactImage, seed: Mask, looked: Mask, covered: Single) -> Spots:
    pitch = image.mm_per_px
    count, labels, _, centres = cv2.connectedComponentsWithStats(seed.view(np.uint8), connectivity=8)
    edge = float(np.count_nonzero(np.diff(seed, axis=0)) + np.count_nonzero(np.diff(seed, axis=1)))
    places: Float = np.array([image.x_mm, image.y_mm]) + pitch * centres[1:].astype(np.float64)
    cover = np.where(looked, covered, np.float32(0))
    _, nearest = cv2.distanceTransformWithLabels(
        1 - seed.view(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_CCOMP
    )
    own = np.zeros(int(nearest.max()) + 1, np.intp)
    own[nearest[seed]] = labels[seed]
    pixels = np.bincount(own[nearest].ravel(), cover.ravel(), count)[1:]
    # steps along both axes are 4 / pi times as many as a border is long
    border = 0.25 * np.pi * edge * pitch
    # blur moves the place of half light inwards, by blur^2 / (2 radius) for a round spot
    middle = np.count_nonzero((cover > 0) & (cover < 1)) * pitch**2
    blur = float(middle / (_MIDDLE * border))
    grey = border * _GREY[0] * blur / len(pixels)
    sizes = np.asarray(pixels * pitch**2 + np.pi * blur**2 - grey, dtype=np.float64)
    rim = cv2.erode(looked.view(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) == 0
    cut = np.zeros(count, np.bool_)
    cut[labels[rim]] = True
    sunk: Float = np.array([image.sunk_x_mm, image.sunk_y_mm])
    return Spots(
        cover, looked, labels, pitch, image.x_mm, image.y_mm, sunk, places, sizes, cut[1:], border, blur
    )


def _within(image: ContactImage, contact: Contact) -> Mask:
    """Pixels of a contact without its rim."""
    own = (image.inside(contact.outline_mm) & np.isfinite(image.light)).astype(np.uint8)
    away = cv2.distanceTransform(np.pad(own, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(away * image.mm_per_px > RIM_MM)


def _cropped(image: ContactImage, inside: Mask) -> tuple[ContactImage, Mask]:
    """An image and the mask `inside`, both cropped to the mask with a margin."""
    left, top, width, height = cv2.boundingRect(inside.view(np.uint8))
    first_col, first_row = max(left - _MARGIN_PX, 0), max(top - _MARGIN_PX, 0)
    part = slice(first_row, top + height + _MARGIN_PX), slice(first_col, left + width + _MARGIN_PX)
    x, y = image.x_mm + image.mm_per_px * first_col, image.y_mm + image.mm_per_px * first_row
    cut = replace(image, light=np.ascontiguousarray(image.light[part]), x_mm=x, y_mm=y)
    return cut, np.ascontiguousarray(inside[part])


def _lit(light: Single, dark: Mask, mm_per_px: float) -> Mask:
    """Pixels around which the LCD lights the rubber white: elsewhere dark fringes look like spots."""
    sizes = pieces(dark, connectivity=8)[1][1:]
    most = np.sort(sizes)[np.searchsorted(np.cumsum(np.sort(sizes)), 0.5 * sizes.sum())] if sizes.size else 0
    reach = np.clip(_AROUND * np.sqrt(most / np.pi) * mm_per_px, *_LIT_MM)
    side = (2 * round(float(reach) / mm_per_px) + 1,) * 2
    bright = cv2.boxFilter((light > _LIT).astype(np.float32), -1, side)
    between = cv2.boxFilter((~dark).astype(np.float32), -1, side)
    return np.asarray(bright > _LIT_SHARE * np.maximum(between, 1e-3))


def _hull(mask: Mask) -> Mask:
    filled = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(filled, cv2.convexHull(cv2.findNonZero(mask.view(np.uint8))), 1)
    return np.asarray(filled > 0)
