"""Lag and rejection of sessions made up in closed form."""

import numpy as np
import pytest

from zeromethod.loop.state import State
from zeromethod.session.replay.comparison import bands, figures_of, lag_ms, rejection
from zeromethod.session.replay.track import Track, TrackPoint

RATE_HZ = 60.0
NODES = 40
SIGMA_PX = 0.02


def made_up(motion, delay_s: float, frames: int = 200, noise: float = SIGMA_PX, seed: int = 0) -> Track:
    """Nodes that all move by `motion(time_s)` LCD px, shown `delay_s` late, measured with noise."""
    rng = np.random.default_rng(seed)
    track = Track("made up")
    size = rng.uniform(0.5, 1.5, (NODES, 2))
    for k in range(frames):
        time_s = k / RATE_HZ
        true, shown = motion(time_s) * size, motion(time_s - delay_s) * size
        measured = true + noise * rng.standard_normal((NODES, 2))
        point = TrackPoint(time_s, State.LOCKED, 0.01, measured, shown - measured, max(noise, 1e-4))
        track.points.append(point)
    return track


def swing(time_s: float) -> float:
    return 3.0 * np.sin(2 * np.pi * 1.5 * time_s)


@pytest.mark.parametrize("delay_s", [0.0, 0.033, -0.010])
def test_lag_is_the_delay_of_what_was_shown(delay_s):
    # to a millisecond: velocity over two frames is (sin x) / x = 0.996 of the truth at 1.5 Hz
    assert lag_ms(made_up(swing, delay_s)) == pytest.approx(1e3 * delay_s, abs=1.0)


def test_at_rest_there_is_no_lag_and_no_rejection():
    track = made_up(lambda time_s: 0.0, 0.033)
    assert lag_ms(track) is None
    assert not np.isfinite(rejection(track)[1]).any()
    assert all(value is None for value in figures_of(track)["left_by_hz"].values())


def test_noise_alone_does_not_pass_for_what_is_left():
    # shown is where the mirror is: nothing is left, though shown - measured is all noise, half as large as
    # the motion
    track = made_up(lambda time_s: 0.05 * np.sin(2 * np.pi * 3.0 * time_s), 0.0, frames=800)
    frequency_hz, left = rejection(track)
    assert left[np.argmin(np.abs(frequency_hz - 3.0))] < 0.15


@pytest.mark.parametrize("at_hz", [1.0, 3.0, 7.0])
def test_a_delay_leaves_of_each_frequency_what_it_must(at_hz):
    delay_s = 0.03
    track = made_up(lambda time_s: 3.0 * np.sin(2 * np.pi * at_hz * time_s), delay_s, frames=400)
    frequency_hz, left = rejection(track)
    expected = 2 * abs(np.sin(np.pi * at_hz * delay_s))
    # the spectrum's window is two lines wide, over which the motion is at one frequency
    assert left[np.argmin(np.abs(frequency_hz - at_hz))] == pytest.approx(expected, rel=0.03)


def test_gaps_in_the_measurement_are_bridged():
    track = made_up(swing, 0.03, frames=400)
    whole = rejection(track)[1]
    for point in track.points[10::20]:
        point.moved[:] = point.behind[:] = np.nan
    gaps = rejection(track)[1]
    both = np.isfinite(whole) & np.isfinite(gaps)
    both[4:] = False  # a bridge is a kink, which has high frequencies
    assert np.count_nonzero(both) >= 2
    assert gaps[both] == pytest.approx(whole[both], rel=0.05)
    assert lag_ms(track) == pytest.approx(30.0, abs=1.0)


def test_a_few_frames_have_no_spectrum():
    assert rejection(made_up(swing, 0.03, frames=10))[0].size == 0
    assert figures_of(Track("empty"))["frames"] == 0


def test_bands_are_octaves_with_none_where_nothing_moves():
    found = bands(np.array([1.2, 1.8, 3.0, 5.0]), np.array([0.3, 0.4, np.nan, 2.0]))
    assert found["1-2"] == pytest.approx(np.sqrt((0.09 + 0.16) / 2))
    assert found["2-4"] is None
    assert found["4-8"] == pytest.approx(2.0)
    assert found["16-32"] is None


def test_figures_separate_nulled_frames_and_the_deep_ones():
    nothing = np.full((NODES, 2), np.nan)
    track = Track(
        "truth known",
        [
            TrackPoint(0.0, State.NULLING, 0.5, nothing, nothing, np.nan, 0.1, 3.0, -9.0, 0.11),
            TrackPoint(0.1, State.LOCKED, 0.01, nothing, nothing, np.nan, 0.1, 0.4, 0.2, 0.1),
            TrackPoint(0.2, State.LOCKED, 0.03, nothing, nothing, np.nan, -0.1, 0.3, -0.3, -0.1),
            TrackPoint(0.3, State.LOCKED, 0.02, nothing, nothing, np.nan, 0.01, 0.2, 50.0, 0.01),
        ],
    )
    figures = figures_of(track)
    assert figures["nulled_share"] == 0.75
    assert figures["residual_nulled_px"] == 0.02
    assert figures["peak_error_percent"] == -0.3  # neither of the frame that was not nulled, nor of no press
    assert figures["depth_nulled_error_um"] == pytest.approx(np.sqrt((0.16 + 0.09 + 0.04) / 3))
    assert figures["lag_ms"] is None
