import numpy as np
import pytest

from zeromethod.pattern import Target
from zeromethod.pattern.target import NOISE_BAND
from zeromethod.rig.model import TargetSpec

KINDS = ("cosines", "checker", "lattice", "noise")


@pytest.mark.parametrize("kind", KINDS)
def test_light_stays_within_mean_and_contrast(kind):
    u, v = np.meshgrid(np.arange(0, 128, 0.37), np.arange(0, 128, 0.41))
    light = Target(kind, 16, mean=0.4, contrast=0.8).light(u, v)
    assert light.min() >= 0.4 * 0.2 - 1e-12
    assert light.max() <= 0.4 * 1.8 + 1e-12
    assert np.ptp(light) > 0.4 * 0.8


def test_cosines_have_their_closed_form():
    target = Target(period_px=16, mean=0.5, contrast=0.9)
    assert target.light(0, 0) == pytest.approx(0.95)
    assert target.light(8, 8) == pytest.approx(0.05)
    assert target.light(4, 12) == pytest.approx(0.5)
    assert target.light(16, 0) == pytest.approx(target.light(0, 32))


def test_checker_has_squares_of_half_a_period_centred_on_the_origin():
    target = Target("checker", 16, mean=0.5, contrast=1)
    assert target.light(3.9, -3.9) == 1
    assert target.light(4.1, 0) == 0
    assert target.light(8, 8) == 1


def test_lattice_has_lines_of_a_quarter_period():
    target = Target("lattice", 16, mean=0.5, contrast=1)
    assert target.light(1.9, 7) == 1
    assert target.light(2.1, 7) == 0
    assert target.light(7, 17.9) == 1


@pytest.mark.parametrize("kind", ["checker", "lattice"])
def test_edges_drawn_over_one_lcd_px_keep_their_mean_light(kind):
    """Sampled at LCD pixels anywhere against the edge, a period holds the light that it has when sharp."""
    lcd_px = 9.7
    phases = np.linspace(0, 1, 7)[:, None]
    u = 16 / lcd_px * (np.arange(970)[None, :] + phases)  # 100 periods of 9.7 LCD px
    line = 5.0 if kind == "lattice" else 0.0  # along u, off the lines and inside a row of squares
    soft = Target(kind, 16, 0.5, 1.0).light(u, line, lcd_px=(lcd_px, lcd_px)).mean(axis=1)
    expected = 0.25 if kind == "lattice" else 0.5
    assert soft == pytest.approx(expected, abs=1e-3)  # 970 samples; a sharp edge errs by up to 1 in 97


def test_noise_is_seeded_band_limited_and_tiles():
    target = Target("noise", 16, seed=3)
    n = target.texture.shape[0]
    assert np.array_equal(target.texture, Target("noise", 16, seed=3).texture)
    assert not np.array_equal(target.texture, Target("noise", 16, seed=4).texture)
    spectrum = np.abs(np.fft.fft2(target.texture))
    cycles = 16 * np.hypot(np.fft.fftfreq(n)[:, None], np.fft.fftfreq(n)[None, :])
    outside = (cycles < NOISE_BAND[0]) | (cycles > NOISE_BAND[1])
    assert spectrum[outside].max() < 1e-5 * spectrum.max()  # 32-bit texels
    assert target.light(3.25, 7.5) == pytest.approx(float(target.light(3.25 + n, 7.5 - 2 * n)))


def test_target_of_a_rig_file_is_what_the_file_says():
    spec = TargetSpec(kind="checker", period_px=24, mean=0.4, contrast=0.7)
    assert Target.from_spec(spec) == Target("checker", 24, 0.4, 0.7)
