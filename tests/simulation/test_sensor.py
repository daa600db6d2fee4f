"""Gain, noise and quantisation of the simulated chip."""

import numpy as np
import pytest

from zeromethod.simulation.sensor import Sensor

QUIET = {"read_grey": 0.0, "black_grey": 4.0}


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (12, np.uint16), (16, np.uint16)])
def test_white_is_the_peak_share_of_full_scale_and_dark_the_black_level(make_rig, bits, dtype):
    sensor = Sensor(make_rig(camera={"bits": bits, "noise": QUIET}))
    light = np.tile(np.array([0.0, 0.5, 1.0, 5.0], np.float32), (2, 1))
    image = sensor.image(light, 0)
    full = 2**bits - 1
    assert image.dtype == dtype
    expected = [4, np.rint(4 + 0.5 * (0.8 * full - 4)), np.rint(0.8 * full), full]
    np.testing.assert_array_equal(image, [expected, expected])


def test_variance_is_read_noise_shot_noise_and_rounding(make_rig):
    noise = {"read_grey": 2.0, "electrons_per_grey": 20.0, "black_grey": 10.0}
    rig = make_rig(camera={"noise": noise})
    shape = rig.camera.rows, rig.camera.columns
    peak = 0.8 * 255 - 10
    for level in (0.0, 0.5):
        frames = [Sensor(rig).image(np.full(shape, level, np.float32), n) for n in range(20)]
        grey = np.array(frames, float)
        expected = 4.0 + level * peak / 20 + 1 / 12
        # 100 000 samples: 3 sigma of a variance is 1.3 %, of a mean 0.03 grey
        assert grey.var() == pytest.approx(expected, rel=0.015)
        assert grey.mean() == pytest.approx(10 + level * peak, abs=0.03)


def test_noise_depends_on_seed_and_frame_number_alone(make_rig):
    rig, other = make_rig(), make_rig(simulation={"seed": 1})
    light = np.full((rig.camera.rows, rig.camera.columns), 0.5, np.float32)
    sensor = Sensor(rig)
    seventh = sensor.image(light, 7)
    assert not np.array_equal(seventh, sensor.image(light, 8))
    assert np.array_equal(seventh, sensor.image(light, 7))
    assert np.array_equal(seventh, Sensor(rig).image(light, 7))
    assert not np.array_equal(seventh, Sensor(other).image(light, 7))


def test_the_fixed_pattern_is_each_pixels_own_gain_and_black_level_in_every_frame(make_rig):
    pattern = {"pixel_gain": 0.01, "pixel_offset_grey": 1.0}
    rig = make_rig(camera={"bits": 16, "noise": QUIET}, simulation={"nuisances": pattern})
    shape = rig.camera.rows, rig.camera.columns
    sensor = Sensor(rig)
    dark, half = (sensor.image(np.full(shape, level, np.float32), 0).astype(float) for level in (1e-3, 0.5))
    assert np.array_equal(half, Sensor(rig).image(np.full(shape, 0.5, np.float32), 9))
    # standard deviations to 1 / sqrt(2 pixels), correlations to 1 / sqrt(pixels): 4 sigma
    near = 4 / np.sqrt(half.size)
    gain = (half - dark) / (half - dark).mean() - 1
    assert gain.std() == pytest.approx(0.01, rel=near)
    assert np.mean(gain[1:] * gain[:-1]) == pytest.approx(0.0, abs=1e-4 * near)
    # black level, the gain of a thousandth of the light, and rounding
    own = np.sqrt(1.0 + (1e-5 * 0.8 * 65535) ** 2 + 1 / 12)
    assert dark.std() == pytest.approx(own, rel=near)
