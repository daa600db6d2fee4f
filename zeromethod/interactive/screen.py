"""The picture that fingers draw: a ring round each of them, and a trail behind it that fades."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Single
from zeromethod.interactive.pointers import PointerEvent, PointerType
from zeromethod.rig.model import ProjectorSpec

FADES_S = 2.0
"""Time in which a trail's grey level falls to half."""
_TRAIL_SHARE, _RING_SHARE = 0.6, 1.3
"""Thickness of a trail at full pressure, and radius of a ring, over half the contact's width."""
_SHIFT = 4
"""Fractional bits of the coordinates that OpenCV draws with."""


class PointerScreen:
    """Draws the projector's pictures: (rows, cols) grey codes."""

    def __init__(self, spec: ProjectorSpec) -> None:
        self._spec = spec
        self._trails: Single = np.zeros((spec.rows, spec.columns), np.float32)
        self._last: dict[int, PointerEvent] = {}
        self._time_ns: int | None = None
        self._blank = True

    def draw(
        self, events: Sequence[PointerEvent], down: Sequence[PointerEvent], time_ns: int
    ) -> Bytes | None:
        """The picture after `events`, with a ring for each finger down; None where it has not changed."""
        if self._spec.picture == "black":
            return None
        passed_s = 0.0 if self._time_ns is None else 1e-9 * (time_ns - self._time_ns)
        if self._blank and not events and self._time_ns is not None:
            return None
        first = self._time_ns is None
        self._time_ns = time_ns
        self._trails *= np.float32(0.5 ** (max(passed_s, 0.0) / FADES_S))
        for event in events:
            self._trail(event)
        picture = self._trails.copy()
        for one in down:
            radius = _RING_SHARE * 0.25 * (one.width_px + one.height_px)
            cv2.circle(picture, _fixed(one), round(radius * (1 << _SHIFT)), 255.0, 2, cv2.LINE_AA, _SHIFT)
        codes = np.clip(np.rint(picture), 0, 255).astype(np.uint8)
        blank = not codes.any()
        if blank and self._blank and not first:
            return None
        self._blank = blank
        return np.asarray(255 - codes if self._spec.picture == "white" else codes, np.uint8)

    def _trail(self, event: PointerEvent) -> None:
        before = self._last.pop(event.pointer_id, event)
        if event.type is PointerType.CANCEL:
            return
        if event.type is not PointerType.UP:
            self._last[event.pointer_id] = event
        pressure = max(event.pressure, before.pressure)
        thick = max(round(_TRAIL_SHARE * pressure * 0.5 * (event.width_px + event.height_px)), 1)
        cv2.line(self._trails, _fixed(before), _fixed(event), 255.0, thick, cv2.LINE_AA, _SHIFT)


def _fixed(event: PointerEvent) -> tuple[int, int]:
    """An event's place in OpenCV's fixed-point coordinates, clipped to what it can draw."""
    x, y = np.clip([event.x_px, event.y_px], -1e4, 1e4)
    return round(x * (1 << _SHIFT)), round(y * (1 << _SHIFT))
