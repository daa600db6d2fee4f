"""Closed-loop replay: the recorded surface moves a simulated bench, which another controller may null.

The bench is the recorded rig's, simulated: same geometry, timing and noise; its mirror is that of
`zeromethod.session.replay.mirror`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from zeromethod.devices.opening import open_devices
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.recording.recorder import Recorder
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import SIMULATED, Rig
from zeromethod.session.dirt import DirtCorrection
from zeromethod.session.reading import timed
from zeromethod.session.replay.mirror import RecordedMirror
from zeromethod.session.replay.track import FollowedNodes, Track, TrackPoint
from zeromethod.session.replay.window import Pace, Window
from zeromethod.simulation.clone import simulated_clone
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.surface.comparison import compare
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest import Rest


def simulated_bench(rig: Rig) -> Rig:
    """The simulated bench of a recorded rig, pressed by nothing of its own.

    It keeps the camera's delay. Readings are zeroed by the geometry, which is exact on the bench.
    """
    clone = simulated_clone(rig)
    simulation, control = clone.simulation, clone.control
    if rig.camera.driver != SIMULATED:
        # strips cover the nodes that they covered there
        control = control.model_copy(update={"strips": "edges" if rig.coded else "none"})
        simulation = simulation.model_copy(update={"camera_latency_s": clone.camera.latency_s})
    camera = clone.camera.model_copy(update={"rest_map": None})
    changed = {"simulation": simulation, "control": control, "camera": camera}
    return clone.model_copy(update={"scenario": "none", **changed})


@dataclass
class ClosedLoopReplay:
    """One session on a simulated bench whose mirror moves as recorded; `track` is what the loop did.

    rig: of the bench (`simulated_bench`) and of the loop. record: write a recording of it there.
    recorder_state: what was not kept of that recording; "" while all is kept.
    """

    name: str
    rig: Rig
    mirror: RecordedMirror
    record: Path | None = None
    command_line: str = ""
    speed: float | None = None
    gl_renderer: str = field(default="", init=False)
    recorder_state: str = field(default="", init=False)

    def __post_init__(self) -> None:
        """Begin an empty track."""
        self.track = Track(self.name)

    def run(self, on_step: Callable[[float], None] | None = None) -> Track:
        """Run it; on_step gets the seconds of the bench's time so far.

        Raises InputError for settings with which no loop can run.
        """
        optics, pace = Optics(self.rig), Pace(self.speed)
        with ExitStack() as opened:
            devices = opened.enter_context(open_devices(self.rig))
            camera: Any = devices.camera
            camera.scenario = self.mirror.scenario(self.name)
            loop = opened.enter_context(Loop(self.rig, camera, devices.display, devices.clock, optics=optics))
            self.gl_renderer = loop.gl_renderer
            dirt = DirtCorrection(loop.q_rest, under_cloth=self.rig.under_cloth)
            reader = SurfaceReader(self.rig, optics, loop.grid)
            nodes = FollowedNodes(loop.rest, round(self.mirror.duration_s * self.rig.camera.rate_hz))
            recorder = self._recorder(loop.rest, opened)
            for step in loop.run(seconds=self.mirror.duration_s):
                pace.wait_for(step.time_ns)
                if step.measured is not None:
                    step = _read(reader, dirt, step)  # noqa: PLW2901 - the same step, with its reading
                if recorder is not None:
                    recorder.add_step(step)
                    if step.surface is not None:
                        recorder.add_reading(step)
                if self.mirror.settled_ns <= step.time_ns <= self.mirror.end_ns:
                    self.track.points.append(self._point(step, camera, optics, nodes, loop.grid))
                if on_step is not None:
                    on_step(1e-9 * step.time_ns)
            if recorder is not None and loop.ended is not None:
                recorder.add_step(loop.ended)
        return self.track

    def _recorder(self, rest: Rest, opened: ExitStack) -> Recorder | None:
        """What records it; its state is asked for once it is closed."""
        if self.record is None:
            return None
        command, renderer = self.command_line, self.gl_renderer
        recorder = Recorder(self.record, self.rig, rest, command_line=command, gl_renderer=renderer)

        def close() -> None:
            recorder.close()
            self.recorder_state = str(recorder.status)

        opened.callback(close)
        return recorder

    def _point(
        self, step: Step, camera: Any, optics: Optics, nodes: FollowedNodes, grid: NodeGrid
    ) -> TrackPoint:
        time_s = 1e-9 * (step.time_ns - self.mirror.settled_ns)
        followed = nodes.pick(step.measured, None if step.shown is None else step.shown.q, step.zero)
        point = TrackPoint(time_s, step.state, step.residual_rms_px, *followed)
        if step.surface is None or step.peak is None:
            return point
        truth = compare(step.surface, camera.truth(step.time_ns), optics, grid)
        return replace(
            point,
            depth_peak_mm=step.peak.depth_mm,
            depth_error_um=truth.depth_rms_error_um,
            peak_error_percent=truth.depth_peak_error_percent,
            true_peak_mm=truth.depth_peak_mm,
        )


def _read(reader: SurfaceReader, dirt: DirtCorrection, step: Step) -> Step:
    """The step with its reading."""
    assert step.measured is not None
    cleaned = dirt.corrected(step.measured, step.state, step.zero)

    def read() -> tuple[Surface, Peak]:
        surface = reader.follow(cleaned)
        return surface, peak(surface)

    surface, deepest, read_ms = timed(read)
    return replace(step, surface=surface, peak=deepest, read_ms=read_ms)


def recorded_track(recording: Recording, window: Window) -> Track:
    """What the recorded session did, by its own figures. Nodes are left out where no warps were kept."""
    track, nodes = Track("recorded"), FollowedNodes(recording.rest, len(recording.steps))
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
