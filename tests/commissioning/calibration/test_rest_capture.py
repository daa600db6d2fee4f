"""Pictures of the rest map have settled, whatever a busy computer's stamps say."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod import MeasurementError, open_devices
from zeromethod.commissioning.calibration.rest import capture, sequence_for
from zeromethod.commissioning.calibration.settling import settle
from zeromethod.commissioning.patterns import TimedPatterns
from zeromethod.devices.protocols import Frame

from .planted import nominal

NOISE = 2.0


class LateStamps(TimedPatterns):
    """Every picture is seen only `late` frames after the stamps say so, the frame before it half."""

    def __init__(self, late: int) -> None:
        self._late = late
        self._rng = np.random.default_rng(0)
        self._queue: Iterator[NDArray[Any]] = iter(())
        self._now = np.zeros((128, 160))

    def show(self, codes: NDArray[np.uint8]) -> int:
        new = codes[:128, :160].astype(float)
        old, self._now = self._now, new
        self._queue = iter([old] * (self._late - 1) + [0.5 * (old + new)] * (self._late > 0))
        return 0

    def after(self, presented_ns: int, count: int) -> list[Frame]:
        return [self.read() for _ in range(count)]

    def read(self) -> Frame:
        seen = next(self._queue, self._now)
        noisy = np.clip(np.rint(seen + NOISE * self._rng.standard_normal(seen.shape)), 0, 255)
        return Frame(noisy.astype(np.uint8), 0, 0, 0)


@pytest.mark.parametrize("late", [0, 1, 3])
def test_frames_that_come_late_are_not_counted(late):
    rig, sequence = nominal(), sequence_for(nominal())
    found = capture(rig, LateStamps(late), sequence, 2, variance_grey2=NOISE**2 + 1 / 12)
    true = capture(rig, LateStamps(0), sequence, 2)
    # means of two frames: eight standard deviations
    apart = found.sums.astype(float) / 2 - true.sums.astype(float) / 2
    assert np.abs(apart).max() < 8 * NOISE


def test_picture_that_never_settles_is_refused():
    rig, sequence = nominal(), sequence_for(nominal())
    with pytest.raises(MeasurementError, match="does not settle"):
        capture(rig, LateStamps(0), sequence, 2, variance_grey2=0.1 * NOISE**2)


def test_noise_found_while_settling_is_the_camera_s():
    rig = nominal()
    with open_devices(rig) as devices:
        found = settle(rig, devices)
    noise = rig.camera.noise
    white = noise.read_grey**2 + 1 / 12 + (found.white_grey - noise.black_grey) / noise.electrons_per_grey
    # 1280 pixels looked at
    assert found.variance_grey2 == pytest.approx(white, rel=0.2)
