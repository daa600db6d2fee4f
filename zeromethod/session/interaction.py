"""An interactive surface in a session: readings to pointer events, and these to the projector's picture."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

from zeromethod.arrays import Bytes
from zeromethod.contact import ContactFinder
from zeromethod.devices.opening import Devices
from zeromethod.devices.projectors import Projector, open_projectors
from zeromethod.interactive.pointers import PointerEvent, Pointers, PointerType
from zeromethod.interactive.screen import PointerScreen
from zeromethod.loop.state import State
from zeromethod.loop.step import Step
from zeromethod.rig.model import ProjectorSpec, Rig

UNKNOWN = frozenset({State.MOVED, State.PAUSED, State.FAULT, State.STOPPED, State.STARTING})
"""States in which nobody knows where fingers are."""
UNSEEN = frozenset({State.COVERED, State.LOST})
"""States in which none is seen, as in a frame without light: they may be there still."""

_PLACE = ("x_mm", "y_mm", "sigma_x_mm", "sigma_y_mm", "x_px", "y_px")


def pointer_rows(events: Iterable[PointerEvent], start_ns: int) -> list[dict[str, Any]]:
    """One row per pointer, in the order of their first events: when and where it came, and how it ended.

    Times in s since start_ns, that of the first step; up_s and ended ("pointerup", "pointercancel") are None
    of a pointer that is still down. moves: events in between. pressure: the greatest.
    """
    rows: dict[int, dict[str, Any]] = {}
    for event in events:
        at_s = 1e-9 * (event.time_ns - start_ns)
        first = {name: getattr(event, name) for name in _PLACE}
        opened = {"id": event.pointer_id, "down_s": at_s} | first | {"moves": 0, "pressure": 0.0}
        row = rows.setdefault(event.pointer_id, opened | {"up_s": None, "ended": None, "reason": ""})
        row["moves"] += event.type is PointerType.MOVE
        row["pressure"] = max(row["pressure"], event.pressure)
        row |= {f"to_{name}": getattr(event, name) for name in _PLACE}
        if event.type in (PointerType.UP, PointerType.CANCEL):
            row |= {"up_s": at_s, "ended": event.type.value, "reason": event.reason}
    return list(rows.values())


class Interaction:
    """What fingers do, and what is projected; nothing for a rig without a projector."""

    def __init__(
        self,
        spec: ProjectorSpec | None = None,
        projectors: Sequence[Projector] = (),
        finder: ContactFinder | None = None,
    ) -> None:
        self._projectors, self._named = projectors, ""
        if spec is not None and finder is not None:
            self._pointers, self._screen, self._finder = Pointers(spec), PointerScreen(spec), finder
        self._said: deque[tuple[tuple[PointerEvent, ...], tuple[PointerEvent, ...], int]] = deque()
        self.picture: Bytes | None = None

    def follow(self, step: Step) -> Step:
        """The step, read or not, with what fingers did in it; in the thread that reads."""
        if not self._projectors:
            return step
        if step.state in UNKNOWN:
            events = self._pointers.unread(step.time_ns, f"{step.state}: {step.reason}")
        elif step.surface is None or step.state in UNSEEN:
            events = self._pointers.unread(step.time_ns)
        else:
            events = self._pointers.follow(step.touching, step.time_ns, self._finder.followed)
        self._said.append((events, self._pointers.down, step.time_ns))
        return replace(step, pointers=events)

    def drive(self, step: Step) -> Step:
        """The step with all events since the one before, after which the picture is; in the loop's thread."""
        if not self._projectors:
            return step
        events: list[PointerEvent] = []
        while self._said:
            new, down, time_ns = self._said.popleft()
            events += new
            if (picture := self._screen.draw(new, down, time_ns)) is not None:
                self.picture = picture
                for projector in self._projectors:
                    projector.show(picture)
        return replace(step, pointers=tuple(events), notes=step.notes + self._notes())

    def _notes(self) -> tuple[str, ...]:
        """What the operator should know of the projectors, when it begins."""
        for projector in self._projectors:
            projector.poll()
        trouble = "; ".join(one.trouble for one in self._projectors if one.trouble)
        before, self._named = self._named, trouble
        return (trouble,) if trouble != before else ()


@contextmanager
def interaction(rig: Rig, devices: Devices, finder: ContactFinder) -> Iterator[Interaction]:
    """The interaction that a rig asks for. Raises InputError where a projector cannot be opened.

    finder: of the contacts of the steps that it will follow.
    """
    if rig.projector is None:
        yield Interaction()
        return
    with ExitStack() as stack:
        yield Interaction(rig.projector, open_projectors(rig.projector, devices.display, stack), finder)
