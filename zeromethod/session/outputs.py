"""Where a session's steps go: a recording, a publisher; both are loaded only where they are wanted."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypeAlias

from zeromethod.clock import Clock
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig

if TYPE_CHECKING:
    from zeromethod.recording.recorder import Recorder


class StepPublisher(Protocol):
    """Anything that takes the steps of a session, as `zeromethod.publishing.Publisher` does."""

    def publish(self, step: Step) -> None:
        """Take one step of the loop, with its surface and peak where it was read."""


Record: TypeAlias = "Callable[[Loop], Recorder] | str | Path | None"


def recorder_of(record: Record, rig: Rig, loop: Loop, fine: bool = False) -> Recorder | None:
    """Recorder that was asked for, of everything where only a file is given; None for none.

    fine: of fine surfaces, too.
    """
    if record is None or callable(record):
        return record and record(loop)
    from zeromethod.recording.recorder import Recorder  # noqa: PLC0415 - loads slowly

    return Recorder(
        record,
        rig,
        loop.rest,
        command_line=shlex.join(sys.argv),
        live=loop.live,
        gl_renderer=loop.gl_renderer,
        fine=fine,
    )


@contextmanager
def publishing(publisher: StepPublisher | str | None, clock: Clock) -> Iterator[StepPublisher | None]:
    """Publisher that was asked for, at an address where only that is given."""
    if not isinstance(publisher, str):
        yield publisher
        return
    from zeromethod.publishing import Publisher as Socket  # noqa: PLC0415 - as above

    with Socket(publisher, clock) as socket:
        yield socket
