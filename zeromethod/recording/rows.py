"""From a turn of the loop to the items that are added to the file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.loop.drawing import Drawn
from zeromethod.loop.step import Step
from zeromethod.recording.schema import ANCHORS, EVENTS, STATES, Part, number_name
from zeromethod.surface import Peak, Surface

Item = tuple[str, Image]
"""Name of a dataset, and what is added to it; it is of that dataset's type when it is written."""

Added = tuple[int, str, Image]
"""The same with its kind: see `zeromethod.recording.message`."""

_STATE = {state: index for index, state in enumerate(STATES)}
_EVENT = {event: index for index, event in enumerate(EVENTS)}


def text(words: str, part: Part, field: str) -> bytes:
    """Words as UTF-8, cut off at a character's end to what the field holds."""
    room = part.dtype[field].itemsize
    return words.encode("utf-8", "replace")[:room].decode("utf-8", "ignore").encode("utf-8")


class Rows:
    """Makes items for the datasets of `parts`."""

    def __init__(self, parts: Mapping[str, Part]) -> None:
        self._parts = parts

    def _row(self, name: str, *values: Any) -> Item:
        part = self._parts[name]
        fields = part.dtype.names or ()
        told = (
            text(value, part, field) if isinstance(value, str) else value
            for field, value in zip(fields, values, strict=True)
        )
        return name, np.array(tuple(told), part.dtype)

    def turn(self, step: Step, phase: str) -> Item:
        """Row of a turn."""
        events = 0
        for event in step.events:
            events |= 1 << _EVENT[event]
        frame = -1 if step.frame_number is None else step.frame_number
        return self._row(
            "turns/table",
            step.number,
            step.time_ns,
            step.exposure_ns,
            frame,
            step.dropped,
            _STATE[step.state],
            step.frozen,
            step.sensed,
            step.residual_rms_px,
            step.valid_share,
            step.loop_ms,
            step.draw_ms,
            step.delay_ms,
            events,
            phase,
            step.reason,
        )

    def notes(self, step: Step) -> list[Item]:
        """Rows of what the operator was told."""
        return [self.note(step.number, step.time_ns, note) for note in step.notes]

    def note(self, turn: int, time_ns: int, words: str) -> Item:
        """Row of one of them."""
        return self._row("notes/table", turn, time_ns, words)

    def drop(self, turn: int, time_ns: int, count: int, what: str, why: str) -> Item:
        """Row of frames that are not in the file."""
        return self._row("drops/table", turn, time_ns, count, what, why)

    def presented(self, one: Drawn, after_turn: int) -> Item:
        """Row of a picture."""
        seen_ns = -1 if one.seen_ns is None else one.seen_ns
        code = -1 if one.code is None else one.code
        return self._row("presentations/table", after_turn, one.time_ns, seen_ns, code, one.draw_ms)

    def peak(self, turn: int, peak: Peak, read_ms: float) -> Item:
        """Row of a surface's point of largest |depth|."""
        place = peak.x_mm, peak.y_mm
        return self._row("peaks/table", turn, peak.depth_mm, peak.sigma_mm, peak.deeper_mm, *place, read_ms)

    def arrays(self, step: Step) -> list[Item]:
        """Arrays of a turn that are kept."""
        items: list[Item] = []
        if step.image is not None and self.fits(step.image):
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

    def fits(self, image: Any) -> bool:
        """Whether an image is one of the rig's camera."""
        part = self._parts.get("frames/image")
        if part is None or not isinstance(image, np.ndarray):
            return False
        return bool(image.shape == part.shape and image.dtype == part.dtype)

    def picture(self, one: Drawn, row: int) -> list[Item]:
        """Warp of a picture, which has that row of the table."""
        return self._group("pictures", row, {"q": one.q})

    def zero(self, step: Step, zero: Float) -> list[Item]:
        """Zero that readings start from, from this turn on."""
        return self._group("zeros", step.number, {"q": zero})

    def surface(self, turn: int, surface: Surface) -> list[Item]:
        """Arrays of a reading."""
        names = ("depth_mm", "slope", "x_mm", "y_mm", "sigma_depth_mm", "sigma_slope", "valid", "contact")
        anchor = surface.anchor
        arrays = {name: getattr(surface, name) for name in names} | {"anchor": anchor.mask}
        for name in ("x_mm", "y_mm"):
            arrays[name] = np.where(surface.on_mirror, arrays[name], np.nan)
        items = self._group("surface", turn, arrays)
        if items:
            about = (ANCHORS.index(anchor.mode), anchor.sigma_mm, anchor.far_field_mm)
            items.append(self._row("surface/table", surface.time_ns, surface.iterations, *about))
        return items

    def _group(self, group: str, number: int, arrays: Mapping[str, Image]) -> list[Item]:
        """Items of a group, none where it is not kept, with their number at the end."""
        name = number_name(group)
        if not arrays or name not in self._parts:
            return []
        items = [(f"{group}/{one}", array) for one, array in arrays.items()]
        return [*items, (name, np.array(number, np.int64))]
