"""Contacts as pointer events, as browsers define them (W3C Pointer Events, level 2)."""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import Any

import numpy as np

from zeromethod.contact import ContactFigures
from zeromethod.interactive.homography import mapped, mm_to_px
from zeromethod.rig.model import ProjectorSpec

UNKNOWN_S = 0.25
"""Time without any reading after which nobody knows where fingers are."""
_MOVED_SIGMAS, _PRESSED_SIGMAS, _LEAST_PRESSURE = 0.5, 2.0, 0.01
"""Least of what is a move: of the place, by its sigma; of the force, by its sigma and in pressure."""
_PIECE = 0.25
"""Area over that of the reading before, below which a contact is a piece of the finger's rim: what is seen of
one that lifts while the frame is exposed, up to 3 mm aside. It is no move unless it stays."""
_NO_FORCE = 0.5
"""Pressure of a pointer that touches where no force is read. Source: W3C Pointer Events, `pressure`."""
KEPT = 64
"""Last events that values and messages have, so that whoever skips some misses none."""


class PointerType(enum.StrEnum):
    """What a pointer did, by the names of browsers."""

    DOWN = "pointerdown"
    MOVE = "pointermove"
    UP = "pointerup"
    CANCEL = "pointercancel"


@dataclass(frozen=True, slots=True, kw_only=True)
class PointerEvent:
    """One event of one finger.

    Attributes
    ----------
    number : int
        Events of the run so far, this one included.
    type : PointerType
        Down, move, up, or cancel: it is not known any more where it is, for the `reason` given.
    pointer_id : int
        That of its contact: from down to up or cancel, and never again in a run.
    time_ns : int
        Mid-exposure of the frame that says so; of a cancel, the time of the step.
    x_mm, y_mm, sigma_x_mm, sigma_y_mm : float
        Place on the mirror and its standard deviation.
    x_px, y_px, sigma_px : float
        The same in the projector's picture, column and row, with what its map leaves open.
    pressure : float
        0 to 1: force over `projector.full_force_n`; 0 of up and cancel, 0.5 where no force is read.
    force_n, sigma_force_n : float
        Force; NaN where none is read.
    width_px, height_px : float
        Extent of the contact along the picture's columns and rows, px.
    is_primary : bool
        Whether no other finger was down when it came.
    """

    number: int
    type: PointerType
    pointer_id: int
    time_ns: int
    x_mm: float
    y_mm: float
    sigma_x_mm: float
    sigma_y_mm: float
    x_px: float
    y_px: float
    sigma_px: float
    pressure: float
    force_n: float
    sigma_force_n: float
    width_px: float
    height_px: float
    is_primary: bool
    reason: str = ""

    @classmethod
    def of_row(cls, row: np.void) -> PointerEvent:
        """From a row of a recording's table of them."""
        values = {one.name: row[one.name].item() for one in fields(cls)}
        words = {"type": PointerType(row["type"].decode()), "reason": row["reason"].decode()}
        return cls(**values | words)

    @property
    def as_browsers_have_it(self) -> dict[str, Any]:
        """Values by the names of a browser's PointerEvent, and ours for what it has no name for; for JSON."""
        numbers = {
            "x": self.x_px,
            "y": self.y_px,
            "sigma_px": self.sigma_px,
            "width": self.width_px,
            "height": self.height_px,
            "pressure": self.pressure,
            "x_mm": self.x_mm,
            "y_mm": self.y_mm,
            "sigma_x_mm": self.sigma_x_mm,
            "sigma_y_mm": self.sigma_y_mm,
            "force_n": self.force_n,
            "sigma_force_n": self.sigma_force_n,
        }
        known = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
        said = {
            "number": self.number,
            "type": self.type.value,
            "pointerId": self.pointer_id,
            "pointerType": "touch",
        }
        return said | {"isPrimary": self.is_primary, "time_ns": self.time_ns, "reason": self.reason} | known


@dataclass(slots=True)
class _Down:
    """A finger that is down: what was said of it last, and its area."""

    said: PointerEvent
    area_mm2: float


class Pointers:
    """Follows contacts and says what their fingers do. Serves one thread."""

    def __init__(self, spec: ProjectorSpec) -> None:
        self._spec, self._to_px = spec, mm_to_px(spec)
        self._down: dict[int, _Down] = {}
        self._ended: set[int] = set()
        self._read_ns: int | None = None
        self._numbers = count(1)

    @property
    def down(self) -> tuple[PointerEvent, ...]:
        """What was said last of the fingers that are down."""
        return tuple(one.said for one in self._down.values())

    def follow(
        self, contacts: Sequence[ContactFigures], time_ns: int, followed: Collection[int] = ()
    ) -> tuple[PointerEvent, ...]:
        """Events of the next frame that was read. followed: ids of what is not lifted, found in it or not."""
        self._read_ns = time_ns
        here = {one.id: one for one in contacts}
        self._ended &= {*here, *followed}  # a finger that was cancelled says nothing until it is lifted
        lifted = [number for number in self._down if number not in here and number not in followed]
        events = [self._end(number, PointerType.UP, time_ns) for number in lifted]
        for number, contact in here.items():
            if number in self._ended:
                continue
            if number not in self._down:
                event = self._event(PointerType.DOWN, contact, time_ns, is_primary=not self._down)
                event = replace(event, number=next(self._numbers))
                self._down[number] = _Down(event, contact.area_mm2)
                events.append(event)
                continue
            down = self._down[number]
            piece, down.area_mm2 = contact.area_mm2 < _PIECE * down.area_mm2, contact.area_mm2
            if piece:
                continue
            event = self._event(PointerType.MOVE, contact, time_ns, is_primary=down.said.is_primary)
            if _differs(event, down.said):
                down.said = replace(event, number=next(self._numbers))
                events.append(down.said)
        return tuple(events)

    def unread(self, time_ns: int, unknown: str = "") -> tuple[PointerEvent, ...]:
        """Events of a step that was not read. unknown: why nothing is known, "" where it may be."""
        late = self._read_ns is not None and time_ns - self._read_ns > 1e9 * UNKNOWN_S
        reason = unknown or (f"no reading for {UNKNOWN_S:g} s" if late else "")
        if not reason:
            return ()
        self._ended |= self._down.keys()
        return tuple(self._end(number, PointerType.CANCEL, time_ns, reason) for number in list(self._down))

    def _end(self, number: int, kind: PointerType, time_ns: int, reason: str = "") -> PointerEvent:
        said = self._down.pop(number).said
        ended = replace(said, number=next(self._numbers), type=kind, time_ns=time_ns, reason=reason)
        force = math.nan if kind is PointerType.CANCEL else 0.0
        return replace(ended, pressure=0.0, force_n=force, sigma_force_n=force)

    def _event(
        self, kind: PointerType, contact: ContactFigures, time_ns: int, *, is_primary: bool
    ) -> PointerEvent:
        at = np.array([contact.x_mm, contact.y_mm])
        around = mapped(
            self._to_px, at + np.array([[0.0, 0.0], [0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
        )
        x_px, y_px = around[0]
        per_mm = np.stack([around[1] - around[2], around[3] - around[4]], axis=1)
        sigmas = np.array([contact.sigma_x_mm, contact.sigma_y_mm])
        open_mm2 = sigmas**2 + self._spec.sigma_mm**2
        wide, high = _extent(contact, per_mm)
        pressure = contact.force_n / self._spec.full_force_n
        return PointerEvent(
            number=0,
            type=kind,
            pointer_id=contact.id,
            time_ns=time_ns,
            x_mm=contact.x_mm,
            y_mm=contact.y_mm,
            sigma_x_mm=contact.sigma_x_mm,
            sigma_y_mm=contact.sigma_y_mm,
            x_px=float(x_px),
            y_px=float(y_px),
            sigma_px=float(np.sqrt((per_mm**2 @ open_mm2).mean())),
            pressure=min(max(pressure, 0.0), 1.0) if math.isfinite(pressure) else _NO_FORCE,
            force_n=contact.force_n,
            sigma_force_n=contact.sigma_force_n,
            width_px=wide,
            height_px=high,
            is_primary=is_primary,
        )


def _differs(event: PointerEvent, said: PointerEvent) -> bool:
    """Whether a finger moved or pressed otherwise by more than noise since it was last said where it is."""
    moved = math.hypot(event.x_mm - said.x_mm, event.y_mm - said.y_mm)
    if moved > _MOVED_SIGMAS * math.hypot(event.sigma_x_mm, event.sigma_y_mm):
        return True
    pressed = abs(event.pressure - said.pressure)
    noise = _PRESSED_SIGMAS * event.sigma_force_n if math.isfinite(event.sigma_force_n) else 0.0
    return pressed > _LEAST_PRESSURE and not abs(event.force_n - said.force_n) <= noise


def _extent(contact: ContactFigures, per_mm: np.ndarray[Any, Any]) -> tuple[float, float]:
    """Extent of a contact's ellipse along the picture's columns and rows, px."""
    angle = math.radians(contact.angle_deg)
    axes = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    halves = 0.5 * np.array([contact.major_mm, contact.minor_mm])
    wide, high = 2 * np.hypot(*(per_mm @ axes * halves).T)
    return float(wide), float(high)
