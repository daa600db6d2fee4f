"""When swaps begin and which refreshes count as missed, on a clock that only the test moves."""

import numpy as np
import pytest

from zeromethod.clock import SimulatedClock
from zeromethod.drivers.refresh import Refreshes

PERIOD_NS = 10_000_000
SWAP_NS = 500_000


class Screen:
    """Refreshes at 100 Hz whose trial swaps took SWAP_NS each, one after the other or one per period."""

    def __init__(self, blocks: bool = False) -> None:
        self.clock = SimulatedClock()
        self.refreshes = Refreshes(self.clock, 1e9 / PERIOD_NS)
        trials = []
        for _ in range(8):
            before_ns = self.clock.now_ns()
            self.pass_ns(PERIOD_NS if blocks else SWAP_NS)
            trials.append((before_ns, self.clock.now_ns()))
        self.refreshes.judge(trials)
        self.opened_ns = self.clock.now_ns()

    def pass_ns(self, time_ns: int) -> None:
        self.clock.sleep_until_ns(self.clock.now_ns() + time_ns)

    def picture(self, drawing_ns: int = 1_000_000, swap_ns: int = SWAP_NS) -> float:
        """Draw and swap; time of presentation, periods since opening."""
        self.refreshes.begin()
        self.pass_ns(drawing_ns)
        self.refreshes.wait()
        self.pass_ns(swap_ns)
        return (self.refreshes.end() - self.opened_ns) / PERIOD_NS


def test_paced_pictures_end_at_every_refresh():
    screen = Screen()
    np.testing.assert_allclose([screen.picture() for _ in range(20)], range(1, 21), atol=1e-6)
    assert screen.refreshes.dropped == 0


def test_a_swap_too_late_for_a_refresh_waits_for_the_next():
    screen = Screen()
    assert screen.picture(drawing_ns=PERIOD_NS - SWAP_NS + 1000) == pytest.approx(2, abs=1e-6)


def test_a_swap_quicker_than_the_trials_never_puts_two_pictures_into_one_refresh():
    """Each ends early by what it saved, 4 % of a period, and the next one is still for the next refresh."""
    screen = Screen()
    times = [screen.picture(drawing_ns=0, swap_ns=100_000) for _ in range(10)]
    np.testing.assert_allclose(times, np.arange(1, 11) - 0.04, atol=1e-6)


def test_one_trial_on_a_busy_machine_does_not_decide_that_swaps_block():
    refreshes = Refreshes(SimulatedClock(), 1e9 / PERIOD_NS)
    refreshes.judge([(n * PERIOD_NS, n * PERIOD_NS + SWAP_NS) for n in range(8)])
    assert not refreshes.paced
    refreshes.judge([(n * SWAP_NS, (n + 1) * SWAP_NS) for n in range(8)])
    assert refreshes.paced


def test_a_driver_that_takes_in_four_swaps_after_a_stall_still_blocks():
    """Twelve swaps, four of them at once: seven periods for eleven intervals."""
    refreshes = Refreshes(SimulatedClock(), 1e9 / PERIOD_NS)
    ends = [0, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7]
    refreshes.judge([(end * PERIOD_NS, end * PERIOD_NS) for end in ends])
    assert not refreshes.paced


def test_pictures_too_fast_for_a_screen_that_blocks_turn_pacing_on():
    """Where the trials misled: after twelve swaps in less than six periods."""
    screen = Screen(blocks=True)
    times = [screen.picture(drawing_ns=0) for _ in range(20)]
    assert times[11] == pytest.approx(12 * SWAP_NS / PERIOD_NS)
    np.testing.assert_allclose(np.diff(times[12:]), 1, atol=1e-6)


def test_swaps_that_block_are_not_paced():
    screen = Screen(blocks=True)
    assert not screen.refreshes.paced
    assert screen.picture(drawing_ns=0, swap_ns=PERIOD_NS) == pytest.approx(1)


@pytest.mark.parametrize(("drawing", "missed"), [(0.5, 0), (1.5, 1), (2.5, 2), (7.2, 7)])
def test_refreshes_that_pass_while_a_picture_is_drawn_are_missed(drawing, missed):
    screen = Screen()
    screen.picture()
    screen.picture(drawing_ns=round(drawing * PERIOD_NS))
    assert screen.refreshes.dropped == missed


@pytest.mark.parametrize(("periods", "missed"), [(1.19, 0), (1.21, 1), (1.9, 1), (3.1, 2)])
def test_an_interval_above_one_and_a_fifth_periods_is_missed(periods, missed):
    """Swaps that block, so that intervals need not be whole."""
    screen = Screen(blocks=True)
    screen.picture(drawing_ns=0, swap_ns=PERIOD_NS)
    screen.picture(drawing_ns=0, swap_ns=round(periods * PERIOD_NS))
    assert screen.refreshes.dropped == missed


def test_refreshes_at_which_nothing_was_asked_for_are_not_missed():
    screen = Screen()
    screen.picture()
    screen.pass_ns(20 * PERIOD_NS)
    screen.picture()
    assert screen.refreshes.dropped == 0
