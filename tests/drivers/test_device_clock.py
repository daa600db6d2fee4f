"""Device clocks with planted offset, drift and jitter."""

import numpy as np
import pytest

from zeromethod.drivers.device_clock import DeviceClock, MidExposure

PERIOD_NS = 1e9 / 60
OFFSET_NS = 7_123_456_789_012
LEAST_DELAY_NS = 3_000_000
JITTER_NS = 1e6


def planted(
    frames: int, drift: float, tick_ns: float = 1.0, seed: int = 0
) -> tuple[list[int], list[int], np.ndarray]:
    """Device stamps, times of receipt, and the true times (plus the least delay) of frames.

    Delays exceed the least one by exponential jitter, and every twentieth frame by 30 ms more.
    """
    rng = np.random.default_rng(seed)
    true_ns = 5e9 + PERIOD_NS * np.arange(frames)
    stamps = [round((t * (1 + drift) + OFFSET_NS) / tick_ns) for t in true_ns]
    late_ns = rng.exponential(JITTER_NS, frames) + 3e7 * (rng.random(frames) < 0.05)
    received = [round(t) for t in true_ns + LEAST_DELAY_NS + late_ns]
    return stamps, received, true_ns + LEAST_DELAY_NS


def errors_ns(clock: DeviceClock, stamps: list[int], received: list[int], true_ns: np.ndarray) -> np.ndarray:
    return np.array([clock.map(s, r) for s, r in zip(stamps, received, strict=True)]) - true_ns


@pytest.mark.parametrize("drift", [0.0, 8e-5, -8e-5])
@pytest.mark.parametrize("tick_ns", [1.0, 8.0, 1000.0])
def test_offset_and_drift_are_found_under_jitter(drift, tick_ns):
    stamps, received, true_ns = planted(60 * 90, drift, tick_ns)
    errors = errors_ns(DeviceClock(tick_ns), stamps, received, true_ns)
    # In the first two seconds no slope is fitted: drift adds 2 s x 8e-5 = 160 us to the least of the jitter.
    assert np.abs(errors[30:120]).max() < 160_000 + 200_000
    # Each half second's least of 30 delays lies JITTER / 30 = 33 us above the least delay on average; the
    # fitted line runs through the least of those. A tenth of the jitter leaves room for the first seconds.
    assert np.abs(errors[600:]).max() < 0.1 * JITTER_NS
    assert np.abs(errors[600:]).mean() < JITTER_NS / 30
    # as received, frames scatter by the jitter itself
    assert np.abs(np.array(received) - true_ns).mean() > JITTER_NS


def test_no_frame_lies_after_its_receipt():
    stamps, received, _ = planted(2000, 1e-4)
    clock = DeviceClock()
    assert all(clock.map(s, r) <= r for s, r in zip(stamps, received, strict=True))


# a restarted device, and a clock set forward by an hour
@pytest.mark.parametrize(("drift", "shift_ns"), [(5e-5, -OFFSET_NS), (0.0, 3_600_000_000_000)])
def test_a_clock_that_jumps_is_mapped_again(drift, shift_ns):
    stamps, received, true_ns = planted(1200, drift)
    jumped = [s + shift_ns if i >= 600 else s for i, s in enumerate(stamps)]
    errors = errors_ns(DeviceClock(), jumped, received, true_ns)
    assert errors[600] == received[600] - true_ns[600]  # it knows one frame only
    assert np.abs(errors[900:]).max() < 0.2 * JITTER_NS  # five seconds on: as above, with fewer frames


def test_a_late_frame_does_not_move_the_map():
    stamps, received, true_ns = planted(900, 0.0)
    received[899] += 500_000_000
    errors = errors_ns(DeviceClock(), stamps, received, true_ns)
    assert abs(errors[899]) < 0.1 * JITTER_NS


def test_without_stamps_the_middle_is_half_an_exposure_and_the_latency_before_receipt():
    times = MidExposure(0.008, 0.003)
    assert times.of(1_000_000_000) == 1_000_000_000 - 3_000_000 - 4_000_000
    assert times.exposure_ns == 8_000_000


def test_with_stamps_jitter_of_receipt_does_not_show():
    stamps, received, true_ns = planted(1800, 3e-5)
    times = MidExposure(0.008, 0.003, DeviceClock())
    middles = [times.of(r, s) for s, r in zip(stamps, received, strict=True)]
    errors = np.array(middles) - (true_ns - 7_000_000)
    assert np.abs(errors[600:]).max() < 0.1 * JITTER_NS


def test_a_stamp_of_zero_is_none():
    times = MidExposure(0.002, 0.0, DeviceClock())
    assert times.of(50_000_000, 0) == 49_000_000


def test_times_rise_whatever_the_receipt():
    times = MidExposure(0.002, 0.0)
    assert times.of(50_000_000) < times.of(50_000_000) < times.of(49_999_999)
