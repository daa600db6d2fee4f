"""A camera read in a thread of its own, so that one that hangs keeps nobody waiting."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import cast

from zeromethod.devices.protocols import Camera, CameraTimeout, Frame

SLICE_S = 0.05
"""How often the waiting thread looks round for what else there is to do."""

GRACE_S = 0.1
"""How much later than its time-out a camera's own answer may come."""


class Capture:
    """Reads one camera from one thread, a frame at a time, once the one before has been dealt with.

    A camera without a thread of its own is read at the same moments as without this one; what it adds is the
    handing over, some 0.1 ms. A read that never ends is left to its daemon thread.
    """

    def __init__(self, camera: Camera, meanwhile: Callable[[], None]) -> None:
        """meanwhile: called every `SLICE_S` in the thread that waits; what it raises passes."""
        self._camera = camera
        self._meanwhile = meanwhile
        self._changed = threading.Condition()
        self._asked_s: float | None = None
        self._answer: Frame | None = None
        self._error: BaseException | None = None
        self._has_answer = False
        self._closed = False
        threading.Thread(target=self._serve, name="capture", daemon=True).start()

    def read(self, timeout_s: float) -> Frame:
        """Newest frame; raises what the camera raises, or CameraTimeout when it does not answer in time.

        An answer that comes too late is returned by the next call, unless it is that there was none.
        """
        end_s = time.monotonic() + timeout_s + GRACE_S
        with self._changed:
            late = self._has_answer or self._asked_s is not None
            self._ask(timeout_s)
        while (left_s := end_s - time.monotonic()) > 0:
            with self._changed:
                self._changed.wait_for(lambda: self._has_answer, min(left_s, SLICE_S))
                if self._has_answer and not (late and isinstance(self._error, CameraTimeout)):
                    return self._take()
                if self._has_answer:
                    # of the call before, which did not wait for it
                    late = self._has_answer = False
                    self._error = None
                    self._ask(max(end_s - GRACE_S - time.monotonic(), SLICE_S))
            self._meanwhile()
        raise CameraTimeout(f"no answer within {timeout_s:g} s")

    def _ask(self, timeout_s: float) -> None:
        if not self._has_answer and self._asked_s is None:
            self._asked_s = timeout_s
            self._changed.notify_all()

    def close(self) -> None:
        """End the thread, as soon as the camera answers; the camera stays open."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _take(self) -> Frame:
        answer, error = self._answer, self._error
        self._answer = self._error = None
        self._has_answer = False
        if error is not None:
            raise error
        # whatever the driver gave: the caller judges what is a frame
        return cast(Frame, answer)

    def _serve(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._asked_s is not None or self._closed)
                timeout_s = self._asked_s
                if self._closed or timeout_s is None:
                    return
            answer: Frame | None = None
            error: BaseException | None = None
            try:
                answer = self._camera.read(timeout_s)
            except BaseException as raised:  # whatever it is, it belongs to the thread that asked
                error = raised
            with self._changed:
                self._asked_s = None
                self._answer, self._error = answer, error
                self._has_answer = True
                self._changed.notify_all()
