"""Photon transfer: planted noise, black level, bends and bad pixels come back by name and number."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from zeromethod.calibration.bad_pixels import BadPixel, find_bad_pixels
from zeromethod.calibration.photon_transfer import Still, measure_noise, still, unclipped, unclipped_mean
from zeromethod.errors import InputError, MeasurementError

Float = NDArray[np.float64]

SHAPE = (60, 80)
LIT = np.ones(SHAPE, dtype=np.bool_)
LEVELS = (0.0, 5.0, 20.0, 60.0, 120.0, 190.0)
FRAMES = 8


@dataclass
class Camera:
    """A camera of one's own making; light in grey levels above black."""

    read: float = 2.0
    electrons: float = 20.0
    black: float = 12.0
    full: int = 255
    fixed: float = 0.01
    flicker: float = 0.0

    def frames(self, light: float, rng: np.random.Generator, count: int = FRAMES) -> Float:
        """(count, rows, cols); light falls off over the view, pixels differ in gain."""
        place = np.random.default_rng(99)
        shading = np.linspace(1.0, 0.8, SHAPE[1]) * (1 + self.fixed * place.standard_normal(SHAPE))
        gain = 1 + self.flicker * rng.standard_normal((count, 1, 1))
        electrons = rng.poisson(np.maximum(light * shading * gain, 0) * self.electrons, (count, *SHAPE))
        grey = self.black + electrons / self.electrons + self.read * rng.standard_normal((count, *SHAPE))
        return np.clip(np.rint(grey), 0, self.full)

    def stills(self, rng: np.random.Generator, levels: tuple[float, ...] = LEVELS) -> list[Still]:
        return [still(self.frames(light, rng), LIT, self.full) for light in levels]


@pytest.mark.parametrize(
    "camera",
    [Camera(), Camera(read=1.0, electrons=8.0), Camera(electrons=150.0), Camera(fixed=0.0, flicker=0.02)],
)
def test_planted_noise_comes_back_with_a_sigma_that_holds(camera):
    rng = np.random.default_rng(1)
    found = [measure_noise(camera.stills(rng), LIT) for _ in range(8)]
    away = [((one.electrons_per_grey or np.nan) - camera.electrons) / one.electrons_sigma for one in found]
    # 8 normal numbers: rms 1 +- 0.25
    assert 0.35 < np.sqrt(np.mean(np.square(away))) < 1.8
    for one in found:
        assert one.electrons_sigma < 0.1 * camera.electrons
        # what weighs the frames is known, wherever the black level lies
        for grey in (12.0, 100.0, 200.0):
            truth = camera.read**2 + (grey - camera.black) / camera.electrons + 1 / 12
            assert float(one.variance(grey)) == pytest.approx(truth, rel=0.02)


def test_the_black_level_is_known_within_bounds_and_that_is_reported():
    camera = Camera()
    found = measure_noise(camera.stills(np.random.default_rng(2)), LIT)
    assert found.black.low <= camera.black <= found.black.high
    assert abs(found.black.grey - camera.black) < 2 * found.black.sigma
    assert abs(found.read_grey - camera.read) < 2.5 * found.read_sigma
    (note,) = found.notes
    assert note.startswith("black level: between")


def test_noise_that_the_floor_cuts_off_is_restored_and_the_black_level_named():
    camera = Camera(black=1.0)
    rng = np.random.default_rng(5)
    found = measure_noise(camera.stills(rng), LIT)
    assert found.black.low <= 1.0 <= found.black.high
    assert float(found.variance(1.0)) == pytest.approx(2.0**2 + 1 / 12, rel=0.02)
    assert any("raise the camera's black level" in note for note in found.notes)


@pytest.mark.parametrize(("black", "read"), [(0.7, 1.5), (4.0, 2.0), (-0.5, 2.0), (3.0, 1.0), (1.0, 0.6)])
def test_cut_off_noise_has_its_closed_form(black, read):
    noise = np.random.default_rng(6).normal(black, read, 4_000_000)
    cut = np.maximum(np.rint(noise), 0)
    mean, variance = unclipped(float(cut.mean()), float(cut.var()))
    # four million readings: a mean to 5e-4 of the noise, a variance to 7e-4; twice that where half is lost
    assert mean == pytest.approx(black, abs=4e-3 * read)
    assert variance == pytest.approx(read**2 + 1 / 12, rel=6e-3)
    smooth = np.maximum(noise, 0)
    assert float(unclipped_mean(np.array(smooth.mean()), read)) == pytest.approx(black, abs=4e-3 * read)
    assert unclipped(100.0, 4.0) == (100.0, 4.0)


def test_a_black_level_at_the_floor_bends_no_line():
    """A tenth of a percent of a variance shows here: cut-off noise must be restored as well as that."""
    rng = np.random.default_rng(13)
    shape, electrons = (400, 500), 150.0
    lit = np.ones(shape, dtype=np.bool_)
    for black in (2.0, 4.0, 6.0):
        stills = []
        for light in LEVELS:
            sd = np.sqrt(4.0 + light / electrons)
            frames = np.clip(np.rint(black + light + sd * rng.standard_normal((16, *shape))), 0, 255)
            stills.append(still(frames, lit, 255))
        found = measure_noise(stills, lit)
        # 24 points less 2: 2.2 once in a thousand
        assert found.chi2 < 2.2
        assert not any("no straight line" in note for note in found.notes)


def test_a_flickering_backlight_is_no_noise_of_the_camera():
    rng = np.random.default_rng(7)
    quiet = still(Camera(flicker=0.0).frames(150.0, rng), LIT, 255)
    flickers = still(Camera(flicker=0.05).frames(150.0, rng), LIT, 255)
    assert flickers.level.std() > 2
    # 4800 px of 7 degrees: a variance is good to 0.8 %; Poisson noise goes with the light, 1 %
    assert flickers.variance.mean() == pytest.approx(quiet.variance.mean(), rel=0.04)


def test_pictures_too_bright_for_the_camera_are_left_out():
    camera = Camera()
    rng = np.random.default_rng(8)
    found = measure_noise(camera.stills(rng, (*LEVELS, 260.0, 400.0)), LIT)
    assert float(found.variance(camera.black)) == pytest.approx(camera.read**2 + 1 / 12, rel=0.02)
    assert abs((found.electrons_per_grey or 0) - camera.electrons) < 4 * found.electrons_sigma
    with pytest.raises(MeasurementError, match="too bright"):
        measure_noise(camera.stills(rng, (500.0,)), LIT)


def test_a_camera_with_a_gamma_of_its_own_is_reported():
    rng = np.random.default_rng(9)
    frames = [255 * (np.maximum(Camera(black=4).frames(light, rng), 0) / 255) ** 0.45 for light in LEVELS]
    found = measure_noise([still(np.rint(one), LIT, 255) for one in frames], LIT)
    assert any("no straight line" in note for note in found.notes)


def test_equally_dark_pictures_give_no_slope():
    camera = Camera()
    rng = np.random.default_rng(10)
    found = measure_noise(camera.stills(rng, (0.0, 0.0)), LIT)
    assert found.electrons_per_grey is None
    assert "camera.noise.electrons_per_grey" not in found.rig_values()
    assert abs(found.read_grey - camera.read) < 4 * found.read_sigma
    assert any("equally dark" in note for note in found.notes)


def test_bad_pixels_are_named_and_sound_ones_are_not():
    camera = Camera(fixed=0.02)
    rng = np.random.default_rng(11)
    planted = {
        (5, 7): BadPixel.HOT,
        (20, 30): BadPixel.DEAD,
        (40, 50): BadPixel.NOISY,
        (50, 10): BadPixel.STUCK,
    }
    frames = []
    for light in LEVELS:
        stack = camera.frames(light, rng)
        stack[:, 5, 7] = np.minimum(stack[:, 5, 7] + 40, 255)
        stack[:, 20, 30] = np.rint(camera.black + 0.3 * light + camera.read * rng.standard_normal(FRAMES))
        stack[:, 40, 50] += np.rint(8 * rng.standard_normal(FRAMES))
        stack[:, 50, 10] = 60
        frames.append(stack)
    stills = [still(stack, LIT, 255) for stack in frames]
    noise = measure_noise(stills, LIT)
    found = find_bad_pixels(stills[-1], stills[0], LIT, noise, stills[1:-1])
    for place, reason in planted.items():
        assert BadPixel(int(found[place])) & reason, (place, BadPixel(int(found[place])))
    assert {(row, col) for row, col in np.argwhere(found)} == set(planted)
    assert BadPixel(int(found[5, 7])) is BadPixel.HOT
    assert np.count_nonzero(found & BadPixel.NOISY) == 1


def test_the_edge_of_the_mirror_is_not_dead():
    camera = Camera()
    rng = np.random.default_rng(12)
    lit = np.zeros(SHAPE, dtype=np.bool_)
    lit[10:50, 15:70] = True
    white = np.where(lit, camera.frames(190.0, rng), camera.frames(0.0, rng))
    stills = [still(camera.frames(0.0, rng), lit, 255), still(white, lit, 255)]
    noise = measure_noise(stills, lit)
    assert not find_bad_pixels(stills[1], stills[0], lit, noise).any()


def test_one_frame_is_no_still():
    with pytest.raises(InputError, match="two or more"):
        still(np.zeros((1, 4, 4)), np.ones((4, 4), dtype=np.bool_), 255)
