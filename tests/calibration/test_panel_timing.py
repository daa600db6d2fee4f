"""Latency, scan-out and rise from frames of a changing panel: closed-form light, planted timing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from zeromethod.calibration.panel_timing import PanelSteps, fit_steps
from zeromethod.errors import MeasurementError
from zeromethod.exposure.pairing import PanelTiming

EXPOSURE_S, FRAME_S, REFRESH_S = 0.008, 1 / 60, 1 / 59.94
PLACE = np.linspace(0.1, 0.9, 6)
ROUGH = PanelTiming(0.0, 1e9 * REFRESH_S, 1e6, 1080, upwards=False)


def light(t: np.ndarray, tau: float) -> np.ndarray:
    return np.where(t > 0, 1 - np.exp(-np.maximum(t, 0) / tau), 0.0)


def seen(
    latency_s: float,
    scanout_s: float,
    rise_s: float,
    fall_s: float,
    *,
    changes: int = 24,
    noise: float = 0.002,
    seed: int = 0,
    in_step: bool = False,
) -> PanelSteps:
    """Frames of changes up and down, each exposure the mean of the light over 400 instants."""
    rng = np.random.default_rng(seed)
    since, rising, grey = [], [], []
    for change in range(changes):
        phase = 0.3 if in_step else rng.uniform()
        up = change % 2 == 0
        tau = (rise_s if up else fall_s) / math.log(9)
        for frame in range(5):
            middle = (frame + phase) * FRAME_S
            t = middle + EXPOSURE_S * (np.linspace(-0.5, 0.5, 401)[:-1, None] + 1 / 800)
            share = light(t - latency_s - scanout_s * PLACE, tau).mean(axis=0)
            since.append(middle)
            rising.append(up)
            level = share if up else 1 - share
            grey.append(10 + (150 + 20 * PLACE) * (level + noise * rng.standard_normal(len(PLACE))))
    count = len(since)
    return PanelSteps(np.array(since), np.full(count, EXPOSURE_S), np.array(rising), np.array(grey), PLACE)


@pytest.mark.parametrize(
    ("latency_s", "scanout_s", "rise_s", "fall_s"),
    [
        (0.0, REFRESH_S, 0.004, 0.004),
        (0.021, REFRESH_S, 0.012, 0.005),
        (0.005, 0.008, 0.002, 0.016),
        (-0.006, REFRESH_S, 0.004, 0.006),
    ],
)
def test_planted_timing_comes_back(latency_s, scanout_s, rise_s, fall_s):
    found = fit_steps(seen(latency_s, scanout_s, rise_s, fall_s), ROUGH)
    # noise of 0.2 % of the swing on some 40 frames: tens of microseconds
    assert found.latency_s == pytest.approx(latency_s, abs=1e-4)
    assert found.scanout_s == pytest.approx(scanout_s, abs=2e-4)
    assert found.rise_s == pytest.approx(rise_s, abs=2e-4)
    assert found.fall_s == pytest.approx(fall_s, abs=2e-4)
    assert not found.upwards


def test_a_panel_that_scans_up_is_recognised():
    # the last row first: the light of the first row comes a scan-out later
    steps = seen(0.01 + REFRESH_S, -REFRESH_S, 0.004, 0.004)
    found = fit_steps(steps, ROUGH)
    assert found.upwards
    assert found.latency_s == pytest.approx(0.01, abs=2e-4)
    assert found.scanout_s == pytest.approx(REFRESH_S, abs=2e-4)


def test_sigma_holds():
    truth = (0.012, REFRESH_S, 0.006, 0.009)
    z = []
    for seed in range(30):
        one = fit_steps(seen(*truth, noise=0.02, seed=seed), ROUGH)
        values = (one.latency_s, one.scanout_s, one.rise_s, one.fall_s)
        sigmas = (one.latency_sigma_s, one.scanout_sigma_s, one.rise_sigma_s, one.fall_sigma_s)
        z.append((np.array(values) - truth) / sigmas)
    rms = np.sqrt(np.mean(np.square(z)))
    # bands that count as one frame make sigma up to sqrt(6) too large where their noise is their own
    assert 0.3 < rms < 1.2


def test_frames_that_always_fall_on_the_same_part_of_a_change_are_refused():
    with pytest.raises(MeasurementError, match="fall on a change"):
        fit_steps(seen(0.001, 0.0, 1e-4, 1e-4, in_step=True, changes=6), ROUGH)


def test_a_dark_camera_is_refused():
    steps = seen(0.0, REFRESH_S, 0.004, 0.004)
    dark = PanelSteps(steps.since_s, steps.exposure_s, steps.rising, np.full_like(steps.grey, 4.0), PLACE)
    with pytest.raises(MeasurementError, match="does not see the panel change"):
        fit_steps(dark, ROUGH)


def test_only_what_is_known_goes_into_a_rig_file():
    found = fit_steps(seen(0.0, REFRESH_S, 0.012, 0.004), ROUGH)
    values = found.rig_values()
    assert values["display.scan"] == "down"
    assert values["display.scanout_s"] == pytest.approx(REFRESH_S, abs=2e-4)
    assert 0.004 < values["display.rise_s"] < 0.012
    vague = replace(found, scanout_sigma_s=0.002, rise_sigma_s=math.inf, fall_sigma_s=math.inf)
    assert vague.rig_values() == {}
