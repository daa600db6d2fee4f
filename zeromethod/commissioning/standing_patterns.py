"""Showing pictures and taking only frames that surely saw one of them alone.

Whether a frame did is told by time stamps: its exposure must have begun after the picture's presentation, the
display's latency (which holds what the camera's stamps are wrong by), the scan-out and the panel's rise.
"""

from __future__ import annotations

from collections.abc import Iterator

from zeromethod.arrays import Bytes
from zeromethod.devices.abilities import poll_of
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraTimeout, Frame
from zeromethod.errors import MeasurementError
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.rig.model import Rig

RISE_CONSTANTS = 12.0
"""Time constants of the rise after which less than a hundred thousandth of the old picture is left."""

TIMEOUTS_TO_FAIL = 3


class HeldPictures:
    """Pictures on the rig's display, frames from its camera. Windows want the main thread.

    hold_s: how long after its presentation a picture is held to stand; at first what the rig states, and
    `margin_s` more.
    """

    def __init__(self, rig: Rig, devices: Devices, margin_s: float) -> None:
        timing = PanelTiming.of(rig.display)
        stands_ns = max(timing.latency_ns, 0.0) + timing.scanout_ns + RISE_CONSTANTS * timing.tau_ns
        self.hold_s = 1e-9 * stands_ns + margin_s
        self._devices = devices
        self._timeout_s = rig.control.timeout_s

    def show(self, codes: Bytes) -> int:
        """Show LCD codes (rows, cols); presentation time, ns."""
        return round(self._devices.display.show(codes))

    def frames(self, codes: Bytes, count: int) -> list[Frame]:
        """Show a picture and take `count` frames that saw nothing else."""
        return self.after(self.show(codes), count)

    def after(self, presented_ns: int, count: int) -> list[Frame]:
        """`count` frames that surely saw nothing older than what was presented then."""
        stands_ns = presented_ns + round(1e9 * self.hold_s)
        self._devices.clock.sleep_until_ns(stands_ns)
        taken: list[Frame] = []
        while len(taken) < count:
            frame = self.read()
            if frame.time_ns - frame.exposure_ns // 2 >= stands_ns:
                taken.append(frame)
        return taken

    def following(self, codes: Bytes, seconds: float) -> Iterator[tuple[float, Frame]]:
        """Show a picture; every frame until `seconds` later, with its mid-exposure's time since then, s."""
        presented_ns = self.show(codes)
        while True:
            frame = self.read()
            since_s = 1e-9 * (frame.time_ns - presented_ns)
            if since_s > seconds:
                return
            if since_s > 0:
                yield since_s, frame

    def read(self) -> Frame:
        """Newest frame. Raises MeasurementError for a silent camera; CameraLost passes."""
        poll = poll_of(self._devices.display)
        for _ in range(TIMEOUTS_TO_FAIL):
            if poll is not None:
                poll()
            try:
                return self._devices.camera.read(self._timeout_s)
            except CameraTimeout:
                continue
        raise MeasurementError(f"the camera gave no frame for {TIMEOUTS_TO_FAIL * self._timeout_s:g} s")
