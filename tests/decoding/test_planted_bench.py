"""A whole capture with planted trouble: found, named, left out; what is left is right within its sigma."""

from dataclasses import replace

import numpy as np
import pytest
from decoding.planted import PANEL, Bench
from scipy.ndimage import binary_dilation, binary_erosion

from zeromethod.decoding import Reason
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import RestMeasurement, measure_rest
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import choose_periods
from zeromethod.warp.rest_map import plain_name

SEQUENCE = FringeSequence(choose_periods(PANEL[0]), equal_shifts(6))
NOISE = NoiseModel.of_camera(2.0, 150.0, 4.0)
SHAPE = (128, 160)


def measure(bench: Bench, sequence: FringeSequence = SEQUENCE) -> RestMeasurement:
    return measure_rest(bench.frames(sequence), sequence, size_px=PANEL, noise=NOISE)


def named(found: RestMeasurement, reason: Reason) -> np.ndarray:
    return (found.rest_map.reason & int(reason)) != 0


def errors(bench: Bench, found: RestMeasurement) -> np.ndarray:
    """Errors over sigma of the valid pixels (n, 2); none is an order off."""
    rest = found.rest_map
    off = (rest.lcd_px - bench.lcd)[rest.valid]
    assert np.abs(off).max(initial=0) < 1.0
    return off / rest.sigma_px[rest.valid]


def part(rows: slice, cols: slice) -> np.ndarray:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[rows, cols] = True
    return mask


@pytest.mark.parametrize("repeats", [1, 3])
def test_every_place_is_found_within_its_sigma(repeats):
    bench = Bench()
    found = measure(bench, replace(SEQUENCE, repeats=repeats))
    z = errors(bench, found)
    assert found.rest_map.valid.all()
    # 40,960 errors: 95.4 % within two sigma is known to 0.1 %, their spread to 0.4 %, their mean to 0.5 %;
    # quantisation counted as noise is the only approximation.
    assert z.std() == pytest.approx(1.0, abs=0.02)
    assert np.mean(np.abs(z) < 2) == pytest.approx(0.954, abs=0.006)
    assert abs(z.mean()) < 0.03
    # sqrt(2 / 6) x noise / amplitude, amplitude 90 less the blur's 10 to 16 %
    assert found.phase_sigma_rad == pytest.approx(
        np.sqrt(2 / 6 / repeats) * np.sqrt(NOISE.variance(106.0)) / 79, rel=0.06
    )
    assert found.order_error < 1e-30


def test_fringes_below_the_noise_are_refused_by_name():
    # Amplitude 79 at best, its noise sqrt(2 / 6) x 32: four sigmas where eight are asked.
    found = measure_rest(Bench(read=32.0, electrons=1e6).frames(SEQUENCE), SEQUENCE, size_px=PANEL)
    assert named(found, Reason.NO_MODULATION).mean() > 0.99
    assert found.rest_map.valid.mean() < 0.01


def test_wrong_orders_are_found_and_removed():
    # Three periods that are only 0.5 rad apart: noise alone gets one in some hundred wrong.
    sequence = FringeSequence((16.0, 18.0, 19.0), equal_shifts(6))
    bench = Bench(read=14.0, electrons=1e6)
    noise = NoiseModel.of_camera(14.0)
    found = measure_rest(bench.frames(sequence), sequence, size_px=PANEL, noise=noise)
    rest = found.rest_map
    assert found.order_error > 0.01
    removed = named(found, Reason.WRONG_ORDER) | named(found, Reason.AMBIGUOUS_ORDER)
    assert removed.sum() > 100
    wrong = np.abs(rest.lcd_px - bench.lcd).max(axis=-1)[rest.valid] > 4
    # Of 20,000 pixels not one in ten thousand is left wrong.
    assert wrong.mean() <= 1e-4
    assert rest.valid.mean() > 0.5


def test_a_patch_of_wrong_orders_is_found_by_its_rim():
    # A patch shows another part of the LCD, 144 columns away: pixel by pixel as sound as its neighbours.
    bench = Bench()
    patch = part(slice(30, 60), slice(50, 90))
    bench.lcd[..., 0] += 144.0 * patch
    found = measure(bench)
    assert np.array_equal(named(found, Reason.WRONG_ORDER), patch)
    errors(bench, found)


MIRROR = part(slice(20, 100), slice(30, 140))


@pytest.mark.parametrize("around", [{"mirror": MIRROR}, {"reflectance": np.where(MIRROR, 1.0, 0.1)}])
def test_what_is_not_mirror_or_a_face_that_reflects_a_little_is_named(around):
    bench = Bench(**around)
    found = measure(bench)
    assert np.array_equal(named(found, Reason.NO_MODULATION), ~MIRROR)
    assert np.array_equal(found.rest_map.valid, MIRROR)
    assert errors(bench, found).std() == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("offset", [(37.0, -23.0), (8.0, 3.0), (-150.0, 211.0)])
def test_a_second_reflection_of_a_tenth_is_found_and_named(offset):
    doubled = part(slice(None), slice(80, None))
    bench = Bench(ghost=0.1 * doubled, ghost_offset=offset)
    found = measure(bench)
    masked = named(found, Reason.SECOND_REFLECTION)
    # Pooled over 9 x 9 px: the rim is known to 4 px. Some offsets are near whole periods, and show less.
    assert masked[binary_erosion(doubled, iterations=5, border_value=1)].mean() > 0.97
    assert not masked[~binary_dilation(doubled, iterations=5)].any()
    sound = binary_erosion(~doubled, iterations=5, border_value=1)
    assert found.rest_map.valid[sound].all()
    named_so = {plain_name(reason) for reason in Reason if found.count(reason) > 20}
    assert named_so == {"second reflection"}
    # The periods' offsets draw sin^2 with its mean of one half only over many offsets.
    assert 0.05 < np.median(found.reflection[binary_erosion(doubled, iterations=5)]) < 0.15


def test_a_second_reflection_that_drifts_over_the_first_is_left_out_whole():
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    found = measure(Bench(ghost=0.1, ghost_offset=(0.5 * (u - 80), 0.3 * (v - 64))))
    # Where both lie within a few px of each other the periods agree: the parts next to them show it.
    assert named(found, Reason.SECOND_REFLECTION).mean() > 0.98


@pytest.mark.parametrize("gamma", [1.0, 2.2])
@pytest.mark.parametrize("distance_px", [2.0, 3.0, 4.0, 5.0])
def test_a_second_reflection_too_near_to_leave_out_is_reported_with_what_it_costs(distance_px, gamma):
    bench = Bench(ghost=0.1, ghost_offset=(distance_px, 0.0), gamma=gamma)
    found = measure(bench)
    off = float(np.nanmean((found.rest_map.lcd_px - bench.lcd)[..., 0]))
    assert found.rest_map.valid.mean() > 0.99
    # the cube of the distance is averaged over 33 x 33 px; the series ends with the cube
    assert found.near_px == pytest.approx(distance_px, abs=0.25)
    # share x distance / (1 + share); the sine of the shortest period gives back up to a third of it
    assert 0.6 * 0.1 * found.near_px < off < 0.1 * found.near_px


def test_a_bench_without_one_and_one_of_a_pixel_are_not_reported():
    for seed in range(4):
        assert measure(Bench(seed=seed, gamma=2.2)).near_px == 0
        # what is not found at all costs less than this
        near = Bench(seed=seed, ghost=0.1, ghost_offset=(1.0, 1.0))
        assert np.abs(np.nanmean(measure(near).rest_map.lcd_px - near.lcd, axis=(0, 1))).max() < 0.15


def test_a_second_reflection_that_is_accepted_is_in_sigma():
    bench = Bench(ghost=0.015)
    found = measure(bench)
    z = errors(bench, found)
    assert found.rest_map.valid.mean() > 0.99
    # Its error has one sign over wide areas, so the spread is not 1; it must not exceed it by much.
    assert np.mean(np.abs(z) < 2) > 0.93
    assert np.median(found.reflection) == pytest.approx(0.015, rel=0.5)


@pytest.mark.parametrize(
    ("frames", "left", "repeats"),
    [
        *((frames, 0.5, 1) for frames in (range(9, 13), range(9, 10), range(12, 18), range(20, 26))),
        (range(48, 54), 0.6, 3),
    ],
)
def test_a_hand_in_the_light_is_found_and_named(frames, left, repeats):
    hand = part(slice(40, 90), slice(60, 100))
    bench = Bench(shade=lambda number: np.where(hand, left, 1.0) if number in frames else 1.0)
    found = measure(bench, replace(SEQUENCE, repeats=repeats))
    disturbed = named(found, Reason.DISTURBED)
    assert disturbed[hand].mean() > (0.98 if repeats == 1 else 0.99)
    assert not disturbed[~binary_dilation(hand, iterations=5)].any()
    assert not found.rest_map.valid[hand].any() or np.abs(errors(bench, found)).max() < 6
    assert found.count(Reason.SECOND_REFLECTION) < 0.01 * hand.sum()


def test_a_backlight_that_drifts_is_no_hand():
    bench = Bench(shade=lambda number: 1.0 - 0.05 * (number // 6) / 8)
    found = measure(bench)
    assert found.count(Reason.DISTURBED) == 0
    assert found.light_drift == pytest.approx(0.5 * 0.05 * 7 / 8, abs=0.01)


def test_dead_and_saturated_pixels_are_named():
    bench = Bench()
    frames = bench.frames(SEQUENCE)
    dead, hot = (20, 30), (60, 100)
    for frame in frames:
        frame[dead], frame[hot] = 7, 255
    bright = part(slice(100, 120), slice(10, 40))
    frames[3][bright] = 255
    found = measure_rest(frames, SEQUENCE, size_px=PANEL, noise=NOISE)
    assert named(found, Reason.DEAD)[dead]
    assert named(found, Reason.DEAD)[hot]
    assert found.count(Reason.DEAD) == 2
    assert np.array_equal(named(found, Reason.SATURATED), bright | part(slice(60, 61), slice(100, 101)))
    # One frame of a patch at the ceiling is a light that changed, too.
    assert named(found, Reason.DISTURBED)[bright].mean() > 0.9


def test_pixels_at_a_dead_lcd_pixel_are_named():
    # They receive less light, and that from next to the dead pixel: amplitude 0.5, half a pixel away.
    bench = Bench(reflectance=np.where(part(slice(70, 72), slice(50, 52)), 0.5, 1.0))
    bench.lcd[70, 51, 0] += 0.5
    found = measure(bench)
    assert named(found, Reason.DEAD)[70:72, 50:52].all()
    assert found.count(Reason.DEAD) == 4


def test_a_pixel_that_looks_elsewhere_is_named():
    bench = Bench()
    bench.lcd[50, 60, 1] += 0.8
    found = measure(bench)
    assert named(found, Reason.DEAD)[50, 60]
    assert found.count(Reason.DEAD) == 1


def test_places_past_the_panel_are_named():
    bench = Bench()
    bench.lcd[..., 0] -= 306.0
    past = bench.lcd[..., 0] < -0.5
    found = measure(bench)
    assert 0 < past.sum() < 2000
    masked = named(found, Reason.OFF_DISPLAY) | named(found, Reason.WRONG_ORDER)
    clearly = (bench.lcd[..., 0] < -0.8) & (bench.lcd[..., 0] > -7.5)  # the search reaches 8 px past
    assert masked[clearly].all()
    assert not masked[bench.lcd[..., 0] > -0.3].any()


def test_without_a_panel_size_the_periods_say_how_far_to_look():
    bench = Bench()
    found = measure_rest(bench.frames(SEQUENCE), SEQUENCE)
    assert found.size_px[0] > PANEL[0]
    assert errors(bench, found).std() == pytest.approx(1.0, abs=0.03)
