"""Closed-loop replay: the recorded surface moves a simulated bench, which another controller may null.

The bench is the recorded rig's, simulated: same geometry, timing and noise; its mirror is that of
`zeromethod.session.replay.mirror`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from zeromethod.devices.opening import Devices, open_devices
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.recording.recorder import Recorder
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import Rig
from zeromethod.session.reading import timed
from zeromethod.session.replay.mirror import RecordedMirror
from zeromethod.session.replay.track import Nodes, Track, TrackPoint
from zeromethod.session.replay.window import Pace, Window
from zeromethod.simulation.clone import SIMULATED, simulated_clone
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.surface.comparison import compare
from zeromethod.warp.rest import Rest


def simulated_bench(rig: Rig) -> Rig:
    """The simulated bench of a recorded rig, pressed by nothing of its own.

    It keeps the camera's delay. Readings are zeroed by the geometry, which is exact on the bench.
    """
    clone = simulated_clone(rig)
    simulation = clone.simulation
    if rig.camera.driver != SIMULATED:
        simulation = simulation.model_copy(update={"camera_latency_s": clone.camera.latency_s})
    camera = clone.camera.model_copy(update={"rest_map": None})
    return clone.model_copy(update={"scenario": "none", "simulation": simulation, "camera": camera})


class ClosedLoopReplay:
    """One session on a simulated bench whose mirror moves as recorded; `track` is what the loop did."""

    def __init__(
        self,
        name: str,
        rig: Rig,
        mirror: RecordedMirror,
        *,
        record: Path | None = None,
        command_line: str = "",
        speed: float | None = None,
    ) -> None:
        """rig: of the bench (`simulated_bench`) and of the loop. record: write a recording of it there."""
        self.track = Track(name)
        self.rig = rig
        self.gl_renderer = ""
        self.recorder_state = ""
        """What was not kept of the new recording; "" while all is kept."""
        self._mirror = mirror
        self._record = record
        self._command_line = command_line
        self._pace = Pace(speed)

    def run(self, on_step: Callable[[float], None] | None = None) -> Track:
        """Run it; on_step gets the seconds of the bench's time so far.

        Raises InputError for settings with which no loop can run.
        """
        with open_devices(self.rig) as devices:
            camera: Any = devices.camera
            camera.scenario = self._mirror.scenario(self.track.name)
            self._run(devices, camera, on_step)
        return self.track

    def _run(self, devices: Devices, camera: Any, on_step: Callable[[float], None] | None) -> None:
        optics = Optics(self.rig)
        with Loop(self.rig, camera, devices.display, devices.clock, optics=optics) as loop:
            self.gl_renderer = loop.gl_renderer
            reader = SurfaceReader(self.rig, optics, loop.grid)
            nodes = Nodes(loop.rest, round(self._mirror.duration_s * self.rig.camera.rate_hz))
            recorder = self._recorder(loop.rest)
            try:
                for step in loop.run(seconds=self._mirror.duration_s):
                    self._pace.wait_for(step.time_ns)
                    read = None if step.measured is None else _read(reader, step)
                    if recorder is not None:
                        recorder.add_step(step)
                        if read is not None:
                            recorder.add_reading(
                                replace(step, surface=read[0], peak=read[1], read_ms=read[2])
                            )
                    if self._mirror.settled_ns <= step.time_ns <= self._mirror.end_ns:
                        self.track.points.append(self._moment(step, read, camera, optics, loop, nodes))
                    if on_step is not None:
                        on_step(1e-9 * step.time_ns)
                if recorder is not None and loop.ended is not None:
                    recorder.add_step(loop.ended)
            finally:
                if recorder is not None:
                    recorder.close()
                    self.recorder_state = str(recorder.status)

    def _recorder(self, rest: Rest) -> Recorder | None:
        if self._record is None:
            return None
        command, renderer = self._command_line, self.gl_renderer
        return Recorder(self._record, self.rig, rest, command_line=command, gl_renderer=renderer)

    def _moment(
        self,
        step: Step,
        read: tuple[Surface, Peak, float] | None,
        camera: Any,
        optics: Optics,
        loop: Loop,
        nodes: Nodes,
    ) -> TrackPoint:
        time_s = 1e-9 * (step.time_ns - self._mirror.settled_ns)
        shown_q = None if step.shown is None else step.shown.q
        followed = nodes.pick(step.measured, shown_q, step.zero)
        point = TrackPoint(time_s, step.state, step.residual_rms_px, *followed)
        if read is None:
            return point
        truth = compare(read[0], camera.truth(step.time_ns), optics, loop.grid)
        return replace(
            point,
            depth_peak_mm=read[1].depth_mm,
            depth_error_um=truth.depth_rms_error_um,
            peak_error_percent=truth.depth_peak_error_percent,
            true_peak_mm=truth.depth_peak_mm,
        )


def _read(reader: SurfaceReader, step: Step) -> tuple[Surface, Peak, float]:
    measured = step.measured
    assert measured is not None

    def read() -> tuple[Surface, Peak]:
        surface = reader.read(measured)
        return surface, peak(surface)

    return timed(read)


def recorded_track(recording: Recording, window: Window) -> Track:
    """What the recorded session did, by its own figures. Nodes are left out where no warps were kept."""
    track, nodes = Track("recorded"), Nodes(recording.rest, len(recording.steps))
    peaks = dict(zip(recording.peaks["step"].tolist(), recording.peaks["depth_mm"].tolist(), strict=True))
    for row in recording.steps:
        time_ns, step = int(row["time_ns"]), int(row["number"])
        if time_ns not in window or row["frame_number"] < 0:
            continue
        followed = nodes.pick(recording.measured(step), recording.shown(step), recording.zero(step))
        time_s, residual_px = 1e-9 * (time_ns - window.from_ns), float(row["residual_rms_px"])
        depth_mm = peaks.get(step, float("nan"))
        track.points.append(
            TrackPoint(time_s, recording.state_of(row), residual_px, *followed, depth_peak_mm=depth_mm)
        )
    return track
