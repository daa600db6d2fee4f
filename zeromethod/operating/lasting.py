"""The state to show: a single frame that may not be used comes now and then, and would only flash."""

from __future__ import annotations

from zeromethod.loop.state import State

LASTING_S = {State.HOLDING: 0.3}
"""How long a state must have lasted before it is shown, of the run's clock. Others are shown at once."""


class LastingState:
    """The newest state that has lasted long enough. What is recorded is not its business."""

    def __init__(self) -> None:
        self._newest, self._since_s = State.STARTING, 0.0
        self.shown = State.STARTING

    def see(self, state: State, time_s: float) -> State:
        """Take in the state of a step; the one to show."""
        if state is not self._newest:
            self._newest, self._since_s = state, time_s
        if time_s - self._since_s >= LASTING_S.get(state, 0.0):
            self.shown = state
        return self.shown
