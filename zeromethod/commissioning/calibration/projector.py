"""Where a projector's picture falls on the mirror, by the same fringes as the LCD's, seen through the cloth.

The LCD is black meanwhile. Threads that touch the mirror show the fringes to the camera; sums over blocks of
pixels even out where these threads are. One period is longer than the picture, the other a twelfth of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from zeromethod.arrays import Float
from zeromethod.commissioning.patterns import TimedPatterns, uniform_pattern
from zeromethod.decoding.fringes import SHIFTS, FringeSequence, equal_shifts
from zeromethod.devices.projectors import Projector
from zeromethod.errors import MeasurementError
from zeromethod.interactive.homography import corners_px, homography, mapped
from zeromethod.optics import Optics
from zeromethod.rig.model import ProjectorSpec, Rig

BLOCK_PX = 16
_LONGEST, _FINER = 1.25, 15.0
"""The long period over the picture's longer side, and over the short period."""
PROJECTED = 2 * 2 * SHIFTS
"""Pictures that are shown: both axes, both periods."""
_LEAST_BLOCKS, _PASSES, _MOST_SIGMAS = 64, 4, 4.0
_MOST_SHARE = 0.02
"""Misfit of a map, over the picture's longer side, above which no fringes were seen, only noise."""
_REFRESHES, _SETTLED_S = 3.0, 0.05
"""What a projector has after its latency to show a picture."""


class Projection(NamedTuple):
    """What was seen of a projector: camera px (n, 2), and the picture's px (n, 2) that are seen there."""

    camera_px: Float
    picture_px: Float


def fringes_of(spec: ProjectorSpec) -> FringeSequence:
    """The fringes that are projected."""
    longest = _LONGEST * max(spec.columns, spec.rows)
    return FringeSequence((longest, longest / _FINER), equal_shifts(SHIFTS))


def see_projection(
    rig: Rig,
    patterns: TimedPatterns,
    projectors: Sequence[Projector],
    frames: int,
    now_ns: Callable[[], int],
    advance: Callable[[], object],
) -> Projection:
    """Show the fringes by open projectors, and decode what the camera sees. Raises MeasurementError."""
    spec = rig.projector
    assert spec is not None
    sequence, sets = fringes_of(spec), []
    patterns.show(uniform_pattern(rig, 0))
    wait_ns = round(1e9 * (spec.latency_s + _REFRESHES / spec.refresh_hz + _SETTLED_S))
    turns = np.exp(1j * np.array(sequence.shifts_rad))
    for number, light in enumerate(sequence.pictures(spec.columns, spec.rows)):
        picture = np.rint(255 * light ** (1 / spec.gamma)).astype(np.uint8)
        for one in projectors:
            one.show(picture)
            one.poll()
            if one.trouble:
                raise MeasurementError(one.trouble)
        taken = patterns.after(now_ns() + wait_ns, frames)
        seen = turns[number % SHIFTS] * _blocks(
            np.sum([frame.image for frame in taken], axis=0, dtype=np.float64)
        )
        if number % SHIFTS == 0:
            sets.append(seen)
        else:
            sets[-1] = sets[-1] + seen
        advance()
    for one in projectors:
        one.show(np.zeros((spec.rows, spec.columns), np.uint8))
    places, sure = [], np.ones(sets[0].shape, np.bool_)
    for long, short, periods in zip(sets[::2], sets[1::2], sequence.periods, strict=True):
        first = np.angle(long) % (2 * np.pi) / (2 * np.pi) * periods[0]
        within = np.angle(short) / (2 * np.pi)
        order = first / periods[1] - within
        places.append((np.rint(order) + within) * periods[1])
        sure &= np.abs(order - np.rint(order)) < 0.25  # noise in the long one is not near another order
    middles = np.indices(sure.shape)[::-1].astype(np.float64) * BLOCK_PX + (BLOCK_PX - 1) / 2
    px = np.stack(places, axis=-1)
    sure &= ((px >= 0) & (px <= (spec.columns - 1, spec.rows - 1))).all(axis=-1)
    seen = Projection(np.asarray(np.moveaxis(middles, 0, -1)[sure]), px[sure])
    projector_values(rig, seen)  # refuses noise
    return seen


def projector_values(rig: Rig, seen: Projection) -> dict[str, Any]:
    """Keys of the rig file that say where the picture falls, by its geometry. Raises MeasurementError."""
    spec, optics = rig.projector, Optics(rig)
    assert spec is not None
    mm = optics.reflected(*optics.rubber_rays(*seen.camera_px.T), optics.rest)[0][..., :2]
    good = np.isfinite(mm).all(axis=-1)
    for _ in range(_PASSES):
        if np.count_nonzero(good) < _LEAST_BLOCKS:
            raise MeasurementError("projector: its fringes are not seen: is it on, and sharp on the cloth?")
        off = mapped(homography(seen.picture_px[good], mm[good]), seen.picture_px) - mm
        size = np.linalg.norm(off, axis=-1)
        good &= size <= _MOST_SIGMAS * np.median(size[good])
    found = mapped(homography(seen.picture_px[good], mm[good]), corners_px(spec))
    sigma = float(np.sqrt(np.mean(off[good] ** 2)))
    if sigma > _MOST_SHARE * float(np.linalg.norm(found[1] - found[0])):
        raise MeasurementError("projector: its fringes are not seen: is it on, and sharp on the cloth?")
    corners = [[round(float(one), 4) for one in corner] for corner in found]
    return {"projector.corners_mm": corners, "projector.sigma_mm": round(sigma, 4)}


def _blocks(image: Float) -> Float:
    """Sums over blocks of BLOCK_PX pixels, those at the last rows and columns left out where not whole."""
    rows, cols = (n // BLOCK_PX for n in image.shape)
    cut = image[: rows * BLOCK_PX, : cols * BLOCK_PX]
    return np.asarray(cut.reshape(rows, BLOCK_PX, cols, BLOCK_PX).sum(axis=(1, 3)))
