import math

import numpy as np
import pytest
from node_bench import PANEL, panel, rest_warp
from scipy.integrate import quad

from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import Observation, PanelTiming, entry_weights, lit_share, pair
from zeromethod.exposure.presentation_log import PresentationLog

MS = 1_000_000
REST = rest_warp(128)
TIMING = PanelTiming.of(panel(rise_s=0.004))


def frame(mid_ms: float, exposure_ms: float = 8.0) -> Frame:
    return Frame(np.zeros((1, 1)), round(mid_ms * MS), round(exposure_ms * MS), 0)


def paired(log: PresentationLog, mid_ms: float, timing: PanelTiming = TIMING) -> Observation:
    observed = pair(log, frame(mid_ms), timing, REST.q, REST.grid, "cosines")
    assert observed is not None
    return observed


def logged(*entries: tuple[float, float]) -> PresentationLog:
    """Pictures presented at (ms), all columns moved by (LCD px)."""
    log = PresentationLog(REST.q.shape[:2])
    for at_ms, moved in entries:
        log.record(round(at_ms * MS), REST.q + np.array([moved, 0.0]))
    return log


@pytest.mark.parametrize("change_ms", [-20.0, -3.0, 1.0, 6.0, 8.0, 9.0])
def test_light_of_a_change_is_the_integral_of_its_rise(change_ms):
    tau = 0.004 / math.log(9)

    def light(t: float) -> float:
        after = t - change_ms * 1e-3
        return 1 - math.exp(-after / tau) if after > 0 else 0.0

    points = [change_ms * 1e-3] if 0 < change_ms < 8 else None
    expected = quad(light, 0, 8e-3, points=points)[0] / 8e-3
    got = lit_share(0.0, 8e6, np.array([change_ms * 1e6]), tau * 1e9)[0]
    assert got == pytest.approx(expected, abs=1e-9)  # quad's own error


def test_rise_is_from_10_to_90_percent():
    # an exposure of 2 ns is an instant: 10 % and 90 % of the light are rise_s apart
    tau = TIMING.tau_ns
    at_10, at_90 = -tau * math.log(0.9), -tau * math.log(0.1)
    assert at_90 - at_10 == pytest.approx(4e6)
    for after, light in [(at_10, 0.1), (at_90, 0.9)]:
        assert lit_share(-1.0, 1.0, np.array([-after]), tau)[0] == pytest.approx(light, abs=1e-6)


def test_weights_add_up_to_one_in_every_row():
    times = np.array([0, 17, 33, 50], dtype=np.int64) * MS
    weights, dark = entry_weights(times, True, frame(52), TIMING)
    np.testing.assert_allclose(weights.sum(axis=0) + dark, 1, atol=1e-12)
    assert weights.min() >= 0


def test_a_picture_alone_is_returned_as_it_was_logged():
    observed = paired(logged((0, 0.0), (16, 1.0)), 80)
    assert observed.mixture is None
    assert observed.entries.tolist() == [16 * MS]
    np.testing.assert_array_equal(observed.shown.q, REST.q + np.array([1.0, 0.0]))


def test_a_picture_that_starts_after_the_exposure_has_no_part():
    observed = paired(logged((0, 0.0), (90, 5.0)), 80)
    np.testing.assert_array_equal(observed.shown.q, REST.q)


def test_nothing_is_shown_before_the_first_picture_is_lit():
    log = logged((0, 0.0))
    assert pair(PresentationLog((3, 3)), frame(80), TIMING, REST.q, REST.grid, "cosines") is None
    assert pair(log, frame(-10), TIMING, REST.q, REST.grid, "cosines") is None
    # the last row starts at 16.7 ms and is 98 % lit 4 tau = 7.3 ms later
    assert pair(log, frame(22), TIMING, REST.q, REST.grid, "cosines") is None
    assert pair(log, frame(40), TIMING, REST.q, REST.grid, "cosines") is not None


def test_rows_that_change_first_show_more_of_the_new_picture():
    log = logged((0, 0.0), (60, 1.0))
    observed = paired(log, 70)
    moved = observed.shown.q[..., 0] - REST.q[..., 0]
    assert np.all(np.diff(moved[:, 5]) <= 0)  # LCD rows grow with node rows; scan is downwards
    assert moved[0, 5] > moved[-1, 5] + 0.2
    up = PanelTiming.of(panel().model_copy(update={"scan": "up"}))
    observed_up = paired(log, 70, up)
    # scanning up mirrors the rows about the panel's middle, from which the nodes' middle is 0.42 LCD rows
    # away: 2 x 0.42 / 399 of the scan-out of 16.7 ms, in which at most 1 / 8 ms changes
    np.testing.assert_allclose(observed_up.shown.q[::-1, 5, 0] - REST.q[::-1, 5, 0], moved[:, 5], atol=5e-3)


def test_the_mix_weighs_pictures_by_the_light_of_their_row():
    observed = paired(logged((0, 0.0), (60, 1.0)), 70)
    row = REST.q[4, 5, 1]
    change_ns = 60e6 + row / (PANEL[1] - 1) * 1e9 / 60
    new = lit_share(66e6, 74e6, np.array([change_ns]), TIMING.tau_ns)[0]
    # linear between 257 rows: (65 us)^2 / 8 x the largest second derivative, 1 / (tau x exposure)
    assert observed.shown.q[4, 5, 0] - REST.q[4, 5, 0] == pytest.approx(new, abs=1e-4)


def test_the_age_of_what_is_shown_is_weighted_by_its_light():
    log = PresentationLog(REST.q.shape[:2])
    log.record(0, REST.q)
    log.record(60 * MS, REST.q, source_ns=30 * MS)
    log.record(77 * MS, REST.q, source_ns=50 * MS)
    early = paired(log, 60)
    assert early.age_ns is None  # the first picture was made from no frame
    observed = paired(log, 130)
    assert observed.age_ns is not None
    np.testing.assert_allclose(observed.age_ns, 80 * MS)
    mixed = paired(log, 100)
    np.testing.assert_allclose(mixed.age_ns, mixed.weights.T @ [70 * MS, 50 * MS])
    assert mixed.age_ns[0] == pytest.approx(50 * MS, rel=1e-3)


def test_a_log_that_was_overwritten_takes_its_oldest_entry_for_all_before():
    log = PresentationLog(REST.q.shape[:2], capacity=2)
    for at_ms in (0, 16, 33):
        log.record(at_ms * MS, REST.q)
    observed = paired(log, 34)
    np.testing.assert_allclose(observed.shown.q, REST.q, atol=1e-9)
