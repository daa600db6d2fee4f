"""How a recording is doing while it is written, and the sentence that the operator reads about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto


class Condition(Enum):
    """Whether all is kept, and if not, why."""

    ALL_KEPT = auto()
    DISK_TOO_SLOW = auto()
    DISK_FULL = auto()
    DISK_WAS_FULL = auto()
    STOPPED = auto()
    ASTRAY = auto()


LOST = frozenset({Condition.DISK_FULL, Condition.DISK_WAS_FULL, Condition.STOPPED, Condition.ASTRAY})
"""Not what was asked for: a command ends with an error. (Frames lost to a slow disk are only noted.)"""


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """unkept: frames whose arrays are not in the file. reason: of a full disk, a stop, a lost file.

    full_at_s: when the disk was full, s since the recording's first step.
    """

    condition: Condition = Condition.ALL_KEPT
    unkept: int = 0
    reason: str = ""
    full_at_s: float = 0.0

    def __str__(self) -> str:
        """In words; "" while all is kept."""
        frames = f"{self.unkept} frame{'' if self.unkept == 1 else 's'} not kept"
        after = f", {frames}" if self.unkept else ""
        return {
            Condition.ALL_KEPT: "",
            Condition.DISK_TOO_SLOW: f"disk too slow: {frames}",
            Condition.DISK_WAS_FULL: f"disk was full: {frames}",
            Condition.DISK_FULL: (
                f"disk full: recording stopped at {self.full_at_s:.1f} s ({self.reason}){after}"
            ),
            Condition.STOPPED: f"recording stopped: {self.reason}{after}",
            Condition.ASTRAY: f"{self.reason}{after}",
        }[self.condition]

    @property
    def note(self) -> str:
        """For the operator, when the condition has changed."""
        return (
            f"recording: {self}"
            if self.condition is not Condition.ALL_KEPT
            else "recording: all is kept again"
        )
