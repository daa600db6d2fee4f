"""What a calibration leaves open is stated by every reading, the same error in all of its nodes."""

import numpy as np
import pytest
from surface_bench import Bench, Load, small_rig

from zeromethod.rig.geometry import GeometrySpec
from zeromethod.surface import peak

SHARE, TILT = 0.004, 0.002
"""Planted errors of depth: of everything alike, and growing along x."""

CENTRE_MM = 38.0
PLANTED = GeometrySpec(
    known="calibrated",
    centre_mm=(CENTRE_MM, 0.0),
    reach_mm=(10.0, 10.0),
    depth=((SHARE, 0, 0, 0, 0, 0), (0, TILT, 0, 0, 0, 0)),
    x_mm=((0.3, 0, 0, 0, 0, 0), (0.4, 0, 0, 0, 0, 0)),
    y_mm=((0, 0, 0, 0, 0, 0), (0, 0, 0.5, 0, 0, 0)),
)
DENT = Load(0.2, CENTRE_MM + 5.0, 1.0, 6.0)


@pytest.fixture(scope="module")
def exact() -> Bench:
    return Bench(small_rig())


@pytest.fixture(scope="module")
def calibrated() -> Bench:
    return Bench(small_rig().model_copy(update={"geometry": PLANTED}))


def test_depths_sigma_is_that_of_noise_and_of_the_geometry(exact, calibrated):
    plain, stated = exact.reader.read(exact.warp(DENT)), calibrated.reader.read(calibrated.warp(DENT))
    np.testing.assert_array_equal(stated.depth_mm, plain.depth_mm)
    along = (stated.x_mm - CENTRE_MM) / 10.0
    wanted = np.hypot(plain.sigma_depth_mm, stated.depth_mm * np.hypot(SHARE, TILT * along))
    # modes are taken at the rest's points: depth moves a node by less than 0.2 mm, a share of 0.02 of TILT
    np.testing.assert_allclose(
        stated.sigma_depth_mm[stated.valid], wanted[stated.valid], atol=0.02 * TILT * 0.2
    )
    np.testing.assert_allclose(stated.sigma_x_mm[stated.valid], 0.5)
    assert not plain.sigma_x_mm.any()


def test_what_is_open_does_not_average_out(exact, calibrated):
    surface = calibrated.reader.read(calibrated.warp(DENT))
    covariance = calibrated.reader.covariance(surface)
    weights = np.where(surface.valid & (surface.depth_mm > 0.1), 1.0, 0.0)
    weights /= weights.sum()
    depth = np.where(surface.valid, surface.depth_mm, 0.0)
    along = (surface.x_mm - CENTRE_MM) / 10.0
    mean = np.array([(weights * depth * SHARE).sum(), (weights * depth * TILT * along).sum()])
    variance = covariance.variance_of(weights)
    assert variance.geometry == pytest.approx((mean**2).sum(), rel=0.01)
    assert variance.total == pytest.approx(variance.noise + variance.anchor + variance.geometry)
    row = covariance.with_mean(weights)
    assert (weights * np.nan_to_num(row.geometry)).sum() == pytest.approx(variance.geometry)
    plain = exact.reader.read(exact.warp(DENT))
    assert exact.reader.covariance(plain).variance_of(weights).geometry == 0.0


def test_a_peak_states_its_own_depth_and_place(exact, calibrated):
    plain = peak(exact.reader.read(exact.warp(DENT)))
    stated = peak(calibrated.reader.read(calibrated.warp(DENT)))
    geometry = stated.depth_mm * np.hypot(SHARE, TILT * 0.5)
    assert stated.sigma_mm == pytest.approx(np.hypot(plain.sigma_mm, geometry), rel=0.05)
    assert stated.sigma_x_mm == pytest.approx(np.hypot(plain.sigma_x_mm, 0.5))
    assert stated.sigma_y_mm == pytest.approx(np.hypot(plain.sigma_y_mm, 0.05), rel=0.3)


@pytest.mark.parametrize("depth_mm", [0.05, 0.2])
def test_a_peaks_place_scatters_with_noise_as_stated(exact, depth_mm):
    """40 draws: rms over sigma within a factor of two, of which draws alone take 11 %."""
    dent, rng = Load(depth_mm, CENTRE_MM, 1.0, 6.0), np.random.default_rng(1)
    peaks = [peak(exact.reader.read(exact.warp(dent, rng))) for _ in range(40)]
    for name in ("x", "y"):
        places = np.array([getattr(one, f"{name}_mm") for one in peaks])
        stated = np.median([getattr(one, f"sigma_{name}_mm") for one in peaks])
        assert 0.5 < places.std() / stated < 2.0
