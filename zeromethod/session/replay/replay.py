"""A recorded session evaluated again in one call: from its warps, its frames, or in closed loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

from zeromethod.errors import InputError
from zeromethod.optics import check_geometry
from zeromethod.recording.recording import Recording
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.replay.closed_loop import ClosedLoopReplay, recorded_track, simulated_bench
from zeromethod.session.replay.comparison import figures_of
from zeromethod.session.replay.differences import DepthDifferences
from zeromethod.session.replay.fine import FineDifferences
from zeromethod.session.replay.from_frames import WarpDifferences, replay_from_frames
from zeromethod.session.replay.from_warps import replay_from_warps
from zeromethod.session.replay.mirror import RecordedMirror, contacts_left_out
from zeromethod.session.replay.settings import with_settings
from zeromethod.session.replay.window import Window

Mode = Literal["from-warps", "from-frames", "closed-loop"]


def replay(
    recording: Recording | str | Path,
    mode: Mode = "from-warps",
    *,
    settings: Sequence[str] = (),
    rig: Rig | str | Path | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    speed: float | None = None,
    record: str | Path | None = None,
) -> dict[str, Any]:
    """Replay a recording, with other settings if wanted; no display or camera is needed.

    Parameters
    ----------
    recording : Recording, str or Path
        What `zeromethod run --record` or `Session(record=...)` wrote.
    mode : {"from-warps", "from-frames", "closed-loop"}
        From where: the measured warps, the frames, or the surface, which moves a simulated bench.
    settings : sequence of str
        Other values of the rig, "control.gain=0.3".
    rig : Rig, str or Path, optional
        Another rig in place of the recorded one.
    from_s, to_s : float, optional
        Part to replay, seconds from the first frame.
    speed : float, optional
        At most so many times as fast as it was; as fast as possible by default.
    record : str or Path, optional
        With "closed-loop": record the last session there.

    Returns
    -------
    dict
        "changed": whether settings differ. From warps and frames: "equal" (bit for bit) and the figures of
        all differences. In closed loop: "sessions", figures by name: "recorded", "simulated" and "changed".

    Raises
    ------
    InputError
        For a recording without what is needed, and settings that cannot be used.
    """
    if not isinstance(recording, Recording):
        with Recording(recording) as opened:
            return replay(
                opened,
                mode,
                settings=settings,
                rig=rig,
                from_s=from_s,
                to_s=to_s,
                speed=speed,
                record=record,
            )
    if mode not in get_args(Mode):
        raise InputError(f"mode: {mode!r}: allowed: {', '.join(get_args(Mode))}")
    if record is not None and (mode != "closed-loop" or Path(record).exists()):
        raise InputError(f"record: {record}: a new file, and only with mode='closed-loop'")
    window = Window.of(recording, from_s, to_s)
    given = recording.rig if rig is None else rig if isinstance(rig, Rig) else load_rig(rig)
    if mode == "closed-loop":
        return _sessions(recording, window, given, settings, speed, None if record is None else Path(record))
    bench = with_settings(given, settings)
    check_geometry(bench)
    equal, figures = evaluated_again(recording, bench, window, mode, speed=speed)
    return {"changed": bench != recording.rig, "equal": equal, **figures}


def evaluated_again(
    recording: Recording,
    rig: Rig,
    window: Window,
    mode: Mode,
    *,
    speed: float | None = None,
    on_step: Callable[[float], None] | None = None,
) -> tuple[bool, dict[str, Any]]:
    """Whether warps or frames give the same again, bit for bit, and figures of how far they differ.

    mode: "from-warps" or "from-frames". on_step: as `replay_from_frames` takes it.
    """
    parts: Sequence[WarpDifferences | DepthDifferences | FineDifferences]
    if mode == "from-warps":
        parts = (replay_from_warps(recording, rig, window, speed=speed, on_step=on_step),)
    else:
        parts = replay_from_frames(recording, rig, window, speed=speed, on_step=on_step)
    figures = {name: value for one in parts for name, value in one.figures.items()}
    return not any(one.different for one in parts), figures


def _sessions(
    recording: Recording,
    window: Window,
    rig: Rig,
    settings: Sequence[str],
    speed: float | None,
    record: Path | None,
) -> dict[str, Any]:
    """Figures of the recorded session, of the same on a simulated bench, and with other settings."""
    benches = {"simulated": simulated_bench(recording.rig)}
    changed = with_settings(simulated_bench(rig), settings)
    if changed != benches["simulated"]:
        benches["changed"] = changed
    tracks = [recorded_track(recording, window)]
    for name, bench in benches.items():
        check_geometry(bench)
        kept = record if name == list(benches)[-1] else None
        tracks.append(
            ClosedLoopReplay(name, bench, RecordedMirror(recording, window), record=kept, speed=speed).run()
        )
    left_out = contacts_left_out(recording, window)
    about = {"changed": "changed" in benches, "contacts_left_out": left_out}
    return {**about, "sessions": {one.name: figures_of(one) for one in tracks}}
