"""Shares of the pictures in each LCD row's light, against stepping through time."""

import numpy as np
import pytest

from zeromethod.simulation.panel import Presentation, SimulatedPanel

MS = 1_000_000


def stepped(panel_rig, presentations, from_s: float, to_s: float) -> np.ndarray:
    """(pictures, rows) mean shares by explicit Euler steps of 2 us; error about dt / tau = 1e-3."""
    display = panel_rig.display
    tau, rows, dt = display.rise_s / np.log(9), display.rows, 2e-6
    scanout = display.scanout_s
    share = np.arange(rows) / (rows - 1)
    delay = display.latency_s + (share if display.scan == "down" else share[::-1]) * scanout
    state = np.zeros((len(presentations), rows))
    state[0] = 1.0
    total = np.zeros_like(state)
    time, count = min(p.time_ns for p in presentations) * 1e-9, 0
    while time < to_s:
        goal = np.zeros_like(state)
        shown = np.zeros(rows, dtype=int)
        for k, p in enumerate(presentations):
            shown[time >= p.time_ns * 1e-9 + delay] = k
        goal[shown, np.arange(rows)] = 1.0
        state += (goal - state) * dt / tau
        if time >= from_s:
            total += state
            count += 1
        time += dt
    return total / count


@pytest.mark.parametrize("scan", ["down", "up"])
def test_shares_match_stepping_through_time(make_rig, scan):
    timing = {"rows": 16, "scanout_s": 0.012, "latency_s": 0.003, "rise_s": 0.004, "scan": scan}
    rig = make_rig(display=timing)
    shown = [Presentation(0, 7), Presentation(5 * MS, 8), Presentation(20 * MS, 9)]
    got = SimulatedPanel(rig.display, 60.0).weights(shown, 18 * MS, 26 * MS)
    expected = stepped(rig, shown, 0.018, 0.026)
    assert [handle for handle, _ in got] == [7, 8, 9]
    for (_, share), row in zip(got, expected, strict=True):
        np.testing.assert_allclose(share, row, atol=2e-3)


def test_shares_add_up_to_one_and_settled_pictures_are_left_out(make_rig):
    rig = make_rig()
    shown = [Presentation(k * 16 * MS, k) for k in range(12)]
    got = SimulatedPanel(rig.display, 60.0).weights(shown, 150 * MS, 158 * MS)
    np.testing.assert_allclose(sum(share for _, share in got), 1.0, atol=1e-6)  # float32
    assert {handle for handle, _ in got} <= {6, 7, 8, 9}
    assert all(share.dtype == np.float32 for _, share in got)


def test_first_picture_is_shown_since_ever(make_rig):
    panel = SimulatedPanel(make_rig().display, 60.0)
    ((handle, share),) = panel.weights([Presentation(50 * MS, 3)], 0, 8 * MS)
    assert handle == 3
    assert np.all(share == 1.0)


def test_rows_change_when_the_scan_reaches_them(make_rig):
    rig = make_rig(display={"rows": 101, "scanout_s": 0.010, "latency_s": 0.002, "rise_s": 0.0})
    panel = SimulatedPanel(rig.display, 60.0)
    shown = [Presentation(0, 1), Presentation(0, 2)]
    shares = dict(panel.weights(shown, 6 * MS, 8 * MS))
    # row r changes at 2 + r / 10 ms: rows 40 to 60 change inside 6..8 ms
    np.testing.assert_allclose(shares[2][[0, 40, 50, 60, 100]], [1, 1, 0.5, 0, 0], atol=1e-6)


def test_rise_takes_from_10_to_90_percent_in_rise_s(make_rig):
    rig = make_rig(display={"scanout_s": 0.0, "latency_s": 0.0, "rise_s": 0.005})
    panel = SimulatedPanel(rig.display, 60.0)
    shown = [Presentation(0, 1), Presentation(0, 2)]
    tau_ns = 0.005e9 / np.log(9)
    for level in (0.1, 0.9):
        at = round(-np.log(1 - level) * tau_ns)
        assert dict(panel.weights(shown, at, at))[2][0] == pytest.approx(level, abs=1e-6)


def test_a_picture_is_forgotten_only_when_it_gives_no_light(make_rig):
    panel = SimulatedPanel(make_rig().display, 60.0)
    shown = [Presentation(0, 1), Presentation(16 * MS, 2)]
    gone = panel.forgotten_at(16 * MS)
    assert [handle for handle, _ in panel.weights(shown, gone + 1, gone + MS)] == [2]
    assert dict(panel.weights(shown, 17 * MS, 18 * MS))[1].max() > 0.9
