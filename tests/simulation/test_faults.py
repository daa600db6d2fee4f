"""Every planted fault, observed from outside as a loop would observe it."""

import numpy as np
import pytest

from zeromethod.clock import SimulatedClock
from zeromethod.devices.protocols import CameraLost, CameraTimeout, DisplayLost, Frame
from zeromethod.simulation.camera import SimulatedCamera
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.faults import Delivery

EXACT = {"camera_jitter_s": 0.0, "display_refresh_hz": 60.0, "camera_phase": 0.3}
MS = 1_000_000


class Bench:
    """A bench whose picture's grey rises with every show."""

    def __init__(self, make_rig, simulation=None, **faults) -> None:
        self.rig = make_rig(faults=faults, simulation=EXACT | (simulation or {}))
        self.clock = SimulatedClock()
        self.display = SimulatedDisplay(self.rig, self.clock)
        self.camera = SimulatedCamera(self.rig, self.clock, self.display)
        self.shown = 0

    def show(self) -> None:
        self.shown += 1
        self.display.show(np.full((270, 480), 20 * self.shown % 256, np.uint8))

    def frames(self, count: int) -> list:
        return [self.shown_frame() for _ in range(count)]

    def shown_frame(self) -> Frame:
        self.show()
        return self.camera.read(1.0)


@pytest.fixture
def healthy(make_rig) -> list:
    return Bench(make_rig).frames(8)


def test_dropped_frames_are_skipped_and_counted(make_rig):
    frames = Bench(make_rig, drop_frames=(2, 3)).frames(4)
    assert [(f.number, f.dropped) for f in frames] == [(0, 0), (1, 0), (4, 2), (5, 0)]


def test_a_repeated_frame_is_the_old_image_under_a_new_number(make_rig, healthy):
    frames = Bench(make_rig, repeat_frames=(3, 4)).frames(6)
    assert [f.number for f in frames] == [0, 1, 2, 3, 4, 5]
    assert [f.dropped for f in frames] == [0] * 6
    for n in (3, 4):
        np.testing.assert_array_equal(frames[n].image, healthy[2].image)
        assert frames[n].time_ns == healthy[n].time_ns
    np.testing.assert_array_equal(frames[5].image, healthy[5].image)


def test_a_torn_frame_ends_with_the_frame_before_it(make_rig, healthy):
    frames = Bench(make_rig, torn_frames=(3,)).frames(5)
    np.testing.assert_array_equal(frames[3].image[:32], healthy[3].image[:32])
    np.testing.assert_array_equal(frames[3].image[32:], healthy[2].image[32:])
    assert not np.array_equal(healthy[2].image, healthy[3].image)
    np.testing.assert_array_equal(frames[4].image, healthy[4].image)


def test_a_late_frame_has_the_right_time_and_the_newest_follows_it(make_rig, healthy):
    bench = Bench(make_rig, late_frames=(3,), late_s=0.05)
    frames = bench.frames(3)
    late = bench.shown_frame()
    assert (late.number, late.dropped) == (3, 0)
    assert late.time_ns == healthy[3].time_ns
    assert bench.clock.now_ns() - late.time_ns == 4 * MS + 4 * MS + 50 * MS
    newest = bench.shown_frame()
    assert newest.number > 4
    assert newest.dropped == newest.number - 4
    assert bench.clock.now_ns() - newest.time_ns < 30 * MS
    assert [f.number for f in frames] == [0, 1, 2]


def test_frames_behind_a_late_one_wait_for_it(make_rig):
    bench = Bench(make_rig, late_frames=(3,), late_s=0.05)
    bench.frames(3)
    # frame 4 would be there, 3 is still on its way
    bench.clock.sleep_until_ns(round((4.3 / 60 + 0.030) * 1e9))
    with pytest.raises(CameraTimeout):
        bench.camera.read(0.001)
    assert bench.camera.read(1.0).number == 3
    delivery = Delivery(bench.rig)
    assert np.all(np.diff([delivery.arrival_ns(n) for n in range(12)]) > 0)


def test_a_stall_times_out_until_it_is_over(make_rig):
    bench = Bench(make_rig, stall_at_frame=2, stall_s=0.3)
    assert [f.number for f in bench.frames(2)] == [0, 1]
    before = bench.clock.now_ns()
    with pytest.raises(CameraTimeout):
        bench.camera.read(0.1)
    assert bench.clock.now_ns() == before + 100 * MS
    frame = bench.camera.read(1.0)
    assert frame.number == 20  # 0.3 s are 18 frames
    assert frame.dropped == 18


def test_a_lost_camera_stays_lost_until_reopened_when_it_is_back(make_rig):
    bench = Bench(make_rig, camera_lost_at_frame=3, camera_back_after_s=0.2)
    assert [f.number for f in bench.frames(3)] == [0, 1, 2]
    with pytest.raises(CameraLost):
        bench.camera.read(1.0)
    lost_ns = bench.clock.now_ns()
    assert lost_ns == pytest.approx((3.3 / 60 + 0.012) * 1e9, abs=1)
    with pytest.raises(CameraLost):
        bench.camera.read(1.0)
    bench.camera.close()
    with pytest.raises(CameraLost):
        SimulatedCamera(bench.rig, bench.clock, bench.display)
    bench.clock.sleep_until_ns(lost_ns + 200 * MS)
    bench.camera = SimulatedCamera(bench.rig, bench.clock, bench.display)
    frames = bench.frames(3)
    assert frames[0].number > 14
    assert frames[0].time_ns > lost_ns + 200 * MS
    assert [f.dropped for f in frames] == [0, 0, 0]


def test_a_camera_lost_for_good_never_opens_again(make_rig):
    bench = Bench(make_rig, camera_lost_at_frame=1)
    bench.clock.sleep_until_ns(10**12)
    with pytest.raises(CameraLost):
        bench.camera.read(1.0)
    with pytest.raises(CameraLost):
        SimulatedCamera(bench.rig, bench.clock, bench.display)


def test_a_short_wait_before_the_loss_only_times_out(make_rig):
    bench = Bench(make_rig, camera_lost_at_frame=1)
    assert bench.camera.read(1.0).number == 0
    with pytest.raises(CameraTimeout):
        bench.camera.read(0.001)
    with pytest.raises(CameraLost):
        bench.camera.read(1.0)


def test_the_display_is_lost_at_its_show(make_rig):
    bench = Bench(make_rig, display_lost_at_show=2)
    bench.show()
    bench.show()
    for _ in range(2):
        with pytest.raises(DisplayLost):
            bench.show()


def test_with_the_light_off_only_ambient_light_is_left(make_rig):
    bench = Bench(make_rig, simulation={"ambient": 0.1}, light_off_frames=(2, 3))
    means = [float(frame.image.mean()) for frame in bench.frames(6)]
    dark = 4.0 + 0.1 * (0.8 * 255 - 4)
    assert means[2:4] == pytest.approx([dark, dark], abs=0.2)  # 2 grey of noise over 5120 px: 0.03
    assert min(means[0], means[1], means[5]) > dark + 1
