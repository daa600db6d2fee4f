"""Pictures to measure the light by: ones that surely stand, and none at all, the lens capped."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from zeromethod.arrays import Bytes, Float, Image, Single
from zeromethod.clock import Clock
from zeromethod.commissioning.standing_patterns import HeldPictures
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.devices.protocols import Frame
from zeromethod.rig.model import Rig

PATIENCE = 8.0
"""How many times as long as on an idle computer frames are waited for."""

SPARE_FRAMES = 8
"""Frames beyond those needed that may pass until a picture is seen to stand."""

AGREEMENT = 1.3
"""Mean square difference of frames of one picture, over what noise makes of it, within which they agree."""

MEAN_SIGMAS = 5.0
"""Change of the view's mean light, over its noise, from which another picture is seen."""

_THIN = 4


@dataclass(frozen=True)
class Exposures:
    """One picture at several exposures. grey: (exposures, rows, cols) mean of the frames."""

    exposure_s: tuple[float, ...]
    grey: Float


def even_picture(rig: Rig, code: int) -> Bytes:
    """LCD codes (rows, cols), all the same."""
    return np.full((rig.display.rows, rig.display.columns), code, np.uint8)


def follow(pictures: HeldPictures, codes: Bytes, seconds: float, least: int) -> Iterator[tuple[float, Frame]]:
    """Show a picture; frames until `seconds` later and `least` of them, with mid-exposure's time since, s.

    A busy computer loses frames: what was to be seen in them is waited for, up to `PATIENCE` times as long.
    """
    for number, (since_s, frame) in enumerate(pictures.following(codes, PATIENCE * seconds)):
        if since_s > seconds and number >= least:
            return
        yield since_s, frame


def thinned(image: Image) -> Single:
    """Every fourth pixel on both axes: plenty to compare pictures by."""
    return image[::_THIN, ::_THIN].astype(np.float32)


def apart(one: Single, other: Single) -> float:
    """Mean square difference of thinned images, grey^2."""
    return float(np.mean((one - other) ** 2))


class StandingPictures:
    """Pictures whose frames are seen to stand, beside what time stamps say of it.

    A busy computer puts arrival stamps on late, so that a frame of the picture before may pass for one of the
    new. Frames count once the view differs from the picture before and two running frames agree. In a light
    that flickers, or at codes that look alike, neither can be told: then the stamps alone are gone by, after
    `SPARE_FRAMES` more.
    """

    def __init__(self, pictures: HeldPictures) -> None:
        self._pictures = pictures
        self._shown: Bytes | None = None
        self._presented_ns = 0
        self._before: Single | None = None
        self._noise2 = 0.0

    def learn(self, frames: Sequence[Frame]) -> None:
        """Take from frames of the brightest picture how far noise and flicker set frames apart."""
        images = [thinned(frame.image) for frame in frames]
        self._noise2 = max(apart(a, b) for a, b in pairwise(images))

    def forget(self) -> None:
        """Something else has been shown meanwhile."""
        self._shown = self._before = None

    def frames(self, codes: Bytes, count: int) -> list[Frame]:
        """`count` frames of a picture, two or more; one that stands already is not waited for again."""
        stood = self._shown is not None and np.array_equal(self._shown, codes)
        if not stood:
            self._presented_ns = self._pictures.show(codes)
        taken = self._pictures.after(self._presented_ns, 1)
        row = [thinned(taken[0].image)]
        spare = SPARE_FRAMES if self._noise2 > 0 else 0
        while len(taken) < count or (spare > 0 and not stood and not self._stands(row)):
            if len(taken) >= count:
                spare -= 1
                del taken[0], row[0]
            taken.append(self._pictures.read())
            row.append(thinned(taken[-1].image))
        self._shown, self._before = codes, row[-1]
        return taken

    def _stands(self, row: list[Single]) -> bool:
        if any(apart(a, b) > AGREEMENT * self._noise2 for a, b in pairwise(row)):
            return False
        if self._before is None:
            return True
        mean_noise = MEAN_SIGMAS * math.sqrt(self._noise2 / row[0].size)
        change = abs(float(row[0].mean()) - float(self._before.mean()))
        return change > mean_noise or apart(row[0], self._before) > AGREEMENT * self._noise2


def take_dark(rig: Rig, devices: Devices, frames: int = 32) -> Image:
    """(frames, rows, cols) with the lens capped, which the caller has seen to."""
    pictures = HeldPictures(rig, devices, 0.0)
    return np.stack([pictures.read().image for _ in range(frames)])


def take_exposures(
    rig: Rig,
    exposure_s: Sequence[float],
    frames: int = 8,
    code: int = 255,
    clock: Clock | None = None,
    margin_s: float = 0.1,
) -> Exposures:
    """One evenly lit picture at several exposures: devices are opened anew for each, and must be closed.

    margin_s: held for longer than the rig states. Raises InputError where the camera cannot be set so, as
    opening does.
    """
    means = []
    for one in exposure_s:
        camera = rig.camera.model_copy(update={"exposure_s": one})
        changed = rig.model_copy(update={"camera": camera})
        with open_devices(changed, clock) as devices:
            pictures = HeldPictures(changed, devices, margin_s)
            taken = pictures.frames(even_picture(rig, code), frames)
        means.append(np.mean([frame.image for frame in taken], axis=0))
    return Exposures(tuple(exposure_s), np.stack(means))
