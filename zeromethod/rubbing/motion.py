"""How far a texture moved from one contact image to another, by correlation, to a fraction of a pixel."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2

from zeromethod.arrays import Float, Mask, Single
from zeromethod.rubbing.spots import Spots

_LEAST_OVERLAP = 0.3
"""Least overlap of the areas looked at in both images, as a share of the smaller one."""
_LEAST_LIKE = 0.3
"""Correlation below which the texture of the first image was not found in the second."""
_SIGMAS = 4.0
"""The best shift is clear if its correlation is higher than any other by so many standard deviations."""
PLACED_MM, PLACED_SHARE = 0.003, 0.01
"""Standard deviation of an image's place on the mirror: mm, and as a share of the distance moved."""
_SUNK_SHARE = 0.6
"""Standard deviation as a share of the shift that a change of the mirror's depth makes: the depth inside a
contact is not measured, so that none of this shift may be real, or all."""
_BLUR_PX = 1.5
"""Standard deviation of the blur before images are compared: borders of spots are then linear over a
pixel."""
_PASSES = 4
"""Newton steps from the best whole pixel."""
_ALIKE_PX2, _ALIKE_HALVES = 30.0, 8.0
"""So many pixels have errors in common, those along one spot's border: in the image, and in the one of half
the resolution."""


class Moved(NamedTuple):
    """Movement from the first image to the second.

    sigma_mm: standard deviation of each of dx_mm, dy_mm. clear: no other movement explains the images nearly
    as well.
    """

    dx_mm: float
    dy_mm: float
    sigma_mm: float
    clear: bool


def moved(first: Spots, second: Spots, about_mm: Float | None = None) -> Moved | None:
    """How far the texture moved from one image to the other; None where it is not found again.

    about_mm: (2,) a first estimate; without one, all shifts are tried.

    Where on the mirror a pixel lies depends on the mirror's depth. Inside a contact that depth is not
    measured but interpolated from around it. So both images are placed as if it had not changed, and
    `_SUNK_SHARE` of the shift that its change would make is added to sigma.
    """
    pitch = first.pitch_mm
    smooth = _smooth(first.cover)
    other, looked = _on_pitch_of(second, pitch)
    sunk = second.sunk_mm - first.sunk_mm
    origin = np.array([second.x_mm - first.x_mm, second.y_mm - first.y_mm]) - sunk
    clear = True
    if about_mm is not None:
        shift = (about_mm - origin) / pitch
    else:
        # every other pixel is enough: the images are smooth
        every = np.s_[::2, ::2]
        likeness = correlation(smooth[every], first.looked[every], other[every], looked[every])
        found = _best(likeness, smooth[every].shape)
        if found is None:
            return None
        shift, clear = 2 * found[0], found[1]
    fine = _refined(smooth, first.looked, other, looked, shift)
    if fine is None:
        return None
    way = origin + pitch * fine[0]
    open_mm = PLACED_MM, PLACED_SHARE * np.hypot(*way), _SUNK_SHARE * np.hypot(*sunk), fine[1] * pitch
    return Moved(float(way[0]), float(way[1]), float(np.linalg.norm(open_mm)), clear)


def _best(found: tuple[Float, Float] | None, shape: tuple[int, ...]) -> tuple[Float, bool] | None:
    """((2,) px, the best shift; whether no other is nearly as good)."""
    if found is None:
        return None
    likeness, common = _tops(found[0]), found[1]
    peak = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
    if likeness[peak] < _LEAST_LIKE:
        return None
    # Fisher's z-transform: its standard deviation depends on the number of pixels only
    sure = np.arctanh(np.clip(likeness, -0.99, 0.99))
    own = _around_peak(likeness, peak)
    open_by = np.sqrt(
        1 / np.maximum(common / _ALIKE_HALVES - 3, 0.5) + 1 / max(common[peak] / _ALIKE_HALVES - 3, 0.5)
    )
    rival = np.where(own, -np.inf, sure + _SIGMAS * open_by)
    rival[likeness <= 0] = -np.inf
    shift = np.array(peak[::-1], dtype=np.float64) - (np.array(shape[::-1]) - 1)
    return shift, bool(rival.max() < sure[peak])


def _tops(likeness: Float) -> Float:
    """Correlation in which each local maximum has the height that it has between pixels, by parabolas."""
    top = likeness == cv2.dilate(likeness, np.ones((3, 3), np.uint8))
    top[[0, -1]] = top[:, [0, -1]] = False
    row, col = np.nonzero(top & (likeness > 0))
    middle = likeness[row, col]
    higher = np.zeros_like(middle)
    for down, right in ((1, 0), (0, 1)):
        before, after = likeness[row - down, col - right], likeness[row + down, col + right]
        bow = np.where(np.minimum(before, after) > 0, 2 * middle - before - after, np.inf)
        higher += (after - before) ** 2 / (8 * np.maximum(bow, 1e-6))
    result = likeness.copy()
    result[row, col] = np.minimum(middle + higher, 1.0)
    return result


def _smooth(cover: Single) -> Single:
    return np.asarray(cv2.GaussianBlur(cover, (0, 0), _BLUR_PX), np.float32)


def _on_pitch_of(spots: Spots, pitch_mm: float) -> tuple[Single, Mask]:
    """(smooth cover, looked) resampled to pixels of `pitch_mm`; the first pixel stays where it is."""
    scale = spots.pitch_mm / pitch_mm
    rows, cols = (int(np.ceil((n - 1) * scale)) + 1 for n in spots.cover.shape)
    turn = np.array([[scale, 0, 0], [0, scale, 0]], dtype=np.float64)
    cover = cv2.warpAffine(_smooth(spots.cover), turn, (cols, rows), flags=cv2.INTER_LINEAR)
    looked = cv2.warpAffine(spots.looked.view(np.uint8), turn, (cols, rows), flags=cv2.INTER_NEAREST)
    return np.asarray(cover, np.float32), np.asarray(looked > 0)


def correlation(first: Single, looked: Mask, other: Single, other_looked: Mask) -> tuple[Float, Float] | None:
    """(correlation of two images for every shift, pixels compared); None where these are too few.

    Only pixels that are looked at in both images count. Element (first's rows - 1 + i, first's cols - 1 + j):
    `first` at (r, c) against `other` at (r + i, c + j).
    Source: Padfield 2012, doi:10.1109/TIP.2011.2181402.
    """
    shape = [a + b - 1 for a, b in zip(first.shape, other.shape, strict=True)]
    sizes = [next_fast_len(n, real=True) for n in shape]

    def spectrum(values: Single) -> Float:
        return np.asarray(rfft2(values.astype(np.float64), sizes))

    turned, mask = np.where(looked, first, 0)[::-1, ::-1], looked[::-1, ::-1].astype(np.float32)
    plain, other_mask = np.where(other_looked, other, 0), other_looked.astype(np.float32)
    f1, f2, m1, m2 = (spectrum(one) for one in (turned, plain, mask, other_mask))
    s1, s2 = spectrum(turned**2), spectrum(plain**2)

    def back(product: Float) -> Float:
        return np.asarray(irfft2(product, sizes)[: shape[0], : shape[1]])

    common = np.maximum(back(m1 * m2), 1e-3)
    sum1, sum2 = back(f1 * m2), back(m1 * f2)
    product = back(f1 * f2) - sum1 * sum2 / common
    spread = (back(s1 * m2) - sum1**2 / common) * (back(m1 * s2) - sum2**2 / common)
    enough = common > _LEAST_OVERLAP * min(np.count_nonzero(looked), np.count_nonzero(other_looked))
    sound = enough & (spread > 1e-3)
    if not sound.any():
        return None
    return np.where(sound, product / np.sqrt(np.where(sound, spread, 1.0)), -1.0), common


def _around_peak(likeness: Float, peak: tuple[np.intp, ...]) -> Mask:
    """The best shift, those connected with it that have over half its correlation, and one pixel around."""
    above = (likeness > 0.5 * likeness[peak]).astype(np.uint8)
    _, labels = cv2.connectedComponents(above)
    own = (labels == labels[peak]).astype(np.uint8)
    return np.asarray(cv2.dilate(own, np.ones((3, 3), np.uint8)) > 0)


def _refined(
    smooth: Single, smooth_looked: Mask, other: Single, looked: Mask, shift: Float
) -> tuple[Float, float] | None:
    """(shift, its sigma), px: fitted so that the second image, shifted back, is as the first.

    None where too little is seen in both, or the steps do not come to an end.
    """
    rows, cols = smooth.shape
    rim = np.ones((2 * round(2 * _BLUR_PX) + 1,) * 2, np.uint8)
    own, others = (cv2.erode(one.view(np.uint8), rim, borderValue=0) for one in (smooth_looked, looked))
    for _ in range(_PASSES):
        turn = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], dtype=np.float64)
        how = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        back = cv2.warpAffine(other, turn, (cols, rows), flags=how)
        both = (own > 0) & (
            cv2.warpAffine(others, turn, (cols, rows), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP) > 0
        )
        if np.count_nonzero(both) < _ALIKE_PX2:
            return None
        mean = 0.5 * (smooth + back)
        slope = np.stack([cv2.Sobel(mean, cv2.CV_32F, *axis, scale=1 / 8)[both] for axis in ((1, 0), (0, 1))])
        lacks = (smooth - back)[both]
        normal = slope @ slope.T
        if np.linalg.det(normal) < 1e-6:
            return None
        step = np.clip(np.linalg.solve(normal, slope @ lacks), -1, 1)
        shift = shift + step
    variance = float(np.mean(lacks**2)) * _ALIKE_PX2
    sigma = float(np.sqrt(variance * np.trace(np.linalg.inv(normal)) / 2))
    if not np.abs(step).max() < 1:  # the last step went as far as it may
        return None
    return np.asarray(shift, dtype=np.float64), sigma
