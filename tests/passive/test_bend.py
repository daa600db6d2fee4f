"""What bends of the warp do to depth off still images: sigma holds the planted truth."""

import cv2
import numpy as np
import pytest
from small_rigs import quarter

from zeromethod import Measurement, Warp
from zeromethod.passive.bend import blurred, speck_px2
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.simulation.loads import load
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Dent, Mirror
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.sensor import Sensor


def read(dents: list[Dent], seeds: list[int]) -> list[tuple[float, float, float]]:
    """(planted depth, read, sigma), mm, of each dent under a speckle of its own."""
    rig = quarter(geometry=GeometrySpec(known="exact"))
    renderer, sensor = NumpyRenderer(rig), Sensor(rig)
    share = np.ones(rig.display.rows, np.float32)
    out = []
    for seed, dent in zip(seeds, dents, strict=True):
        noise = np.random.default_rng(seed).normal(size=(rig.display.rows, rig.display.columns))
        smooth = cv2.GaussianBlur(noise, (0, 0), 6.0)
        speckle = np.clip(128 + 100 * smooth / smooth.std(), 0, 255).astype(np.uint8)
        handle = renderer.upload(speckle)
        images = [
            sensor.image(renderer.expose([Piece(1.0, mirror, [(handle, share)])]), 2 * seed + number)
            for number, mirror in enumerate((Mirror(()), Mirror((dent,))))
        ]
        peak = Measurement(images[0], rig=rig).measure(images[1]).peak
        out.append((dent.depth_mm, peak.depth_mm, peak.sigma_mm))
    return out


@pytest.fixture(scope="module")
def readings() -> list[tuple[float, float, float]]:
    """Of dents as curved as Gaussian ones of sigma 5 mm, under two speckles."""
    return read([load(42.0 - seed, seed, 0.2, 3.54) for seed in range(2)], [0, 1])


def test_depth_of_a_dent_lies_within_its_sigma(readings):
    for planted_mm, read_mm, sigma_mm in readings:
        # Noise alone would say 0.05 %; the reading is up to 0.5 % low.
        assert abs(read_mm - planted_mm) < 3.0 * sigma_mm
        assert sigma_mm < 0.01 * planted_mm


def test_a_narrow_dent_keeps_its_nodes_where_single_points_are_not_sure():
    seeds = [0, 3]
    dents = [load(42.0 - seed, seed - 2.0, 0.1, 2.12) for seed in seeds]
    for planted_mm, read_mm, sigma_mm in read(dents, seeds):
        # A dozen nodes less near the summit would make it 6 to 38 % low.
        assert abs(read_mm - planted_mm) < 3.0 * sigma_mm
        # 1.1 % for what lens and specks average; noise adds little.
        assert sigma_mm < 0.013 * planted_mm


def test_a_blur_lowers_a_wave_as_a_gaussian_does():
    v, u = np.mgrid[:40, :40] * 8.0
    k, variance = 2 * np.pi / 200.0, 4.0
    off = np.stack([np.cos(k * u), np.cos(k * v)], axis=-1)
    rest = np.stack([3.0 * u, 3.0 * v], axis=-1)
    warp = Warp(rest + off, np.full(off.shape, 0.01), np.zeros(u.shape, np.uint16), 0)
    got = (blurred(warp, rest, 8.0, variance).q - rest)[2:-2, 2:-2]
    # exp(-k^2 s^2 / 2), whose second order is 2e-6, by differences over 8 px: k^2 8^2 / 12 less of 0.2 %.
    np.testing.assert_allclose(got, np.exp(-0.5 * k**2 * variance) * off[2:-2, 2:-2], atol=2e-5)


def test_the_size_of_specks_is_that_of_the_blur_that_made_them():
    rng = np.random.default_rng(0)
    grey = cv2.GaussianBlur(rng.normal(size=(400, 400)), (0, 0), 2.0)
    grey = 100.0 + 40.0 * grey / grey.std()
    # White noise under a Gaussian s wide: 2 s^2; the window and central differences change it by a tenth.
    assert speck_px2(grey, 0.0) == pytest.approx(8.0, rel=0.15)
    assert speck_px2(grey + 2.0 * rng.normal(size=grey.shape), 2.0) == pytest.approx(8.0, rel=0.15)
