"""A camera read in a thread of its own, so that one that hangs keeps nobody waiting."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import nullcontext

from zeromethod.devices.protocols import Camera, CameraTimeout, Frame
from zeromethod.worker import Worker, completed

SLICE_S = 0.05
"""How often the waiting thread attends to what else there is to do."""

GRACE_S = 0.1
"""How much later than its time-out a camera's own answer may come."""


class Capture:
    """Reads one camera from one thread, a frame at a time, once the previous one has been dealt with.

    A camera without a thread of its own is read at the same moments as without this one; the thread adds
    some 0.1 ms to each frame. A read that never ends is left to its thread.
    """

    def __init__(self, camera: Camera, meanwhile: Callable[[], None]) -> None:
        """meanwhile: called every `SLICE_S` in the thread that waits; what it raises passes."""
        self._meanwhile = meanwhile

        def answer(timeout_s: float) -> Future[Frame]:
            return completed(lambda: camera.read(timeout_s))

        self._worker: Worker[float, Future[Frame]] = Worker("capture", lambda: nullcontext(answer))
        self._asked = False

    def read(self, timeout_s: float) -> Frame:
        """Newest frame; raises what the camera raises, or CameraTimeout when it does not answer in time.

        An answer that comes too late is returned by the next call, unless it is a CameraTimeout.
        """
        end_s = time.monotonic() + timeout_s + GRACE_S
        late = self._asked
        if not self._asked:
            self._ask(timeout_s)
        while (left_s := end_s - time.monotonic()) > 0:
            for answer in self._worker.take(min(left_s, SLICE_S)):
                self._asked = False
                if not (late and isinstance(answer.exception(), CameraTimeout)):
                    return answer.result()
                # the answer to the previous call, which did not wait for it
                late = False
                self._ask(max(end_s - GRACE_S - time.monotonic(), SLICE_S))
            self._meanwhile()
        raise CameraTimeout(f"no answer within {timeout_s:g} s")

    def close(self) -> None:
        """End the thread, as soon as the camera answers; the camera stays open."""
        self._worker.close(0.0)

    def _ask(self, timeout_s: float) -> None:
        self._asked = True
        self._worker.post(timeout_s)
