"""Names of what can happen to a frame or a device, as the log and the summary show them."""

from __future__ import annotations

import enum


class Event(enum.StrEnum):
    """One thing that happened in a turn of the loop."""

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
    HELD_BY_REQUEST = "held by request"
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
