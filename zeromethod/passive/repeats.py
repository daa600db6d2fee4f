"""A texture that repeats: its other matches, and what distinguishes the true one from them.

A lattice moved by a whole period is the lattice again. Where another match is about as good, a displacement
counts only if something breaks the tie: parts of the picture that match at one place only, parts that are
seen at rest, or the image before.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
import scipy.ndimage

from zeromethod.arrays import Float, Mask, Single
from zeromethod.passive.displacement import Displacement
from zeromethod.passive.matching import ALIKE, LIGHT_PX, CellMatches, Matcher
from zeromethod.passive.search import resampled, settle
from zeromethod.passive.validity import REST_PX

_BY_CHANCE = 0.0027
"""Probability of a reading beyond 3 sigma: nearer to rest than this share of the periods is at rest."""

_EVEN_PX = 20.0
"""Standard deviation of the blur that is subtracted before a picture is compared with itself: uneven
light."""
_VIEW_PX = 512
"""Side of the part of a picture in which repeats are looked for."""
_LEAST_OVERLAP = 0.2
"""Share of that part that must overlap with itself, shifted, for their likeness to mean anything."""
_NEAREST, _CHECKED = 24, 2
"""Repeats that are kept, the shortest shifts; and those of them whose match is tried in full."""
_NEARLY_ALL = 99.0
"""A repeat is not tried if by it this percentile of the points would have moved farther than they can."""
_ROUNDS = 4
"""Rounds in which the field of a repeat settles before it is compared."""
_CLEARLY, _DECISIVE_SHARE = 2.0, 0.1
"""A match is better at a point if it leaves this many times less grey variance, and better as a whole if it
is so at this share more of the points than the other match."""
_REACH = 1.5
"""Reach of what stands close to a frame, in widths of the window in which pictures are compared."""
_CARRIED = 0.25
"""Median change since the image before, over the shortest repeat, below which the order is that of the
image."""
_SIGMAS, _SMOOTH = 3.0, 2.0
"""A point is at rest within this many sigmas; standard deviation, in cells, of the blur before slopes of the
field are taken."""


def repeats(grey: Single) -> Float:
    """Shifts (n, 2) px, shortest first, at which the picture (rows, cols) looks like itself again.

    Judged in the middle `_VIEW_PX` of the picture; of opposite shifts one is given.
    """
    rows, cols = (slice((n - min(n, _VIEW_PX)) // 2, (n + min(n, _VIEW_PX)) // 2) for n in grey.shape)
    part = np.asarray(grey[rows, cols] - cv2.GaussianBlur(grey, (0, 0), _EVEN_PX)[rows, cols], np.float64)
    size = [scipy.fft.next_fast_len(2 * n, real=True) for n in part.shape]
    ones, of_part, of_square = (scipy.fft.rfft2(x, size) for x in (np.ones_like(part), part, part**2))

    def correlation(a: Float, b: Float) -> Float:
        return np.asarray(scipy.fft.irfft2(np.conj(a) * b, size))

    energy = np.maximum(correlation(ones, of_square), 0.0) * np.maximum(correlation(of_square, ones), 0.0)
    overlap = correlation(ones, ones)
    enough = overlap > _LEAST_OVERLAP * part.size
    like = np.where(enough, correlation(of_part, of_part) / np.sqrt(np.maximum(energy, 1e-12)), 0.0)
    like = np.roll(like, (size[0] // 2, size[1] // 2), axis=(0, 1))[: size[0] // 2 + 1]
    # The peak at no shift at all is not a repeat; on a picture that is coarse it is wide.
    count, labels = cv2.connectedComponents((like > ALIKE).astype(np.uint8))
    others = sorted(set(range(1, count)) - {int(labels[size[0] // 2, size[1] // 2])})
    at = np.array(scipy.ndimage.maximum_position(like, labels, others), dtype=np.float64).reshape(-1, 2)
    found = at[:, ::-1] - (size[1] // 2, size[0] // 2)
    return np.asarray(found[np.argsort(np.hypot(found[:, 0], found[:, 1]))][:_NEAREST])


@dataclass(frozen=True, slots=True)
class Repeats:
    """shifts: (n, 2) px, of `repeats`. least_noise: grey variance below which matches do not differ.

    largest_px: how far any point may have moved.
    """

    shifts: Float
    least_noise: float
    largest_px: float


def ambiguous(
    matcher: Matcher,
    here: CellMatches,
    field: Float,
    sigma: Float,
    sound: Mask,
    close: Mask,
    others: Repeats,
    guess: Displacement | None,
) -> bool:
    """Whether a match `here`, of field (rows, cols, 2) px, is only one of several about as good.

    sound: (rows, cols) points to judge by. close: points at the ends of the texture, where a frame that
    stands still may be: it says nothing of the texture's order.
    """
    shifts = others.shifts
    if not shifts.size or not sound.any() or _carried(matcher, field, sound, shifts, guess):
        return False
    # Where all is close to an end (dots far apart), all there is must do.
    inner = sound & ~close
    if _rests(field, sigma, inner if inner.mean() > _DECISIVE_SHARE * sound.mean() else sound, shifts):
        return False
    own = np.maximum(here.grey_variance, others.least_noise)
    for shift in shifts[:_CHECKED]:
        for sign in (1.0, -1.0):
            if (
                np.percentile(np.linalg.norm(field[sound] + sign * shift, axis=-1), _NEARLY_ALL)
                > others.largest_px
            ):
                continue
            other = matcher.compare(settle(matcher, field + sign * shift, _ROUNDS))
            there = sound & other.shown
            both = there & ~_near(close, _REACH * LIGHT_PX + np.hypot(*shift), matcher.size)
            theirs = np.maximum(other.grey_variance, others.least_noise)
            ahead = np.mean(theirs[both] > _CLEARLY * own[both]) if both.any() else 0.0
            behind = np.mean(own[both] > _CLEARLY * theirs[both]) if both.any() else 0.0
            if there.any() and ahead - behind < _DECISIVE_SHARE:
                return True
    return False


def _near(close: Mask, reach_px: float, size: int) -> Mask:
    """Points (rows, cols) whose comparison with one reach_px away takes in what is close to a frame."""
    reach = int(np.ceil(reach_px / size))
    return np.asarray(
        cv2.dilate(close.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0
    )


def _carried(matcher: Matcher, field: Float, sound: Mask, shifts: Float, guess: Displacement | None) -> bool:
    """Whether the image before had the same order: nearly the same displacement, against the repeat."""
    if guess is None:
        return False
    size = round(float(guess.u[0, 1] - guess.u[0, 0]))
    before = resampled(guess.field, size, matcher.shape, matcher.size, 1.0)
    change = np.linalg.norm(field - before, axis=-1)[sound]
    return bool(np.median(change) < _CARRIED * np.hypot(*shifts[0]))


def _rest_px(shifts: Float) -> float:
    """Displacement up to which a point is at rest: one of unknown length is seen there hardly by chance."""
    areas = np.abs(shifts[:, 0] * shifts[0, 1] - shifts[:, 1] * shifts[0, 0])
    # In the same direction are further periods of one grating only.
    areas = areas[areas > 0.1 * np.sum(shifts[0] ** 2)]
    return max(REST_PX, float(np.sqrt(_BY_CHANCE / np.pi * areas.min()))) if areas.size else REST_PX


def _rests(field: Float, sigma: Float, sound: Mask, shifts: Float) -> bool:
    """Whether part of the view is at rest, and would not be if the order were another."""
    worst = sigma.max(axis=-1)
    # What is badly determined may seem to be at rest.
    usual, most = np.percentile(worst[sound], (50.0, 90.0))
    sound = sound & (worst <= most)
    smooth = cv2.GaussianBlur(field, (0, 0), _SMOOTH)
    by_row, by_col = (np.linalg.norm(np.gradient(smooth, axis=axis), axis=-1) for axis in (0, 1))
    near = np.maximum(_rest_px(shifts), _SIGMAS * np.minimum(worst[sound], usual))
    near = np.maximum(near, 0.5 * np.hypot(by_row, by_col)[sound])
    moved = field[sound]

    def share(shift: Float) -> float:
        return float(np.mean(np.linalg.norm(moved + shift, axis=-1) < near))

    others = [share(sign * shift) for shift in shifts for sign in (1.0, -1.0)]
    return share(np.zeros(2)) > _CLEARLY * max(others)
