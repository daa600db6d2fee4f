from collections.abc import Callable

from zeromethod.clock import SimulatedClock
from zeromethod.devices.protocols import CameraLost
from zeromethod.loop.live.reopening import Reopener


class Port:
    """Fails `fails` times, then gives a camera."""

    def __init__(self, fails: int) -> None:
        self.fails = fails
        self.calls = 0

    def __call__(self) -> object:
        self.calls += 1
        if self.calls <= self.fails:
            raise CameraLost("still gone")
        return self


def reopener(port: Callable[[], object] | None) -> tuple[Reopener, SimulatedClock]:
    clock = SimulatedClock()
    return Reopener(port, clock, live=False), clock  # type: ignore[arg-type]


def test_without_a_way_to_reopen_it_gives_up_at_once() -> None:
    what, _ = reopener(None)
    assert what.exhausted
    assert what.attempt() is None


def test_three_failures_in_a_minute_are_the_end() -> None:
    port = Port(fails=99)
    what, clock = reopener(port)
    for _ in range(5):
        assert what.attempt() is None
    assert port.calls == 3
    assert what.exhausted
    assert clock.now_ns() == 10_500_000_000  # 0.5, 2 and 8 s apart


def test_attempts_are_allowed_again_after_a_minute() -> None:
    port = Port(fails=3)
    what, clock = reopener(port)
    for _ in range(3):
        what.attempt()
    clock.sleep_until_ns(clock.now_ns() + 61 * 10**9)
    assert not what.exhausted
    assert what.attempt() is port


def test_successes_count_too_so_that_a_loose_plug_does_not_go_on_for_ever() -> None:
    port = Port(fails=0)
    what, _ = reopener(port)
    assert [what.attempt() is port for _ in range(4)] == [True, True, True, False]
