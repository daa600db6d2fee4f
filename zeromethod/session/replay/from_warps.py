"""Replay from the measured warps of a recording: slope and depth, with other settings if wanted."""

from __future__ import annotations

from collections.abc import Callable

from zeromethod.errors import InputError
from zeromethod.optics import Optics
from zeromethod.recording.recording import Recording
from zeromethod.rig.model import Rig
from zeromethod.session.dirt import DirtCorrection
from zeromethod.session.reading import first_warp
from zeromethod.session.replay.differences import DepthDifferences
from zeromethod.session.replay.window import Pace, Window
from zeromethod.session.zero_doubt import ZeroDoubt
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

_CAMERA = (
    "projection", "focal_px", "pixel_mm", "centre_px", "distortion", "position_mm", "look_at_mm", "roll_deg",
)  # fmt: skip
_DISPLAY = ("columns", "rows", "pitch_mm", "centre_mm", "turn_deg", "mirrored", "tilt_deg")
"""Keys that determine the rays."""


class Reader:
    """Reads warps as the session did, in the same order.

    A reading starts from the one before, and its weights depend on all earlier warps: only the same warps
    in the same order, from the first on, give the same readings. In real time the session begins with a
    warm-up warp.
    """

    def __init__(self, recording: Recording, rig: Rig, grid: NodeGrid) -> None:
        """rig: with which it is read; grid: the nodes, with their rays."""
        self._recording = recording
        self._reader = SurfaceReader(rig, Optics(rig), grid)
        self._doubt = ZeroDoubt(rig, recording.rest)
        self._dirt = DirtCorrection(recording.rest.q, under_cloth=rig.under_cloth)
        if recording.live:
            self._reader.follow(first_warp(recording.rest))

    def read(self, step: int, warp: Warp) -> tuple[Surface, Peak]:
        """Surface and its deepest point, of the warp of a step."""
        state = self._recording.state_of(self._recording.row(step))
        zero = self._recording.zero(step)
        surface = self._reader.follow(self._dirt.corrected(self._doubt.stated(warp, zero), state, zero))
        return surface, peak(surface)


def grid_for(recording: Recording, rig: Rig) -> NodeGrid:
    """Nodes of the recording, on the rays of `rig`; InputError where its camera or target is another."""
    recorded = recording.rig
    for key in ("columns", "rows", "bits"):
        if getattr(rig.camera, key) != getattr(recorded.camera, key):
            raise InputError(_other(f"camera.{key}", getattr(rig.camera, key), getattr(recorded.camera, key)))
    if rig.target != recorded.target:
        raise InputError(_other("target", "another", "the one that was shown"))
    if same_geometry(rig, recorded):
        return recording.grid
    return NodeGrid.of_rig(rig)


def same_geometry(rig: Rig, recorded: Rig) -> bool:
    """Whether all rays are those of the recording, so that its measured warp at rest applies."""

    def of(one: Rig) -> tuple[object, ...]:
        camera = tuple(getattr(one.camera, key) for key in _CAMERA)
        display = tuple(getattr(one.display, key) for key in _DISPLAY)
        return one.prism, one.pattern_layers, one.camera_layers, camera, display

    return of(rig) == of(recorded)


def _other(key: str, value: object, recorded: object) -> str:
    return f"{key}: {value}: the recording's is {recorded}, and what was recorded cannot be changed"


def replay_from_warps(
    recording: Recording,
    rig: Rig,
    window: Window,
    *,
    speed: float | None = None,
    on_step: Callable[[float], None] | None = None,
) -> DepthDifferences:
    """Read every warp that the session read. rig: the recording's, or with other settings.

    Warps before the window are read as well but not compared, because the reader's weights depend on them.
    on_step gets the seconds since the recording's start. Damaged warps are left out. Raises InputError for a
    recording without warps or readings, and a rig whose camera or target is another one.
    """
    if "warps" not in recording.kept:
        raise InputError(f"{recording.path}: recorded without warps: nothing to read depth from")
    reader = Reader(recording, rig, grid_for(recording, rig))
    differences, pace = DepthDifferences(recording, window.start_ns), Pace(speed)
    differences.readings_damaged = len(recording.tables.damaged_steps("peaks"))
    for step in recording.peaks["step"].tolist():
        warp = recording.measured(step)
        if warp is None:
            _leave_out(recording, step, window, differences)
            continue
        if warp.time_ns > window.to_ns:
            break
        if warp.time_ns in window:
            pace.wait_for(warp.time_ns)
        surface, deepest = reader.read(step, warp)
        if warp.time_ns in window:
            differences.add(step, surface, deepest)
        if on_step is not None:
            on_step(1e-9 * (warp.time_ns - window.start_ns))
    if not differences.steps:
        damaged = differences.readings_damaged
        why = f"all {damaged} warps are damaged" if damaged else "no surface was read"
        raise InputError(f"{recording.path}: {why} in this part: there is nothing to replay")
    return differences


def _leave_out(recording: Recording, step: int, window: Window, differences: DepthDifferences) -> None:
    """Count a reading whose warp is damaged."""
    row = recording.row(step)
    if row is not None and int(row["time_ns"]) in window and recording.is_damaged("warps/measured", step):
        differences.readings_damaged += 1
