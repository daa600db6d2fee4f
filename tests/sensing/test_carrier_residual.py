import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.sensing import Residual, ResidualSensor
from zeromethod.sensing.window import curvature_bias_px2
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.validity import Flag

from .sensing_scenes import (
    GRID,
    INNER,
    PERIOD,
    QUIET,
    SHAPE,
    at_nodes,
    bump,
    checker,
    cosines,
    exposed,
    lattice,
    observed,
    observed_periodic,
    pixels,
)


@pytest.fixture(scope="module")
def sensor():
    return ResidualSensor(GRID, "cosines", QUIET, 16)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.37, -0.81), (-3.2, 3.9), (7.4, -7.4)])
def test_uniform_shift_is_exact(sensor, shift):
    d = sensor.measure(exposed(observed(cosines, *shift))).d[INNER]
    # 16 bit quantisation leaves 1e-5 px; float32 sums less
    assert np.abs(d - shift).max() < 1e-4


def test_sign_bright_spot_to_the_left_means_positive_du(sensor):
    """The target's maximum at u = 160 appears at u = 157, so what appears at 157 was shown at 157 + 3."""
    u, v = pixels()
    image = exposed(cosines(u - 157, v))
    d = sensor.measure(image).d[INNER]
    assert d[..., 0] == pytest.approx(3.0, abs=1e-3)
    assert d[..., 1] == pytest.approx(0.0, abs=1e-3)


def test_components_are_independent(sensor):
    u, v = pixels()
    dv = 0.5 * np.cos(2 * np.pi * u / 100) * np.cos(2 * np.pi * v / 90)
    d = sensor.measure(exposed(observed(cosines, 0.0, dv))).d[INNER]
    # strain 0.03: what leaks of the other carrier through the double zero is its square
    assert np.abs(d[..., 0]).max() < 2e-3
    assert np.abs(d[..., 1]).max() > 0.3


def test_smooth_displacement_is_the_windows_average(sensor):
    u, v = pixels()
    s, shape = 40.0, bump(40.0)
    du, dv = 0.8 * shape, -0.5 * shape
    residual = sensor.measure(exposed(observed(cosines, du, dv)))
    laplacian = shape * (((u - 160) ** 2 + (v - 128) ** 2) / s**4 - 2 / s**2)
    for k, (amplitude, truth) in enumerate([(0.8, du), (-0.5, dv)]):
        bias = curvature_bias_px2(PERIOD) * amplitude * laplacian
        # first-order bias removed; what is left is of fourth order in window / bump, 3 x (8/40)^4 x 0.5
        assert np.abs(residual.d[INNER][..., k] - at_nodes(truth + bias)).max() < 2.5e-3


def test_brightness_gradient_does_not_leak(sensor):
    u, v = pixels()
    shade = 1 + 0.002 * (u - 160) - 0.002 * (v - 128)
    d = sensor.measure(exposed(0.6 * shade * observed(cosines))).d[INNER]
    # one box as window would give 0.135 px at 0.2 %/px
    assert np.abs(d).max() < 1e-3


def test_gain_and_offset_of_the_light_do_not_matter(sensor):
    light = observed(cosines, 1.3, -0.4)
    one = sensor.measure(exposed(light)).copy()
    two = sensor.measure(exposed(0.3 + 0.35 * light))
    # quantisation only
    assert np.abs(one.d - two.d).max() < 1e-4
    assert two.modulation[INNER] == pytest.approx(0.35 * one.modulation[INNER], rel=1e-3)


def test_mean_and_modulation_are_those_of_the_picture(sensor):
    residual = sensor.measure(exposed(observed(cosines, 2.2, 1.1)))
    full = 0.8 * 65535
    assert residual.mean[INNER] == pytest.approx(0.5 * full, rel=1e-4)
    assert residual.modulation[INNER] == pytest.approx(0.5 * 0.45 * full, rel=1e-4)


@pytest.mark.parametrize(("kind", "light"), [("checker", checker), ("lattice", lattice)])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.37, -0.81), (1.9, 2.6)])
def test_targets_with_harmonics(kind, light, shift):
    sensor = ResidualSensor(GRID, kind, QUIET, 16, light=light)
    d = sensor.measure(exposed(observed_periodic(light, *shift))).d[INNER]
    # harmonics up to P/2 are rejected; the hard edges' 15th aliases onto the carrier: 1/15 of it,
    # times 1/15 by the pixel's area = 0.0044 rad = 0.012 px at worst
    assert np.abs(d - shift).max() < 0.013


def test_harmonics_below_half_the_sampling_rate_are_rejected(sensor):
    def light(u, v):
        total = cosines(u, v)
        for n in range(2, 8):
            total = total + 0.02 * (
                np.cos(2 * np.pi * n * u / PERIOD) - np.cos(2 * np.pi * n * v / PERIOD + 1)
            )
        return total

    d = sensor.measure(exposed(observed(light, 1.25, -0.5))).d[INNER]
    assert np.abs(d - (1.25, -0.5)).max() < 1e-4


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_every_bit_depth(bits):
    sensor = ResidualSensor(GRID, "cosines", QUIET, bits)
    u, v = pixels()
    residual = sensor.measure(exposed(observed(cosines, 0.4 + 0.001 * v, -0.3 - 0.001 * u), bits))
    d = residual.d[INNER] - np.stack([at_nodes(0.4 + 0.001 * v), at_nodes(-0.3 - 0.001 * u)], axis=-1)
    assert residual.flags[INNER].max() == 0
    # rounding at worst in step with the carrier: (4/pi) x 1/2 grey against its amplitude; 1e-4 float32
    amplitude = 0.8 * (2**bits - 1) * 0.5 * 0.45
    assert np.abs(d).max() < PERIOD / (2 * np.pi) * (2 / np.pi) / amplitude + 1e-4


@pytest.mark.parametrize(
    ("shape", "period"), [((131, 207), 16), ((97, 94), 10), ((66, 64), 8), ((150, 171), 24)]
)
def test_any_size_and_even_period(shape, period):
    grid = NodeGrid(shape, period)
    sensor = ResidualSensor(grid, "cosines", QUIET, 16)
    light = observed(lambda u, v: cosines(u, v, period), 0.7, -1.1, shape)
    residual = sensor.measure(exposed(light))
    assert np.abs(residual.d[grid.inner] - (0.7, -1.1)).max() < 1e-4
    assert residual.d.shape == (*grid.shape, 2)


def test_padding_is_outside_and_zero(sensor):
    residual = sensor.measure(exposed(observed(cosines, 1.0, 1.0)))
    outside = np.ones(GRID.shape, bool)
    outside[INNER] = False
    assert (residual.flags[outside] == Flag.OUTSIDE).all()
    assert (residual.d[outside] == 0).all()
    assert np.isinf(residual.sigma[outside]).all()
    assert residual.valid.sum() == (GRID.shape[0] - 2 * PADDING) * (GRID.shape[1] - 2 * PADDING)


def test_out_keeps_a_result_and_the_sensors_own_is_overwritten(sensor):
    mine = Residual.empty(GRID)
    assert sensor.measure(exposed(observed(cosines, 1.0, 0.0)), out=mine) is mine
    own = sensor.measure(exposed(observed(cosines, 2.0, 0.0)))
    assert mine.d[INNER][..., 0] == pytest.approx(1.0, abs=1e-3)
    sensor.measure(exposed(observed(cosines, 3.0, 0.0)))
    assert own.d[INNER][..., 0] == pytest.approx(3.0, abs=1e-3)


def test_same_image_same_bits(sensor):
    image = exposed(observed(cosines, 0.3, 0.2))
    one = sensor.measure(image).copy()
    assert np.array_equal(one.d, sensor.measure(image).d)


def test_wrong_image_is_refused_in_one_line(sensor):
    for image, words in ((np.zeros(SHAPE), "256, 320"), (np.zeros((10, 10), np.uint8), "10, 10")):
        with pytest.raises(InputError, match=rf"image: \({words}\) {image.dtype}"):
            sensor.measure(image)
    for grid, kind, words in (
        (GRID, "stripes", "target.kind: 'stripes'"),
        (NodeGrid((20, 20)), "cosines", "larger than 2 periods"),
        (GRID, "noise", "light: None"),
    ):
        with pytest.raises(InputError, match=words):
            ResidualSensor(grid, kind, QUIET, 8)


@pytest.mark.parametrize(("kind", "light"), [("cosines", cosines), ("checker", checker)])
def test_a_known_phase_of_the_target_is_no_displacement(kind, light):
    sensor = ResidualSensor(GRID, kind, QUIET, 16, light=light)
    u, v = 0.31 * PERIOD, -0.47 * PERIOD
    turns = 2 * np.pi / PERIOD * np.array((u, v) if kind == "cosines" else (u + v, u - v))
    known = np.tile(turns, (*GRID.shape, 1))
    found = sensor.measure(exposed(observed_periodic(light, 0.8 + u, 1.1 + v)), target_rad=known)
    # of hard edges as above
    assert np.abs(found.d[INNER] - (0.8, 1.1)).max() < (1e-4 if kind == "cosines" else 0.013)
    assert found.flags[INNER].max() == 0
