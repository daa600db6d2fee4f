"""From a frame to an observation: which of the pictures given to the panel were lit while it was exposed."""

from __future__ import annotations

import enum

from zeromethod.arrays import Float
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.delay import DelayWatch
from zeromethod.exposure.pairing import Observation, PanelTiming, pair
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.target_phase import Sight
from zeromethod.warp.grid import NodeGrid


class Unpaired(enum.Enum):
    """Why it cannot be said what was shown in a frame."""

    CONTRADICTED = enum.auto()  # its coded strips cannot come from the pictures of the log
    NOT_LIT = enum.auto()  # it was exposed before any picture was fully lit


class Exposures:
    """Keeps the presentation log and the panel's timing, and pairs frames with what they saw.

    delay: reads from coded strips when pictures were lit; None without strips, and `timing` holds. sight: how
    rows of a moving target are seen; None for single points, sharply.
    """

    def __init__(
        self,
        grid: NodeGrid,
        timing: PanelTiming,
        target_kind: str,
        delay: DelayWatch | None = None,
        sight: Sight | None = None,
    ) -> None:
        self.timing = timing
        self.delay = delay
        self._grid = grid
        self._kind, self._sight = target_kind, sight
        self.log = PresentationLog(grid.shape)
        """Every picture given to the panel is recorded here."""

    def observe(self, frame: Frame, known_q: Float) -> Observation | Unpaired:
        """Pair a frame with the mix of warps that was lit in it.

        known_q: (rows, cols, 2) LCD px, where the nodes looked last, to some tens of LCD rows.
        """
        timing: PanelTiming | None = self.timing
        if self.delay is not None:
            timing = self.delay.timing_of(frame.image, frame, self.log)
            self.timing = self.delay.timing
        if timing is None:
            return Unpaired.CONTRADICTED
        observation = pair(self.log, frame, timing, known_q, self._grid, self._kind, self._sight)
        return Unpaired.NOT_LIT if observation is None else observation
