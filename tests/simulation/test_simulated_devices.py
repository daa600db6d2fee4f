"""The simulated display and camera as devices: time, freshness, reproducibility, exposures in pieces."""

import numpy as np
import pytest

from zeromethod.clock import SimulatedClock
from zeromethod.devices import protocols
from zeromethod.errors import InputError
from zeromethod.gl.context import VARIABLE
from zeromethod.pattern import Response
from zeromethod.simulation.camera import SimulatedCamera, exposure_pieces
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.panel import Presentation, SimulatedPanel
from zeromethod.simulation.scenario import load_scenario

EXACT = {"camera_jitter_s": 0.0, "display_refresh_hz": 60.0, "camera_phase": 0.3}
QUIET = {"noise": {"read_grey": 0.0, "black_grey": 0.0}}
FAST_LCD = {"rise_s": 0.0, "scanout_s": 0.0, "fill_factor": (1.0, 1.0), "gamma": 1.0}


def opened(rig) -> tuple[SimulatedClock, SimulatedDisplay, SimulatedCamera]:
    clock = SimulatedClock()
    display = SimulatedDisplay(rig, clock)
    return clock, display, SimulatedCamera(rig, clock, display)


def grey(rig, code: int) -> np.ndarray:
    return np.full((rig.display.rows, rig.display.columns), code, np.uint8)


def test_devices_meet_the_protocols(make_rig):
    _, display, camera = opened(make_rig())
    assert isinstance(camera, protocols.Camera)
    assert isinstance(display, protocols.Display)
    assert not isinstance(display, protocols.DrawingDisplay)  # drawing needs the GPU renderer
    assert not hasattr(display, "draw")
    assert camera.shape == (64, 80)
    assert display.size == (480, 270)
    assert (camera.bits, display.refresh_hz) == (8, 60.0)


def test_on_the_gpu_a_drawn_picture_is_seen_as_a_shown_one(make_rig, gl_backend, monkeypatch):
    monkeypatch.setenv(VARIABLE, gl_backend)
    rig = make_rig(display={"fill_factor": (1.0, 1.0)}, camera=QUIET, simulation=EXACT | {"renderer": "gpu"})
    medians = []
    for drawn in (True, False):
        _, display, camera = opened(rig)
        assert isinstance(display, protocols.DrawingDisplay)
        for _ in range(4):
            if drawn:
                display.draw(lambda framebuffer: framebuffer.clear(red=200 / 255))
            else:
                display.show(grey(rig, 200))
        medians.append(np.median([camera.read(1.0).image for _ in range(2)][-1]))
        camera.close()
        display.close()
    assert medians[0] == medians[1] == np.rint((200 / 255) ** 2.2 * 0.8 * 255)


def test_a_picture_comes_at_the_first_refresh_strictly_after_the_call(make_rig):
    rig = make_rig(simulation=EXACT | {"display_refresh_hz": 50.0})
    clock, display, _ = opened(rig)
    assert display.show(grey(rig, 0)) == 20_000_000
    assert clock.now_ns() == 20_000_000
    assert display.show(grey(rig, 0)) == 40_000_000
    clock.sleep_until_ns(59_999_999)
    assert display.show(grey(rig, 0)) == 60_000_000


def test_frames_are_stamped_mid_exposure_and_come_half_an_exposure_and_the_latency_later(make_rig):
    rig = make_rig(simulation=EXACT | {"camera_latency_s": 0.005})
    clock, _, camera = opened(rig)
    for number in range(3):
        frame = camera.read(1.0)
        assert (frame.number, frame.dropped, frame.exposure_ns) == (number, 0, 8_000_000)
        assert frame.time_ns == round((0.3 + number) / 60 * 1e9) + 4_000_000
        assert clock.now_ns() - frame.time_ns == 4_000_000 + 5_000_000
        assert frame.image.shape == camera.shape
        assert frame.image.dtype == np.uint8


def test_read_returns_the_newest_frame_once_and_counts_those_it_skipped(make_rig):
    clock, _, camera = opened(make_rig(simulation=EXACT))
    assert camera.read(1.0).number == 0
    clock.sleep_until_ns(200_000_000)
    # frame n is there at (0.3 + n) / 60 s + 12 ms: the newest by 200 ms is 10
    frame = camera.read(1.0)
    assert (frame.number, frame.dropped) == (10, 9)
    assert clock.now_ns() == 200_000_000  # it was there already
    following = camera.read(1.0)
    assert (following.number, following.dropped) == (11, 0)
    assert clock.now_ns() > 200_000_000


def test_a_timeout_moves_the_clock_by_the_time_waited_and_loses_nothing(make_rig):
    clock, _, camera = opened(make_rig(simulation=EXACT))
    with pytest.raises(protocols.CameraTimeout):
        camera.read(0.010)
    assert clock.now_ns() == 10_000_000
    frame = camera.read(0.010)
    assert (frame.number, frame.dropped) == (0, 0)
    assert clock.now_ns() == 17_000_000


@pytest.mark.parametrize("opened_ns", [100_000_000, 105_000_000])  # frame 6 starts at 105 ms
def test_a_camera_opened_later_starts_with_a_frame_exposed_after_that(make_rig, opened_ns):
    rig = make_rig(simulation=EXACT)
    clock = SimulatedClock(opened_ns)
    display = SimulatedDisplay(rig, clock)
    frame = SimulatedCamera(rig, clock, display).read(1.0)
    assert frame.time_ns - frame.exposure_ns // 2 >= opened_ns
    assert (frame.number, frame.dropped) == (6, 0)


def test_before_the_first_picture_the_panel_shows_the_targets_mean_light(make_rig):
    rig = make_rig(display={"fill_factor": (1.0, 1.0)}, camera=QUIET, simulation=EXACT)
    _, _, camera = opened(rig)
    response = Response.from_rig(rig.display)
    light = float(response.light(response.code(0.5)))
    assert light == pytest.approx(0.5, abs=0.005)
    assert np.median(camera.read(1.0).image) == np.rint(light * 0.8 * 255)


def test_a_frame_mixes_the_pictures_by_the_time_they_were_shown(make_rig):
    for phase, expected in ((0.3, 0.0), (0.7, 0.5)):
        rig = make_rig(
            display=FAST_LCD, camera=QUIET | {"exposure_s": 0.010}, simulation=EXACT | {"camera_phase": phase}
        )
        _, display, camera = opened(rig)
        display.show(grey(rig, 0))  # at 16.67 ms
        display.show(grey(rig, 255))  # at 33.33 ms
        frame = [camera.read(1.0) for _ in range(2)][1]
        assert frame.number == 1  # 21.67 to 31.67 ms: black alone; 28.33 to 38.33 ms: half of it white
        assert np.median(frame.image) == pytest.approx(expected * 0.8 * 255, abs=1)  # one grey of rounding


def run_of(rig, reads: list[int]) -> dict[int, np.ndarray]:
    """Images by frame number; reads[k] counts the shows before the k-th read."""
    _, display, camera = opened(rig)
    rng = np.random.default_rng(3)
    images = {}
    pictures = [rng.integers(0, 256, (270, 480), dtype=np.uint8) for _ in range(12)]
    for count in reads:
        for _ in range(count):
            display.show(pictures.pop(0))
        frame = camera.read(1.0)
        images[frame.number] = frame.image
    return images


def test_a_frame_is_the_same_whatever_was_read_before(make_rig):
    rig = make_rig(press="hold", simulation={"seed": 4, "camera_jitter_s": 2e-4, "display_jitter_s": 1e-4})
    every, some, again = (run_of(rig, reads) for reads in ([1] * 12, [4, 4, 4], [1] * 12))
    assert set(some) < set(every)
    for number, image in some.items():
        np.testing.assert_array_equal(image, every[number])
    assert all(np.array_equal(every[n], again[n]) for n in every)


def test_another_seed_gives_other_noise_and_other_jitter(make_rig):
    one, two = (
        opened(make_rig(simulation={"seed": seed, "camera_jitter_s": 2e-4}))[2].read(1.0) for seed in (0, 1)
    )
    assert one.time_ns != two.time_ns
    assert not np.array_equal(one.image, two.image)


def test_truth_is_the_scenarios_mirror(make_rig):
    _, _, camera = opened(make_rig(press="hold"))
    assert camera.scenario.name == "hold"
    assert camera.truth(10**9).dents[0].depth_mm == 0.2


def test_old_pictures_are_let_go(make_rig):
    rig = make_rig()
    _, display, camera = opened(rig)
    for _ in range(20):
        display.show(grey(rig, 9))
        camera.read(1.0)
    # two frames back, one more for the picture before, settling 12 time constants of 1.8 ms after scan-out
    assert len(display.presentations) <= 7
    camera.close()
    display.show(grey(rig, 9))
    assert len(display.presentations) <= 4


def test_closing_twice_is_safe_and_closed_devices_are_lost(make_rig):
    rig = make_rig()
    _, display, camera = opened(rig)
    for device in (camera, camera, display, display):
        device.close()
    with pytest.raises(protocols.CameraLost, match="closed"):
        camera.read(1.0)
    with pytest.raises(protocols.DisplayLost, match="closed"):
        display.show(grey(rig, 0))


def test_bad_input_is_refused(make_rig):
    rig = make_rig()
    clock, display, _ = opened(rig)
    with pytest.raises(InputError, match=r"display\.driver 'simulated'"):
        SimulatedCamera(rig, clock, object())
    with pytest.raises(InputError, match=r"\(3, 3\).*\(270, 480\)"):
        display.show(np.zeros((3, 3), np.uint8))
    with pytest.raises(InputError, match="nope"):
        SimulatedCamera(make_rig(press="nope"), clock, display)


MS = 1_000_000
SHOWN = [Presentation(0, 1), Presentation(503 * MS, 2)]


@pytest.fixture
def panel(make_rig) -> SimulatedPanel:
    return SimulatedPanel(make_rig().display, 60.0)


def test_a_still_mirror_is_one_piece(panel):
    (piece,) = exposure_pieces(load_scenario("default"), panel, SHOWN, 600 * MS, 608 * MS)
    assert piece.weight == 1.0
    assert piece.mirror == load_scenario("default").mirror_at(604 * MS)


def test_a_moving_mirror_is_seen_at_the_two_gauss_legendre_instants(panel):
    scenario = load_scenario("default")
    pieces = exposure_pieces(scenario, panel, SHOWN, 1500 * MS, 1508 * MS)
    x_mm = np.array([piece.mirror.dents[0].x_mm for piece in pieces])
    weights = np.array([piece.weight for piece in pieces])
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ x_mm == pytest.approx(37.0 + 10 * 0.504)  # mean place, at 10 mm/s
    half_mm = 10 * 0.004
    assert weights @ (x_mm - weights @ x_mm) ** 2 == pytest.approx(half_mm**2 / 3, rel=1e-5)  # its variance


def test_a_jump_inside_the_exposure_gives_each_side_its_share(panel):
    before, after = exposure_pieces(load_scenario("step"), panel, SHOWN, 198 * MS, 206 * MS)
    assert (before.weight, after.weight) == pytest.approx((0.25, 0.75))
    assert before.mirror.dents == ()
    assert after.mirror.dents[0].depth_mm == 0.2


def test_the_panels_light_over_all_pieces_is_that_of_the_whole_exposure(panel):
    pieces = exposure_pieces(load_scenario("default"), panel, SHOWN, 496 * MS, 511 * MS)
    assert len(pieces) == 3  # moving until 500 ms, then still
    whole = dict(panel.weights(SHOWN, 496 * MS, 511 * MS))
    total = sum(piece.weight * dict(piece.pictures).get(2, 0.0) for piece in pieces)
    np.testing.assert_allclose(total, whole[2], atol=2e-5)


def test_light_off_leaves_the_pictures_without_light(panel):
    (piece,) = exposure_pieces(load_scenario("none"), panel, SHOWN, 0, 8 * MS, backlight=0.0)
    assert not any(share.any() for _, share in piece.pictures)
