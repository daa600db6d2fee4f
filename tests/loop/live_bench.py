"""A loop over a screen and an eye of somebody's own, at rest: where faults are planted."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hanging import PATIENCE_S
from live_devices import Eye, Window, small_rig

from zeromethod import Devices, Loop, State, Step, open_devices

GOOD = {State.LOCKED, State.RESTING}
TIMEOUT_S = small_rig().control.timeout_s

both_times = pytest.mark.parametrize("in_real_time", [False, True], ids=["simulated", "real"])


@dataclass
class Bench:
    """A loop over a screen and an eye, at rest since a few frames."""

    loop: Loop
    devices: Devices
    hung: threading.Event
    """Set at the end: whatever hangs in a test waits for it."""
    first: list[Step] = field(default_factory=list)
    """The steps that brought it to rest."""

    @property
    def eye(self) -> Eye:
        return self.devices.camera  # type: ignore[return-value]

    @property
    def screen(self) -> Window:
        return self.devices.display  # type: ignore[return-value]

    def step(self, count: int) -> list[Step]:
        return [self.loop.step() for _ in range(count)]

    def until(self, condition: Callable[[Step], bool], most: int = 400) -> list[Step]:
        """Steps up to the first that meets the condition."""
        steps: list[Step] = []
        while not self.loop.over:
            steps.append(self.loop.step())
            if condition(steps[-1]):
                return steps
            assert len(steps) < most, [(s.state, s.reason) for s in steps[-5:]]
        pytest.fail(f"the loop is over: {self.loop.status.reason}")

    def settle(self) -> list[Step]:
        """Until nulled: a shift of the whole picture counts as a bench that moved."""
        return self.until(lambda step: step.state in GOOD | {State.MOVED})

    def to_end(self) -> list[Step]:
        steps: list[Step] = []
        while not self.loop.over:
            steps.append(self.loop.step())
            assert len(steps) < 400
        return steps

    def hang(self, *_: object) -> None:
        self.hung.wait(PATIENCE_S)

    @contextmanager
    def impatient(self, timeout_s: float = 0.2) -> Iterator[None]:
        """With a shorter time-out of the camera, for a while."""
        self.loop._source._timeout_s = timeout_s
        yield
        self.loop._source._timeout_s = TIMEOUT_S


@contextmanager
def bench(
    real: bool,
    display: str = "",
    reopen: Callable[[Devices], Callable[[], Any] | None] = lambda devices: devices.reopen_camera,
    reopen_s: float = 60.0,
) -> Iterator[Bench]:
    kind = ("RealEye", display or "Window") if real else ("Eye", display or "Screen")
    rig = small_rig(*(f"live_devices:{name}" for name in kind)).replace({"camera.reopen_s": reopen_s})
    hung = threading.Event()
    with (
        open_devices(rig) as devices,
        Loop(rig, devices.camera, devices.display, devices.clock, reopen_camera=reopen(devices)) as loop,
    ):
        bench = Bench(loop, devices, hung)
        try:
            bench.first = bench.settle()
            yield bench
        finally:
            hung.set()


def frozen(steps: list[Step], before: Step) -> bool:
    """Whether the command stayed as it was, bit for bit."""
    return all(np.array_equal(step.commanded.q, before.commanded.q) for step in steps)


def notes(steps: list[Step]) -> str:
    return "\n".join(note for step in steps for note in step.notes)
