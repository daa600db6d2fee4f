"""What drivers give, checked where it is taken over: a driver's mistake is named there, not met later."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from zeromethod.clock import Clock
from zeromethod.devices.protocols import Frame

RAISED = (Exception, SystemExit)
"""What a driver's mistake may raise: its `sys.exit` must not end the run without a word."""

_MOST = {"time_ns": 1 << 63, "exposure_ns": 1 << 63, "number": 1 << 63, "dropped": 1 << 31}
"""A frame's numbers, each with the first that a recording's column of it (i8, i4) cannot hold."""


def said_by(error: BaseException) -> str:
    """What an exception says, in one line; "" where it says nothing, or cannot."""
    try:
        return " ".join(str(error).split())
    except Exception:  # of a driver's own class
        return ""


def taken(read: Callable[[float], object], timeout_s: float) -> Frame:
    """Next frame that a `read` gives, as `own` has it. Raises what that raises, TypeError for no frame."""
    return own(read(timeout_s), read)


def own(frame: object, given_by: Callable[..., object]) -> Frame:
    """The frame in plain numbers; nobody else writes into its image, which is in order in memory.

    given_by: what gave it, in this thread, and was not called since. The image is copied (0.1 ms) unless that
    `gives_buffers`: many libraries fill one buffer again and again. Code that works on images is compiled for
    those in order that may be written to; compiling it for any other would take seconds.
    Raises TypeError for what lacks a frame's members; frames may be of any class.
    """
    missing = [field.name for field in fields(Frame) if not hasattr(frame, field.name)]
    if missing:
        name = getattr(given_by, "__name__", "read")
        raise TypeError(f"{name}() gave {type(frame).__name__}, which lacks {', '.join(missing)}")
    image, *numbers = (getattr(frame, field.name) for field in fields(Frame))
    if isinstance(image, np.ndarray):
        as_it_is = getattr(given_by, "gives_buffers", False) is True
        if not (as_it_is and image.flags.c_contiguous and image.flags.writeable):
            image = np.array(image, order="C")
    return Frame(image, *map(_plain, numbers))


def _plain(value: Any) -> Any:
    """Whole number as Python's own, which does not overflow; whatever else is given as it is."""
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating) and math.isfinite(value):
        return round(float(value))
    return value


def wrong_numbers(frame: Frame) -> str:
    """Why a frame's numbers, plain ones, cannot be any camera's, in words; "" where they can."""
    for name, most in _MOST.items():
        value = getattr(frame, name)
        if not isinstance(value, int):
            what = "whole number" if isinstance(value, float) else "number"
            return f"the frame's {name} is {' '.join(reprlib.repr(value).split())}, not a {what}"
        if not -most <= value < most:
            return f"the frame's {name} is beyond {most.bit_length()} bits"
    if frame.exposure_ns <= 0:
        return f"the frame's exposure is {frame.exposure_ns} ns"
    if frame.number < 0:
        return f"the frame's number is {frame.number}, below 0"
    if frame.dropped < 0:
        return f"the frame says that {frame.dropped} frames were dropped"
    return ""


def presented(show: Callable[[], object], clock: Clock, refresh_hz: float) -> int:
    """Time, ns, at which a display says that it presented the picture that `show` shows.

    That lies between the call and its return; a refresh is left for clocks that were mapped onto each other.
    Raises what `show` raises, TypeError and ValueError for another time or none.
    """
    asked_ns = clock.now_ns()
    given = show()
    now_ns = clock.now_ns()
    time_ns = _plain(given)
    if not isinstance(time_ns, int):
        words = " ".join(reprlib.repr(given).split())
        raise TypeError(f"show() gave {words}, not the presentation time in ns")
    for off_ns, words in (
        (time_ns - now_ns, "past the present"),
        (asked_ns - time_ns, "before it was called"),
    ):
        if off_ns > 1e9 / refresh_hz:
            raise ValueError(f"show() gave a presentation time {1e-9 * min(off_ns, 1 << 63):.3g} s {words}")
    return time_ns


def wrong_image(image: object, shape: tuple[int, int], dtype: DTypeLike) -> str:
    """Why an image is not what the camera said it gives, in words; "" where it is."""
    if isinstance(image, np.ndarray) and image.shape == shape and image.dtype == dtype:
        return ""
    found = f"{getattr(image, 'shape', '')} {getattr(image, 'dtype', type(image).__name__)}"
    return f"the frame is {found}, not {shape} {np.dtype(dtype)}"
