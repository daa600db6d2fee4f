"""From a step of the loop, or a reading, to the items that are added to the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.contact import Contact, evenly
from zeromethod.interactive.pointers import PointerEvent
from zeromethod.loop.call import Call
from zeromethod.loop.drawing import Drawn
from zeromethod.loop.step import Step
from zeromethod.recording.columns import OUTLINE_POINTS
from zeromethod.recording.contact_images import tiles
from zeromethod.recording.message import Write
from zeromethod.recording.schema import ANCHORS, EVENTS, STATES, Dataset, number_name
from zeromethod.rubbing import ContactStatus
from zeromethod.surface import Surface

Item = tuple[str, Image]
"""Name of a dataset, and what is added to it, in that dataset's type once it is written."""

Added = tuple[Write, str, Image]
"""The same, and when it is written."""

FINE_PIXELS = ("depth_mm", "slope", "sigma_depth_mm", "sigma_slope")
"""Maps of a fine surface that are kept on every pixel."""

TOO_SLOW = "the disk is too slow"
FULL = "the disk is full"

_STATE = {state: index for index, state in enumerate(STATES)}
_EVENT = {event: index for index, event in enumerate(EVENTS)}


@dataclass(frozen=True, slots=True)
class WaitingStep:
    """A step that waits for the disk. bytes: of its arrays, 0 without. late: they had no room to wait.

    lost: steps before it of which not even the rows were kept.
    """

    step: Step
    bytes: int
    late: bool
    lost: int


@dataclass(frozen=True, slots=True)
class WaitingReading:
    """A step whose reading waits for the disk. bytes: of its arrays, 0 where they are not kept."""

    step: Step
    bytes: int


@dataclass(frozen=True, slots=True)
class WaitingFine:
    """A step whose fine surface waits for the disk. bytes: of its arrays, 0 where they are not kept."""

    step: Step
    bytes: int


Waiting = WaitingStep | WaitingReading | WaitingFine
"""What may wait for the disk."""


def without_arrays(step: Step) -> Step:
    """A step of which the tables alone are kept."""
    presented = tuple(replace(one, q=step.commanded.q) for one in step.presented)
    return replace(step, image=None, residual=None, measured=None, shown=None, presented=presented)


def text(words: str, part: Dataset, field: str) -> bytes:
    """Words as UTF-8, cut off at a character's end to what the field holds."""
    room = part.dtype[field].itemsize
    return words.encode("utf-8", "replace")[:room].decode("utf-8", "ignore").encode("utf-8")


class Rows:
    """Makes the items of steps and readings, in the order in which they come."""

    def __init__(self, parts: Mapping[str, Dataset]) -> None:
        """parts: the file's datasets, by name."""
        self._parts = parts
        self._pictures = 0
        self._zero: Float | None = None
        self._last = 0, 0
        self._watched_ns = -1

    def of_step(self, waiting: WaitingStep, status_note: str | None = None) -> list[Added]:
        """Items of a step. status_note: what to note of the recording itself."""
        step, kept = waiting.step, waiting.bytes > 0
        number, time_ns = self._last = step.number, step.time_ns
        rows = [self._step(step)]
        rows += [self.note(words) for words in step.notes]
        rows += [self._call(step, call) for call in step.calls]
        if step.approach is not None and step.approach.time_ns > self._watched_ns:
            self._watched_ns = step.approach.time_ns
            own = {"step": number, "watching": str(step.approach.watching)}
            rows.append(self._row("approaches/table", *self._fields("approaches/table", own, step.approach)))
        rows += [self._pointer(number, event) for event in step.pointers]
        if status_note is not None:
            rows.append(self.note(status_note))
        rows += self._drops(waiting)
        arrays = self._arrays(step) if kept else []
        for index, one in enumerate(step.presented):
            rows.append(self._presented(one, number - (index < step.presented_before)))
            if kept:
                arrays += self._group("pictures", self._pictures, {"q": one.q})
            self._pictures += 1
        if step.zero is not None and step.zero is not self._zero:
            rows += self._group("zeros", number, {"q": step.zero})
        self._zero = step.zero
        instead = []
        if arrays and step.frame_number is not None:
            instead.append(self._row("drops/table", number, time_ns, 1, "recorder", FULL))
        return [
            *((Write.WITH_ROOM, *item) for item in arrays),
            *((Write.WITHOUT_ROOM, *item) for item in instead),
            *((Write.ALWAYS, *item) for item in rows),
        ]

    def of_reading(self, waiting: WaitingReading) -> list[Added]:
        """Items of a reading."""
        step, surface, peak = waiting.step, waiting.step.surface, waiting.step.peak
        arrays = (
            self._surface("surface", step.number, surface) if surface is not None and waiting.bytes else []
        )
        assert peak is not None
        own: dict[str, Any] = {"step": step.number, "state": _STATE[step.state]}
        own |= {"depth_sigma_mm": peak.sigma_mm, "possibly_deeper_mm": peak.deeper_mm}
        own |= {"x_sigma_mm": peak.sigma_x_mm, "y_sigma_mm": peak.sigma_y_mm}
        row = self._row("peaks/table", *self._fields("peaks/table", own, peak, step))
        rows = [row, *(self._contact(step, contact) for contact in step.contacts)]
        if step.contact_status is not None:
            rows.append(self._status(step, step.contact_status))
        if waiting.bytes:
            arrays += [item for contact in step.contacts for item in self._image(step.number, contact)]
        return [*((Write.WITH_ROOM, *item) for item in arrays), *((Write.ALWAYS, *item) for item in rows)]

    def of_fine(self, waiting: WaitingFine) -> list[Added]:
        """Items of a fine surface."""
        step, surface = waiting.step, waiting.step.fine
        assert surface is not None
        depth_mm, x_mm, y_mm = surface.peak
        share = float(np.mean(surface.valid))
        peak = depth_mm, surface.sigma_near(x_mm, y_mm), x_mm, y_mm, share
        row = self._row("fine_peaks/table", step.number, surface.time_ns, surface.frames, *peak)
        arrays: list[Item] = []
        if waiting.bytes:
            arrays = self._surface("fine_nodes", step.number, surface.coarse)
            every = slice(None, None, surface.spacing_px)
            own = {name: getattr(surface, name) for name in FINE_PIXELS}
            own |= {name: getattr(surface, name)[every, every] for name in ("x_mm", "y_mm", "share")}
            arrays += self._group("fine", step.number, own)
            how = (surface.frames, *surface.first_px, surface.footprint_divided)
            arrays.append(self._row("fine/table", *how))
        return [*((Write.WITH_ROOM, *item) for item in arrays), (Write.ALWAYS, *row)]

    def _contact(self, step: Step, contact: Contact) -> Item:
        own = {"step": step.number, "outline_mm": evenly(contact.outline_mm, OUTLINE_POINTS)}
        return self._row("contacts/table", *self._fields("contacts/table", own, contact, step))

    def _status(self, step: Step, status: ContactStatus) -> Item:
        own = {"step": step.number, "motion": str(status.motion)}
        return self._row("contact_status/table", *self._fields("contact_status/table", own, status, step))

    def _image(self, step: int, contact: Contact) -> Iterator[Item]:
        name = "contact_images/table"
        for tile in tiles(contact):
            yield self._row(name, *self._fields(name, {"step": step, **tile}))

    def _call(self, step: Step, call: Call) -> Item:
        return self._row("calls/table", *self._fields("calls/table", {"step": step.number}, call, step))

    def note(self, words: str) -> Item:
        """Row of a message to the operator, at the last step."""
        return self._row("notes/table", *self._last, words)

    def _row(self, name: str, *values: Any) -> Item:
        part = self._parts[name]
        fields = part.dtype.names or ()
        row = (
            text(value, part, field) if isinstance(value, str) else value
            for field, value in zip(fields, values, strict=True)
        )
        return name, np.array(tuple(row), part.dtype)

    def _fields(self, name: str, own: Mapping[str, Any], *sources: object) -> list[Any]:
        """Values of a table's fields: `own`, else the attribute of that name of the first that has it."""
        return [
            own[field]
            if field in own
            else next(getattr(one, field) for one in sources if hasattr(one, field))
            for field in self._parts[name].dtype.names or ()
        ]

    def _pointer(self, number: int, event: PointerEvent) -> Item:
        words = text(event.reason, self._parts["pointers/table"], "reason")
        own = {"step": number, "type": str(event.type), "reason": words}
        return self._row("pointers/table", *self._fields("pointers/table", own, event))

    def _step(self, step: Step) -> Item:
        own = {
            "frame_number": -1 if step.frame_number is None else step.frame_number,
            "state": _STATE[step.state],
            "events": sum(1 << _EVENT[event] for event in set(step.events)),
        }
        return self._row("steps/table", *self._fields("steps/table", own, step))

    def _drops(self, waiting: WaitingStep) -> list[Item]:
        """Rows of the frames that are not in the file."""
        step = waiting.step
        found: list[tuple[int, str, str]] = []
        if step.dropped:
            found.append((step.dropped, "camera", f"lost before frame {step.frame_number}"))
        if waiting.bytes and step.image is not None and not self._fits(step.image):
            found.append((1, "camera", step.reason))
        if waiting.lost:
            found.append((waiting.lost, "recorder", f"{TOO_SLOW}: not even noted"))
        if waiting.late and step.frame_number is not None:
            found.append((1, "recorder", TOO_SLOW))
        return [self._row("drops/table", step.number, step.time_ns, *one) for one in found]

    def _presented(self, one: Drawn, after_step: int) -> Item:
        frame_ns = -1 if one.source_ns is None else one.source_ns
        code = -1 if one.code is None else one.code
        coded = -1 if one.coded is None else one.coded
        values = after_step, one.time_ns, frame_ns, code, one.draw_ms, coded, one.shift
        return self._row("presentation_log/table", *values)

    def _arrays(self, step: Step) -> list[Item]:
        items: list[Item] = []
        if step.image is not None and self._fits(step.image):
            items += self._group("frames", step.number, {"image": step.image})
        for group, whole, names in (
            ("residual", step.residual, ("d", "sigma", "flags", "mean")),
            ("warps/measured", step.measured, ("q", "sigma", "flags")),
        ):
            if whole is not None:
                items += self._group(group, step.number, {name: getattr(whole, name) for name in names})
        items += self._group("warps/commanded", step.number, {"q": step.commanded.q})
        if step.shown is not None:
            items += self._group("warps/shown", step.number, {"q": step.shown.q})
        return items

    def _fits(self, image: Any) -> bool:
        """Whether an image is one of the rig's camera; True where frames are not kept."""
        part = self._parts.get("frames/image")
        if part is None:
            return True
        return isinstance(image, np.ndarray) and image.shape == part.shape and image.dtype == part.dtype

    def _surface(self, group: str, step: int, surface: Surface) -> list[Item]:
        names = ("depth_mm", "slope", "x_mm", "y_mm", "sigma_depth_mm", "sigma_slope", "valid", "contact")
        anchor = surface.anchor
        arrays = {name: getattr(surface, name) for name in names} | {"anchor": anchor.mask}
        for name in ("x_mm", "y_mm"):
            arrays[name] = np.where(surface.on_mirror, arrays[name], np.nan)
        items = self._group(group, step, arrays)
        if items:
            about = (ANCHORS.index(anchor.mode), anchor.sigma_mm, anchor.far_field_mm, anchor.learned_ns)
            items.append(self._row(f"{group}/table", surface.time_ns, surface.iterations, *about))
        return items

    def _group(self, group: str, number: int, arrays: Mapping[str, Image]) -> list[Item]:
        """Items of a group, with their number at the end; none where it is not kept."""
        name = number_name(group)
        if name not in self._parts:
            return []
        items = [(f"{group}/{one}", array) for one, array in arrays.items()]
        return [*items, (name, np.array(number, np.int64))]
