"""Prism and camera in a process of their own: monitor in, bent camera frames and their truth out."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from zeromethod.arrays import Image
from zeromethod.clock import HostClock
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import BenchRenderer, Piece
from zeromethod.simulation.scenario import Scenario
from zeromethod.simulation.sensor import Sensor
from zeromethod.simulation.virtual_bench.exposure import Exposer, Exposure, Grabber
from zeromethod.simulation.virtual_bench.stream import POLL_S, FrameServer
from zeromethod.simulation.virtual_bench.truth import Moment, TruthFile


class Performance:
    """A scenario played in the host's time, `loops` times, `wait_s` after `start`; else at rest."""

    def __init__(self, scenario: Scenario, loops: float = 1, wait_s: float = 0.0) -> None:
        self.wait_s = wait_s
        self._scenario = scenario
        self._length_ns = round(1e9 * scenario.duration_s)
        self._loops = loops
        self._start_ns: int | None = None

    def start(self, time_ns: int) -> None:
        """Begin `wait_s` after `time_ns`."""
        self._start_ns = time_ns + round(1e9 * self.wait_s)

    @property
    def begun(self) -> bool:
        """Whether it has been started."""
        return self._start_ns is not None

    def over(self, time_ns: int) -> bool:
        """Whether all loops have been played."""
        return self._start_ns is not None and time_ns >= self._start_ns + self._loops * self._length_ns

    def at(self, time_ns: int) -> Moment:
        """What it shows at `time_ns`."""
        if self._start_ns is None or time_ns < self._start_ns:
            return Moment(None, None, Mirror())
        since_ns = time_ns - self._start_ns
        if self.over(time_ns):
            return Moment(1e-9 * since_ns, None, Mirror())
        into_ns = since_ns % self._length_ns
        return Moment(1e-9 * since_ns, self._scenario.phase_at(into_ns), self._scenario.mirror_at(into_ns))


class Bender:
    """Camera images of exposures: optics, with the mirror of mid-exposure, then the sensor's noise."""

    def __init__(self, rig: Rig) -> None:
        """Lay out the rays and compile, for this thread alone.

        Raises InputError where the rig's rest surface cannot be used, or without OpenGL where it is needed.
        """
        numpy = rig.simulation.renderer == "numpy"
        self._renderer: BenchRenderer = NumpyRenderer(rig) if numpy else GpuRenderer(rig)
        self._sensor = Sensor(rig)
        self._rows = np.ones(rig.display.rows, np.float32)
        dark = np.zeros((rig.display.rows, rig.display.columns), np.uint8)
        self.image(Exposure(0, 0, 0, ((dark, 0.5), (dark, 0.5))), Mirror())

    def image(self, exposure: Exposure, mirror: Mirror) -> Image:
        """Camera image (rows, cols), uint8 or uint16."""
        handles = [(self._renderer.upload(codes), share) for codes, share in exposure.pictures]
        try:
            shares = [(handle, np.float32(share) * self._rows) for handle, share in handles]
            light = self._renderer.expose([Piece(1.0, mirror, shares)])
        finally:
            for handle, _ in handles:
                self._renderer.release(handle)
        return self._sensor.image(light, exposure.number)

    def close(self) -> None:
        """Free what was drawn with."""
        self._renderer.close()


class VirtualBench:
    """Serves a monitor, bent by the rig's simulated optics, as a camera, and writes the truth.

    Frames are exposed at the camera's rate with or without a client, are bent only while a client is there,
    and are sent `simulation.camera_latency_s` after their exposure, or as soon as they are ready; where
    bending takes longer than a frame, only the newest exposure is bent. The performance starts when the first
    client has connected. Exposures are global and instantaneous in the mirror, and know the monitor at
    `exposure.GRABS` instants; the monitor's own rise is left out.
    """

    def __init__(
        self,
        rig: Rig,
        performance: Performance,
        bender: Bender,
        server: FrameServer,
        opened: Callable[[], Grabber],
        truth: TruthFile | None = None,
    ) -> None:
        self._camera = rig.camera
        self._bender = bender
        self._server = server
        self._opened = opened
        self._truth = truth
        self._performance = performance
        self._clock = HostClock()
        self._latency_ns = round(1e9 * rig.simulation.camera_latency_s)
        self.frames = 0
        self.late = 0

    def run(self, stop: threading.Event, say: Callable[[str], None]) -> None:
        """Serve until `stop` is set, or the scenario is over and the client has gone.

        say: called with what happens, in words. Raises MeasurementError when the monitor cannot be grabbed
        any more.
        """
        exposer = Exposer(self._camera, self._opened)
        try:
            was_connected = False
            while not stop.is_set():
                connected = self._server.connected
                if connected != was_connected:
                    self._greet(connected, say)
                    was_connected = connected
                if not connected and self._performance.over(self._clock.now_ns()):
                    say("the scenario is over and nobody is watching")
                    return
                exposure = exposer.take(POLL_S)
                if connected and exposure is not None:
                    self._serve(exposure)
        finally:
            exposer.close()

    def _greet(self, connected: bool, say: Callable[[str], None]) -> None:
        if not connected:
            say(f"the client has gone after {self.frames} frames; waiting for the next one")
        elif self._performance.begun:
            say("a new client has connected")
        else:
            self._performance.start(self._clock.now_ns())
            after_s = self._performance.wait_s
            say("a client has connected: the scenario starts" + (f" in {after_s:g} s" if after_s else ""))

    def _serve(self, exposure: Exposure) -> None:
        moment = self._performance.at(exposure.time_ns)
        image = self._bender.image(exposure, moment.mirror)
        due_ns = exposure.end_ns + self._latency_ns
        self.late += self._clock.now_ns() > due_ns
        self._clock.sleep_until_ns(due_ns)
        if self._truth is not None:
            self._truth.frame(exposure.number, exposure.time_ns, moment)
        self._server.put(image)
        self.frames += 1
