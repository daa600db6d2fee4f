"""What can happen to a frame or a device: the event that code branches on, and its words for a person."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Event(enum.StrEnum):
    """One thing that happened in a step of the loop, under the name that logs and summaries show."""

    FRAMES_DROPPED = "frames dropped"
    FRAME_REPEATED = "repeated frame"
    FRAME_LATE = "late frame"
    FRAME_TORN = "torn frame"
    FRAME_DISORDERED = "frame out of order"
    FRAME_WRONG = "wrong frame"
    CLOCK_JUMPED = "clock jumped"
    LIGHT_OFF = "light off"
    SATURATED = "saturated"
    FLICKER = "light flickers"
    NOT_LIT = "picture not lit yet"
    STRIPS_CONTRADICT = "strips contradict the log"
    PICTURES_MIXED = "pictures mixed"
    FROZEN = "frozen by request"
    ZERO_TAKEN = "zero taken"
    ZERO_REFUSED = "zero refused"
    CAMERA_TIMEOUT = "camera timeout"
    CAMERA_STALLED = "camera stalled"
    CAMERA_LOST = "camera lost"
    CAMERA_REOPENED = "camera reopened"
    DISPLAY_ASLEEP = "display asleep"
    DISPLAY_WARNING = "display warning"
    DISPLAY_LOST = "display lost"
    DEVICE_BROKEN = "device driver failed"


REFUSAL_WORDS = {
    Event.STRIPS_CONTRADICT: "the coded strips contradict what was shown",
    Event.NOT_LIT: "the picture was not lit yet",
    Event.LIGHT_OFF: "the light is off",
    Event.FROZEN: "frozen by request",
    Event.PICTURES_MIXED: "two different pictures in one exposure",
    Event.DISPLAY_ASLEEP: "the LCD is asleep",
}
"""Why a frame brought no new command, for events that need no further detail."""


@dataclass(frozen=True, slots=True)
class Notice:
    """An event with its words for the operator: one line, without a full stop."""

    event: Event
    words: str

    @classmethod
    def refusal(cls, event: Event) -> Notice:
        """Notice in the words of `REFUSAL_WORDS`."""
        return cls(event, REFUSAL_WORDS[event])
