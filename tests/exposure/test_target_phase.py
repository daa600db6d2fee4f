"""The phase of a moving target in an exposure, against sums over many instants."""

import math

import numpy as np
import pytest
from node_bench import panel, rest_warp

from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import Observation, PanelTiming, pair
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.target_phase import Sight
from zeromethod.pattern.stepping import shift_of

REST = rest_warp(128)
REFRESH_S, EXPOSURE_S = 1 / 60, 0.008
STEP = 16


def seen(
    mid_s: float,
    kind: str = "cosines",
    scan: str = "down",
    late_s: float = 0.0,
    blur: tuple[float, float] = (0.0, 0.0),
    **how,
) -> Observation:
    log = PresentationLog(REST.q.shape[:2])
    for number in range(40):
        log.record(round(1e9 * number * REFRESH_S), REST.q, None, None, shift_of(STEP, number))
    timing = PanelTiming.of(panel(scan=scan, latency_s=0.002 + late_s, **how))
    frame = Frame(np.zeros((1, 1)), round(1e9 * mid_s), round(1e9 * EXPOSURE_S), 0)
    sight = Sight.of(REST.q, REST.grid.period_px, kind == "checker", (timing.rows, timing.upwards), blur)
    found = pair(log, frame, timing, REST.q, REST.grid, kind, sight)
    assert found is not None
    return found


def summed(mid_s: float, row_share: float, rise_s: float) -> np.ndarray:
    """(2,) mean of exp(2 pi i s) over instants, of a row at a share of the scan-out."""
    tau = rise_s / math.log(9)
    instants = mid_s + EXPOSURE_S * ((np.arange(20_000) + 0.5) / 20_000 - 0.5)
    starts = np.arange(40) * REFRESH_S + 0.002 + row_share * REFRESH_S
    risen = 1 - np.exp(-np.maximum(instants[:, None] - starts, 0) / tau)
    shares = (risen - np.append(risen[:, 1:], np.zeros((len(risen), 1)), axis=1)).mean(axis=0)
    return shares @ np.exp(2j * np.pi * np.array([shift_of(STEP, number) for number in range(40)]))


@pytest.mark.parametrize("scan", ["down", "up"])
@pytest.mark.parametrize("mid_s", [0.1, 0.1075, 0.1130])
def test_phase_and_contrast_are_those_of_the_light_summed_over_the_exposure(mid_s, scan):
    target = seen(mid_s, scan=scan).target
    rows = np.array([0.0, 100.0, 251.5, 399.0])
    rad, contrast, _ = target.at(rows)
    for row, angle, left in zip(rows, rad, contrast, strict=True):
        share = row / 399
        expected = summed(mid_s, 1 - share if scan == "up" else share, 0.004)
        # linear between 257 rows
        assert np.angle(np.exp(1j * angle) / expected) == pytest.approx(0.0, abs=2e-4)
        assert left == pytest.approx(np.abs(expected), abs=2e-4)
    assert contrast.max() <= 1.0


def test_lateness_changes_the_phase_by_the_stated_rate():
    by_s = 2e-5
    for mid_s in (0.1, 0.1075, 0.31):
        early, late = (seen(mid_s, late_s=side * by_s).target for side in (-1, 1))
        rate = (late.rad - early.rad) / (2 * by_s)
        # later light is older light: against the direction of the steps
        expected = seen(mid_s).target.late_rad_per_s
        assert expected[100, 1] * (1 if mid_s > 0.27 else -1) > 0
        # kinks of single rows, where a picture's change meets the end of the exposure, are rounded off
        assert np.abs(rate - expected).max() < 0.02 * np.abs(expected).max()


def test_a_checkers_carriers_have_the_sum_and_the_difference_of_the_phases():
    cosines, checker = seen(0.03 + 0.1).target, seen(0.03 + 0.1, "checker").target
    p, m = np.moveaxis(checker.node_rad, -1, 0)
    along = 0.5 * np.stack([p + m, p - m], axis=-1)
    # equal but for the mixing of two pictures, and for whole periods along u + v and u - v
    apart = np.angle(np.exp(2j * (cosines.node_rad - along)))
    assert np.abs(apart).max() < 0.03


def test_a_picture_alone_has_its_own_phase_and_full_contrast_and_no_rate():
    log = PresentationLog(REST.q.shape[:2])
    log.record(0, REST.q, shift=(0.25, 0.5))
    frame = Frame(np.zeros((1, 1)), 10**9, round(1e9 * EXPOSURE_S), 0)
    found = pair(log, frame, PanelTiming.of(panel()), REST.q, REST.grid, "cosines")
    assert found.mixture is None
    apart = np.exp(1j * found.target.node_rad) - np.exp(np.pi * np.array([0.5j, 1j]))
    assert np.abs(apart).max() < 1e-12
    np.testing.assert_allclose(found.target.contrast, 1.0)
    np.testing.assert_allclose(found.target.late_rad_per_s, 0.0, atol=1e-9)


def test_a_target_that_stands_has_none():
    log = PresentationLog(REST.q.shape[:2])
    log.record(0, REST.q)
    frame = Frame(np.zeros((1, 1)), 10**9, round(1e9 * EXPOSURE_S), 0)
    assert pair(log, frame, PanelTiming.of(panel()), REST.q, REST.grid, "cosines").target is None


def test_blur_displaces_a_carrier_whose_contrast_changes_along_it():
    """Rows of the camera look at rows of the LCD 0.84 apart; a lens of 0.7 px, summed over pixels."""
    sharp = seen(0.1130).target
    v = np.arange(-40.0, 40.0, 0.05)
    kernel = np.exp(-0.5 * (np.arange(-4, 4.01, 0.05) / 0.7) ** 2)

    def carrier(rows: np.ndarray) -> np.ndarray:
        rad, contrast, _ = sharp.at(rows)
        return contrast * np.exp(1j * rad)

    rows = np.linspace(60.0, 340.0, 8)
    moved = []
    for row in rows:
        wave = np.exp(2j * np.pi * v / 16) * carrier(row + 0.84 * v)[:, 1]
        blurred = np.convolve(wave, kernel / kernel.sum(), mode="same")[len(v) // 2]
        moved.append(np.angle(blurred / carrier(np.array([row]))[0, 1]))
    for blur in ((0.49, 0.0), (0.0, 0.49 * 0.84**2)):  # camera px^2, LCD px^2
        by = seen(0.1130, blur=blur).target.at(rows)[0] - sharp.at(rows)[0]
        # second order in the blur is left out
        np.testing.assert_allclose(by[:, 1], moved, rtol=0.1, atol=0.05 * np.abs(moved).max())
        np.testing.assert_allclose(by[:, 0], 0.0, atol=1e-9)  # along u nothing changes
    assert np.abs(moved).max() > 1e-4
