"""Noise against what sensor and reader state of an image with that noise."""

import numpy as np
import pytest

from zeromethod.design import SampledView
from zeromethod.design.noise_floor import (
    contrast,
    depth_sigma_nm,
    displacement_sigma_px,
    grid_bias_px,
    noise_floor,
    slope_sigma_urad,
)
from zeromethod.pattern.target import Target
from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor

from .design_benches import small, telecentric

NOISE = Noise(read_grey=2.0, electrons_per_grey=150.0, black_grey=4.0)


def image(rig, rng: np.random.Generator) -> np.ndarray:
    """What a camera with the rig's noise sees of its target, white at 80 % of full scale."""
    camera = rig.camera
    v, u = np.mgrid[: camera.rows, : camera.columns].astype(float)
    light = Target.from_spec(rig.target).light(u, v)
    grey = (0.8 * 255 - camera.noise.black_grey) * light
    spread = np.sqrt(camera.noise.read_grey**2 + grey / camera.noise.electrons_per_grey)
    return np.clip(np.rint(camera.noise.black_grey + grey + spread * rng.normal(size=grey.shape)), 0, 255)


@pytest.mark.parametrize("kind", ["cosines", "checker", "lattice", "noise"])
def test_the_sensor_scatters_as_predicted(kind):
    rig = telecentric(camera={"psf_px": 0.0, "noise": NOISE}, target={"kind": kind})
    view = SampledView(rig)
    sensor = ResidualSensor.from_rig(rig, view.grid, light=Target.from_spec(rig.target).light)
    rng = np.random.default_rng(1)
    d = [sensor.measure(image(rig, rng).astype(np.uint8)).d[view.grid.inner].copy() for _ in range(40)]
    measured = np.sqrt(np.mean(np.var(d, axis=0, ddof=1)))
    predicted = float(np.median(displacement_sigma_px(view)))
    # 40 frames of some 60 independent nodes: 2 %. A pixel is taken to be wide, the image's are points: 1 %.
    # Edges weigh noise by their own light, and random texture varies from window to window: 25 %.
    tolerance = 0.05 if kind == "cosines" else 0.25
    assert measured == pytest.approx(predicted, rel=tolerance)


def test_slope_noise_is_displacement_noise_by_the_lever(view):
    lever = 2 * view.x_mm * np.sin(np.radians(50.0)) / 0.1  # camera px per rad along x
    expected = 1e6 * displacement_sigma_px(view) / lever
    np.testing.assert_allclose(slope_sigma_urad(view)[view.on_lcd][:, 0], expected[view.on_lcd], rtol=1e-6)


def test_depth_noise_follows_the_light():
    camera = {"noise": Noise(read_grey=2.0, black_grey=4.0)}
    quiet = SampledView(small(camera=camera))
    dim = SampledView(small(camera=camera, simulation={"peak_grey_share": 0.4}))
    ratio = np.nanmedian(depth_sigma_nm(dim)) / np.nanmedian(depth_sigma_nm(quiet))
    # with a noise that does not depend on light, sigma goes with 1 / (light above black)
    assert ratio == pytest.approx((0.8 * 255 - 4) / (0.4 * 255 - 4), rel=1e-3)


def test_below_total_reflection_the_lost_light_counts():
    lit, dim = (
        SampledView(telecentric(angle, camera={"noise": Noise(read_grey=2.0)})) for angle in (46.0, 45.0)
    )
    ratio = np.nanmedian(displacement_sigma_px(dim)) / np.nanmedian(displacement_sigma_px(lit))
    s, p = 0.7334, 0.5379  # Fresnel's at 45 deg, index 1.41; the light is not polarised
    assert ratio == pytest.approx(2 / (s + p), rel=1e-3)


def test_blur_takes_contrast_by_the_gaussians_transfer():
    sharp, soft = (contrast(telecentric(camera={"psf_px": psf})) for psf in (0.0, 2.0))
    expected = np.exp(-2 * (np.pi * 2.0 / 16) ** 2)
    assert soft.carrier / sharp.carrier == pytest.approx(expected, rel=1e-9)
    assert soft.mean == pytest.approx(0.5)
    assert sharp.carrier == pytest.approx(0.5 * 0.45 * np.sinc(1 / 16), rel=1e-9)


def test_means_fall_with_the_root_of_the_frames_and_the_filter_with_its_gain():
    found = noise_floor(SampledView(small(control={"gain": 0.5})))
    by_frames = {one["frames"]: one["depth_rms_nm"] for one in found["averaged"]}
    assert by_frames[100] == pytest.approx(found["depth_rms_nm"] / 10)
    # an exponential mean with gain g leaves g / (2 - g) of the variance
    assert found["filter_share"] == pytest.approx(np.sqrt(1 / 3))


def test_lcd_pixels_beat_only_where_they_fold_onto_the_carrier():
    # 1.0625 LCD px per camera px: the grid is seen as waves of 16 camera px, as long as the carrier's
    pitch_mm = 0.1 / 1.0625
    display = {"pitch_mm": pitch_mm, "columns": 1000, "rows": 800, "fill_factor": (0.9, 0.85)}
    sharp = {"psf_px": 0.0}
    beating = np.nanmax(grid_bias_px(SampledView(telecentric(camera=sharp, display=display))))
    # rows: sinc(fill) of light, through a square camera pixel, over the carrier's share of the mean
    wave = 2 * np.sinc(0.85) * np.sinc(1.0625)
    expected = 16 / (2 * np.pi) * abs(wave) / (0.45 * np.sinc(1 / 16))
    assert beating == pytest.approx(expected, rel=1e-4)
    whole = {"fill_factor": (1.0, 1.0)}
    assert np.nanmax(grid_bias_px(SampledView(telecentric(camera=sharp, display=display | whole)))) < 1e-12
    aside = display | {"pitch_mm": 0.1 / 0.75}
    assert np.nanmax(grid_bias_px(SampledView(telecentric(camera=sharp, display=aside)))) < 0.02 * beating


def test_carrier_held_over_whole_lcd_pixels_beats_as_much_as_stated():
    """A row of LCD pixels without gaps, each of one grey, seen by square camera pixels: 0.836 LCD px each."""
    period, ratio, fine = 12, 0.836, 50
    pixel = np.repeat(np.arange(4000.0), fine)
    light = 1 + 0.9 * np.cos(2 * np.pi * pixel / (period * ratio))
    edges = np.arange(3000)[:, None] * ratio + ratio * np.array([-0.5, 0.5]) + 500
    summed = np.interp(edges, np.arange(pixel.size + 1) / fine, np.concatenate([[0], np.cumsum(light)]))
    seen = np.diff(summed, axis=1)[:, 0] * np.exp(-2j * np.pi * np.arange(3000) / period)
    window = np.convolve(np.ones(period), np.ones(period))
    phase = np.angle(np.convolve(seen, window, "valid"))
    truly = period / (2 * np.pi) * np.ptp(phase) / 2
    display = {"pitch_mm": 0.1 / ratio, "columns": 1000, "rows": 800, "fill_factor": (1.0, 1.0)}
    rig = telecentric(camera={"psf_px": 0.0}, display=display, target={"period_px": period})
    # the bound takes the carrier as large as without the LCD pixels' apertures, 2 % more here
    assert np.nanmax(grid_bias_px(SampledView(rig))) == pytest.approx(truly, rel=0.03)
