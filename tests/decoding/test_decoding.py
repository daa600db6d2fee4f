"""Least squares over the shifts: equal and unequal, harmonics, and the noise that is found in the frames."""

import numpy as np
import pytest
from decoding.planted import PANEL, Bench

from zeromethod.decoding.decoding import decode_phasors
from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import measure_rest
from zeromethod.decoding.noise import NoiseModel, fit_noise
from zeromethod.decoding.periods import choose_periods
from zeromethod.errors import InputError

PERIODS = choose_periods(PANEL[0])
UNEQUAL = tuple(np.deg2rad([0, 50, 130, 170, 220, 300]))


@pytest.mark.parametrize("shifts", [equal_shifts(3), equal_shifts(6), equal_shifts(9)[::-1], UNEQUAL])
def test_phases_are_exact_without_noise(shifts):
    sequence = FringeSequence((17.0, 20.0), shifts)
    bench = Bench((16, 24))
    frames = [
        100.0 + 50.0 * np.cos(2 * np.pi * bench.lcd[..., axis] / period - shift)
        for axis in range(2)
        for period in sequence.periods_px
        for shift in shifts
    ]
    phasors = decode_phasors(frames, sequence)
    for axis in range(2):
        for n, period in enumerate(sequence.periods_px):
            z = phasors.cosine[axis][n] + 1j * phasors.sine[axis][n]
            # Kept as float32: 1e-7 of 50 grey levels.
            assert np.allclose(z, 50 * np.exp(2j * np.pi * bench.lcd[..., axis] / period), atol=2e-5)
    assert np.allclose(phasors.mean, 100, atol=1e-4)
    if len(shifts) >= 6:  # fewer shifts take neighbours for noise
        assert phasors.scatter.max() < 1e-6


@pytest.mark.parametrize("count", [3, 4, 5, 6, 8])
def test_a_panel_without_inverse_response_does_no_harm(count):
    bench = Bench(gamma=2.2)
    found = measure_rest(
        bench.frames(sequence := FringeSequence(PERIODS, equal_shifts(count))), sequence, size_px=PANEL
    )
    rest = found.rest_map
    z = (rest.lcd_px - bench.lcd)[rest.valid] / rest.sigma_px[rest.valid]
    assert rest.valid.mean() > (0.98 if count == 3 else 0.9999)
    # 41,000 errors know their spread to 0.4 %; harmonics that are left may add a tenth.
    assert z.std() == pytest.approx(1.0, abs=0.12)
    if count == 3:
        # sum of the binomial series of (1/2 + 0.45 cos)^2.2: second over first harmonic is 0.24 without blur,
        # which takes 0.66 of it at 16 px, and 0.85 at 25.
        assert 0.15 < found.folded_harmonic < 0.24
    if count >= 6:
        assert found.second_harmonic == pytest.approx(0.2, abs=0.03)


def test_camera_noise_is_found_in_the_frames():
    # The view's light varies by four, so constant and slope can be separated.
    rows, cols = 128, 160
    bench = Bench(reflectance=np.linspace(0.25, 1.0, cols)[None, :] * np.ones((rows, 1)), electrons=20.0)
    sequence = FringeSequence(PERIODS, equal_shifts(8))
    found = measure_rest(bench.frames(sequence), sequence, size_px=PANEL)
    true = NoiseModel.of_camera(bench.read, bench.electrons, bench.black)
    for grey in (50.0, 100.0):
        # Half of 20,480 pixels, 8 degrees of freedom each, in medians of 12 classes: 1 %.
        assert found.noise.variance(grey) == pytest.approx(true.variance(grey), rel=0.05)
    assert found.noise_found


def test_scatter_beyond_the_stated_noise_widens_sigma():
    bench = Bench(read=4.0, electrons=1e6)
    sequence = FringeSequence(PERIODS, equal_shifts(6))
    found = measure_rest(bench.frames(sequence), sequence, size_px=PANEL, noise=NoiseModel.of_camera(2.0))
    rest = found.rest_map
    z = (rest.lcd_px - bench.lcd)[rest.valid] / rest.sigma_px[rest.valid]
    assert found.scatter_ratio == pytest.approx(np.sqrt((16 + 1 / 12) / (4 + 1 / 12)), rel=0.02)
    assert z.std() == pytest.approx(1.0, abs=0.02)


def test_noise_of_a_few_pixels_is_not_guessed():
    assert fit_noise(np.full(10, 100.0), np.ones(10), 3) is None


@pytest.mark.parametrize(
    ("periods", "shifts", "words"),
    [
        ((16.0, 16.0), equal_shifts(4), "each period once"),
        ((1.0, 16.0), equal_shifts(4), "2 LCD px or more"),
        ((16.0,), equal_shifts(4), "two or more"),
        ((16.0, 18.0), equal_shifts(2), "three or more"),
        ((16.0, 18.0), (0.0, 1.0, 1.0 + 2 * np.pi), "three or more"),
        ((16.0, 18.0), (0.0, 0.05, 0.1), "spread over the turn"),
    ],
)
def test_a_sequence_that_cannot_be_decoded_is_refused(periods, shifts, words):
    with pytest.raises(InputError, match=words):
        FringeSequence(periods, shifts)


def test_pictures_are_what_the_decoder_expects():
    sequence = FringeSequence(choose_periods(160), equal_shifts(6))
    pictures = list(sequence.pictures(160, 96))
    assert len(pictures) == sequence.frames
    assert min(p.min() for p in pictures) >= 0.05 - 1e-6
    assert max(p.max() for p in pictures) <= 0.95 + 1e-6
    rest = measure_rest(
        [200 * p for p in pictures], sequence, size_px=(160, 96), noise=NoiseModel.of_camera(0.5)
    ).rest_map
    rows, cols = np.mgrid[:96, :160]
    # Seen pixel by pixel, the LCD's own pixel numbers come back; light is kept as float32.
    assert np.abs(rest.lcd_px - np.stack([cols, rows], axis=-1)).max() < 1e-4
