"""The delay between display and camera from coded strips, against planted ones."""

from dataclasses import replace

import numpy as np
import pytest
from coded_frames import CodedBench, panel, reader

from zeromethod.devices.protocols import Frame
from zeromethod.exposure.delay import DelayWatch
from zeromethod.exposure.strip_matching import match
from zeromethod.exposure.strip_reading import StripReading

MS = 1e6
FRAME_NS = 1e9 / 60
WIDE = (-3 * FRAME_NS, 9 * FRAME_NS)


def _follow(bench: CodedBench, frames: int) -> tuple[DelayWatch, list[bool]]:
    """Watch after some frames, and whether each frame could be used."""
    watch = DelayWatch(reader(), bench.timing, bench.display.refresh_hz)
    used = [watch.timing_of(frame.image, frame, bench.log) is not None for frame in bench.frames(frames)]
    return watch, used


@pytest.mark.parametrize("tenths", range(0, 41, 2))
def test_planted_delay_of_0_to_4_frames_comes_back_within_a_hundredth_of_a_frame(tenths):
    # half of it in the display, half in the camera's stamps, which say too late when a frame was taken
    planted_s = tenths / 10 / 60
    bench = CodedBench(refresh_hz=59.94, phase=0.37, delay_s=planted_s / 2, stamp_s=planted_s / 2)
    watch, used = _follow(bench, 24)
    assert watch.estimator.settled
    # levels are read to 0.2 %, of 8 ms of exposure: 16 us a frame; the panel's timing is known exactly
    assert watch.estimator.value_ns == pytest.approx(1e9 * planted_s, abs=0.01 * FRAME_NS)
    assert watch.estimator.sigma_ns < 0.01 * FRAME_NS
    assert all(used)


def test_stamps_that_come_early_make_the_delay_negative():
    watch, _ = _follow(CodedBench(refresh_hz=59.94, stamp_s=-0.012), 20)
    assert watch.estimator.value_ns == pytest.approx(-12 * MS, abs=0.01 * FRAME_NS)


@pytest.mark.parametrize("rates", [(59.94, 60), (60, 60), (60, 50), (60, 30), (120, 60), (60, 59.94)])
@pytest.mark.parametrize("phase", [0.0, 0.25, 0.5, 0.75])
def test_no_rate_or_phase_hides_the_delay(rates, phase):
    refresh, camera = rates
    bench = CodedBench(
        display=panel(refresh), refresh_hz=refresh, camera_hz=camera, phase=phase, delay_s=0.009
    )
    watch, used = _follow(bench, 20)
    # Where clocks run in step, every exposure may see one picture alone: the delay is then only bounded, by
    # refresh - exposure - the visible part of the rise, and the frames are used all the same.
    timing = watch.timing
    assert timing.latency_ns == pytest.approx(
        9 * MS, abs=(0.05 if watch.estimator.settled else 0.55) * 1e9 / refresh
    )
    assert all(used)


@pytest.mark.parametrize("scan", ["down", "up"])
@pytest.mark.parametrize(("exposure_s", "rise_s"), [(0.002, 0.0), (0.004, 0.006), (0.016, 0.006)])
def test_exposure_rise_and_scan_direction_are_taken_in(scan, exposure_s, rise_s):
    bench = CodedBench(
        display=panel(rise_s=rise_s, scan=scan),
        refresh_hz=59.0,
        exposure_s=exposure_s,
        delay_s=0.021,
        late_s=0.0005,
    )
    watch, used = _follow(bench, 40)
    assert watch.estimator.value_ns == pytest.approx(21 * MS, abs=0.02 * FRAME_NS)
    assert all(used)


def test_frame_that_saw_one_picture_alone_only_bounds_the_delay():
    bench = CodedBench(camera_hz=15, exposure_s=0.004, phase=0.0, display=panel(rise_s=0.0))
    for frame in bench.frames(6):
        found = match(reader().read(frame.image), bench.log, frame, bench.timing, WIDE)
    assert found.fits
    assert found.low_ns < 0 < found.high_ns
    # the one before stood for 67 ms, and any delay at which it has ended before the exposure will do
    assert found.high_ns - found.low_ns > 20 * MS


def test_single_wrong_bit_or_a_code_that_was_not_shown_is_never_used():
    for wrong in range(16):
        bench = CodedBench(refresh_hz=59.94, delay_s=0.011, wrong={30: wrong})
        watch, used = _follow(bench, 40)
        after = [n for n in range(40) if not used[n]]
        if wrong == 30 % 16:
            assert not after
            continue
        # The picture is in one or two exposures. One or two codes off it passes for a picture that came a
        # refresh or two too early or late, unless the check or the pictures next to it show it.
        assert after or wrong in {12, 13, 15, 0}
        assert set(after) <= set(range(30, 35))
        assert watch.estimator.value_ns == pytest.approx(11 * MS, abs=0.05 * FRAME_NS)


def _last_read() -> tuple[CodedBench, Frame, tuple[StripReading, ...]]:
    """A bench with a delay of 11 ms, its 20th frame, and what is read of its strips."""
    bench = CodedBench(refresh_hz=59.94, delay_s=0.011)
    *_, last = ((frame, reader().read(frame.image)) for frame in bench.frames(20))
    return bench, *last


def test_single_frames_that_a_busy_computer_stamps_late_are_used_with_their_own_delay():
    """One frame in ten is stamped two to five refreshes late: its codes say all the same what it saw."""
    rng = np.random.default_rng(4)
    bench = CodedBench(refresh_hz=59.94, delay_s=0.012)
    watch = DelayWatch(reader(), bench.timing, bench.display.refresh_hz)
    misses_ns = []
    for number, frame in enumerate(bench.frames(120)):
        late_ns = round(rng.uniform(2, 5) * FRAME_NS) if number > 10 and rng.random() < 0.1 else 0
        stamped = replace(frame, time_ns=frame.time_ns + late_ns)
        timing = watch.timing_of(frame.image, stamped, bench.log)
        assert timing is not None, late_ns / FRAME_NS
        if number > 10:
            misses_ns.append(timing.latency_ns - (12 * MS + late_ns))
    # a lone picture bounds the delay by 8 ms on either side; which pictures were lit is never in doubt
    assert np.max(np.abs(misses_ns)) < 0.5 * FRAME_NS
    assert np.percentile(np.abs(misses_ns), 75) < 0.01 * FRAME_NS
    assert watch.estimator.value_ns == pytest.approx(12 * MS, abs=0.01 * FRAME_NS)


def test_flipped_cell_is_a_contradiction():
    bench, frame, readings = _last_read()
    span = (11 * MS - 2.5 * FRAME_NS, 11 * MS + 2.5 * FRAME_NS)
    good = match(readings, bench.log, frame, bench.timing, span)
    assert good.fits
    for bit in range(5):
        levels = readings[0].levels.copy()
        if abs(levels[bit] - 0.5) < 0.3:
            continue  # a grey bit turned over is another weight, which the check contradicts less loudly
        levels[bit] = 1 - levels[bit]
        turned = (replace(readings[0], levels=levels, sigma=0.001), readings[1])
        bad = match(turned, bench.log, frame, bench.timing, span)
        assert not bad.fits


def test_bit_and_check_that_disagree_are_not_used():
    bench, frame, readings = _last_read()
    mixed = next(one for one in readings if one.code is None)
    levels = mixed.levels.copy()
    levels[-1] += 0.5 if levels[-1] < 0.5 else -0.5
    other = replace(mixed, levels=levels, sigma=0.001)
    bad = match((other,), bench.log, frame, bench.timing, WIDE)
    assert not bad.fits


def test_strips_that_cannot_be_read_leave_the_rigs_then_the_running_delay():
    bench = CodedBench(refresh_hz=59.94, delay_s=0.02)
    watch = DelayWatch(reader(), bench.timing, 60.0)
    dark = np.zeros((192, 320), np.uint8)
    for n, frame in enumerate(bench.frames(24)):
        hidden = n < 6 or n > 20
        timing = watch.timing_of(dark if hidden else frame.image, frame, bench.log)
        assert timing is not None
        if n < 6:
            assert timing.latency_ns == 0.0
        if n > 20:
            assert timing.latency_ns == pytest.approx(20 * MS, abs=0.01 * FRAME_NS)


def test_delay_that_changes_for_good_is_found_again():
    bench = CodedBench(refresh_hz=59.94, delay_s=0.0)
    watch = DelayWatch(reader(), bench.timing, 60.0)
    for n, frame in enumerate(bench.frames(120)):
        if n == 20:
            bench.delay_s = 0.07  # beyond the delays searched round the running one
        watch.timing_of(frame.image, frame, bench.log)
    assert watch.estimator.value_ns == pytest.approx(70 * MS, abs=0.01 * FRAME_NS)
