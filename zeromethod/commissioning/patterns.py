"""Patterns on the LCD, and frames that surely saw one of them alone.

Whether a frame saw one alone is known by time stamps: its exposure must have begun after the pattern's
presentation, the display's latency (which holds what the camera's stamps are wrong by), the scan-out and the
panel's rise. A busy computer puts stamps on late: `SettledPatterns` goes by the images, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from zeromethod.arrays import Bytes, Image, Single
from zeromethod.devices.abilities import poll_of
from zeromethod.devices.contract import presented, taken, wrong_image, wrong_numbers
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraTimeout, Frame
from zeromethod.errors import InputError, MeasurementError
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.rig.model import Rig

RISE_CONSTANTS = 12.0
"""Time constants of the rise after which less than a hundred thousandth of the old picture is left."""

TIMEOUTS_TO_FAIL = 3

PATIENCE = 8.0
"""How many times as long as on an idle computer frames are waited for."""

SPARE_FRAMES = 8
"""Frames beyond those needed that may pass until the images show a pattern, where alike ones may follow."""

AGREEMENT = 1.3
"""Mean square difference of frames of one picture, over what noise makes of it, within which they agree."""

MEAN_SIGMAS = 5.0
"""Change of the view's mean light, over its noise, that another picture makes."""

_THIN = 4


def uniform_pattern(rig: Rig, code: int) -> Bytes:
    """LCD codes (rows, cols), all the same."""
    return np.full((rig.display.rows, rig.display.columns), code, np.uint8)


def thinned(image: Image) -> Single:
    """Every fourth pixel on both axes: plenty to compare pictures by."""
    return image[::_THIN, ::_THIN].astype(np.float32)


def apart(one: Single, other: Single) -> float:
    """Mean square difference of thinned images, grey^2."""
    return float(np.mean((one - other) ** 2))


class TimedPatterns:
    """Patterns on the rig's display, frames of them by time stamps. Windows need the main thread.

    hold_s: how long after its presentation a pattern alone is seen; at first what the rig states, and
    `margin_s` more.
    """

    def __init__(self, rig: Rig, devices: Devices, margin_s: float) -> None:
        timing = PanelTiming.of(rig.display)
        seen_ns = max(timing.latency_ns, 0.0) + timing.scanout_ns + RISE_CONSTANTS * timing.tau_ns
        self.hold_s = 1e-9 * seen_ns + margin_s
        self._devices = devices
        self._timeout_s, self._refresh_hz = rig.control.timeout_s, rig.display.refresh_hz
        self._image = (rig.camera.rows, rig.camera.columns), np.uint8 if rig.camera.bits == 8 else np.uint16

    def show(self, codes: Bytes) -> int:
        """Show LCD codes (rows, cols); presentation time, ns. Raises MeasurementError where there is none."""
        show = partial(self._devices.display.show, codes)
        try:
            return presented(show, self._devices.clock, self._refresh_hz)
        except InputError:
            raise
        except (TypeError, ValueError) as error:
            raise MeasurementError(f"the display: {error}") from error

    def frames(self, codes: Bytes, count: int) -> list[Frame]:
        """Show a pattern and take `count` frames that saw nothing else."""
        return self.after(self.show(codes), count)

    def after(self, presented_ns: int, count: int) -> list[Frame]:
        """`count` frames that surely saw nothing older than what was presented then."""
        seen_ns = presented_ns + round(1e9 * self.hold_s)
        self._devices.clock.sleep_until_ns(seen_ns)
        taken: list[Frame] = []
        while len(taken) < count:
            frame = self.read()
            if frame.time_ns - frame.exposure_ns // 2 >= seen_ns:
                taken.append(frame)
        return taken

    def following(
        self, codes: Bytes, seconds: float, least: int | None = None
    ) -> Iterator[tuple[float, Frame]]:
        """Show a pattern; every frame until `seconds` later, with its mid-exposure's time since then, s.

        least: frames that are waited for up to `PATIENCE` times as long, as a busy computer loses some.
        """
        presented_ns, count = self.show(codes), 0
        while True:
            frame = self.read()
            since_s = 1e-9 * (frame.time_ns - presented_ns)
            if since_s > seconds and (least is None or count >= least or since_s > PATIENCE * seconds):
                return
            if since_s > 0:
                count += 1
                yield since_s, frame

    def read(self) -> Frame:
        """Newest frame. Raises MeasurementError for a silent camera, and a wrong image; CameraLost passes."""
        poll = poll_of(self._devices.display) or (lambda: None)
        for _ in range(TIMEOUTS_TO_FAIL):
            poll()
            try:
                frame = taken(self._devices.camera.read, self._timeout_s)
            except CameraTimeout:
                continue
            if wrong := wrong_image(frame.image, *self._image) or wrong_numbers(frame):
                raise MeasurementError(wrong)
            return frame
        raise MeasurementError(f"the camera gave no frame for {TIMEOUTS_TO_FAIL * self._timeout_s:g} s")


class SettledPatterns:
    """Frames of patterns by time stamps and by the images.

    Frames count once they differ from the pattern before and consecutive ones agree. noise2: mean square
    difference of frames of one pattern, grey^2; 0: stamps alone count. most_frames: that may pass until a
    pattern has settled; None: after `SPARE_FRAMES` the stamps alone count, as patterns may look alike, or the
    light flickers.
    """

    def __init__(self, patterns: TimedPatterns, noise2: float = 0.0, most_frames: int | None = None) -> None:
        self._patterns = patterns
        self._noise2 = noise2
        self._most_frames = most_frames
        self._shown: Bytes | None = None
        self._presented_ns = 0
        self._before: Single | None = None

    def learn(self, frames: Sequence[Frame]) -> None:
        """Take from frames of the brightest pattern how far noise and flicker set frames apart."""
        images = [thinned(frame.image) for frame in frames]
        self._noise2 = max(apart(a, b) for a, b in pairwise(images))

    def forget(self) -> None:
        """Something else has been shown meanwhile."""
        self._shown = self._before = None

    def frames(self, codes: Bytes, count: int) -> list[Frame]:
        """`count` frames of a pattern; one that is shown already is not waited for again.

        Raises MeasurementError for a pattern that does not settle within `most_frames`.
        """
        again = self._shown is not None and np.array_equal(self._shown, codes)
        if not again:
            self._presented_ns = self._patterns.show(codes)
        taken = self._patterns.after(self._presented_ns, 1)
        row = [thinned(taken[0].image)]
        spare = self._most_frames or SPARE_FRAMES
        wanted = max(count, 2) if self._noise2 > 0 else count
        while len(taken) < wanted or not (again or self._settled(row)):
            if len(taken) >= wanted:
                if spare == 0 and self._most_frames is not None:
                    raise MeasurementError(
                        f"a picture does not settle within {self._most_frames} frames: does the light "
                        "flicker, or did something move?"
                    )
                if spare == 0:
                    break
                spare -= 1
                del taken[0], row[0]
            taken.append(self._patterns.read())
            row.append(thinned(taken[-1].image))
        self._shown, self._before = codes, row[-1]
        return taken[-count:]

    def _settled(self, row: list[Single]) -> bool:
        if self._noise2 <= 0:
            return True
        if any(apart(a, b) > AGREEMENT * self._noise2 for a, b in pairwise(row)):
            return False
        if self._before is None:
            return True
        mean_noise = MEAN_SIGMAS * math.sqrt(self._noise2 / row[0].size)
        change = abs(float(row[0].mean()) - float(self._before.mean()))
        return change > mean_noise or apart(row[0], self._before) > AGREEMENT * self._noise2
