"""What a zero leaves open of depth: an error of the rig that moves the rest as an LCD's slide would."""

import numpy as np
import pytest
from small_rigs import SMALL_LCD, quarter

from zeromethod.calibration import Priors
from zeromethod.calibration.left_open import LeftOpen
from zeromethod.optics import Dented, Optics
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.surface import SurfaceReader, peak
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

RIG = quarter(display=SMALL_LCD, target={"period_px": 16})
DEPTH_MM = 0.1


@pytest.fixture(scope="module")
def rest() -> Rest:
    return Rest.of(RIG, Optics(RIG))


def share_mid(left: LeftOpen, zero: np.ndarray) -> float:
    return float(left.geometry(zero).sigmas(np.array(42.0), np.array(0.0))[0])


def test_an_lcd_that_slid_a_pixel_leaves_what_a_turned_camera_would_do_and_nothing_leaves_nothing(rest):
    left, one = LeftOpen(RIG, rest), np.ones(rest.q.shape)
    # exact rays: a camera turned as far as moves the rest by 0.063 mm reads 0.25 to 0.3 % too deep
    assert 0.001 < share_mid(left, 0.25 * one * (1.0, 0.0)) < 0.006
    noise = np.random.default_rng(1).normal(0.0, 0.003, rest.q.shape)
    assert share_mid(left, noise) < 1e-4


@pytest.mark.parametrize(
    "wrong",
    [
        {"prism.pattern_angle_deg": 1, "prism.captured_less_pattern_deg": -1},
        {"gap_mm": 1},
        {"camera.z_mm": 0.05},
    ],
)
def test_a_press_read_from_a_zero_with_a_wrong_rig_is_within_its_sigma(rest, wrong):
    priors = Priors.of(RIG)
    true = Optics(priors.at(np.array([wrong.get(name, 0.0) for name in priors.names])))
    u, v = rest.grid.mesh()
    zero = true.trace(u, v, true.rest).q - rest.q
    dent = Mirror((load(42.0, 0.0, DEPTH_MM, 3.5),))
    q = true.trace(u, v, Dented(true.rest, dent)).q - zero
    seen = rest.visible & np.isfinite(q).all(axis=-1)
    warp = Warp(
        np.where(seen[..., None], q, rest.q),
        np.full(q.shape, 0.003),
        np.where(seen, 0, 1).astype(np.uint16),
        0,
    )
    reader = SurfaceReader(RIG, Optics(RIG), rest.grid)
    stated = Warp(
        warp.q, warp.sigma, warp.flags, 0, left_open=LeftOpen(RIG, rest).geometry(np.nan_to_num(zero))
    )
    bare, found = (peak(reader.read(one)) for one in (warp, stated))
    away = abs(found.depth_mm - DEPTH_MM)
    assert away > 5 * bare.sigma_mm
    assert away < 2 * found.sigma_mm < 0.02 * DEPTH_MM
