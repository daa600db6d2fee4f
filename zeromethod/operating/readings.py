"""The values of a run as of its newest step, and the rows of its history."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import asdict
from typing import Any

import numpy as np

from zeromethod.approach import Approach, Watching
from zeromethod.interactive.pointers import KEPT, PointerEvent
from zeromethod.loop.state import State
from zeromethod.loop.step import Step
from zeromethod.operating.advice import ADVICE, FRESH, LATE_S, doubt_of
from zeromethod.operating.fine_doubt import Spoiled
from zeromethod.operating.lasting import LastingState
from zeromethod.operating.rates import Rate
from zeromethod.rubbing import ContactStatus, Motion
from zeromethod.session.session import Session
from zeromethod.surface import Surface

STATUS = ("share", "spots_per_cm2", "spot_mm2", "speed_mm_s", "sigma_speed_mm_s", "pitch_mm", "aliased")
"""Figures of a texture that rubs among the values."""

HISTORY = (
    "time_s",
    "peak_mm",
    "peak_sigma_mm",
    "residual_px",
    "loop_rate_hz",
    "delay_ms",
    "dropped",
    "force_normal_n",
    "rubbing_share",
    "rubbing_speed_mm_s",
    "rubbing_slips",
)
"""Columns of the history, one row per step."""

_KEPT_ROWS = 4096
"""Rows that wait to be taken; older ones are left out where nobody takes them."""


def history_row(values: dict[str, Any]) -> tuple[float | int | None, ...]:
    """A row of `HISTORY` of a run's values: without depth where it is not to be relied on."""
    held = values["doubt"] and values["state"] != State.PAUSED
    return tuple(None if held and name.startswith("peak") else values[name] for name in HISTORY)


def number(value: float | None) -> float | None:
    """A number as JSON has it: None where it is not known."""
    return None if value is None or not math.isfinite(value) else float(value)


def median_sigma_um(surface: Surface) -> float | None:
    """Standard deviation of depth, median over some of the valid nodes, µm."""
    sigma_mm = surface.sigma_depth_mm[::4, ::4][surface.valid[::4, ::4]]
    return number(1e3 * float(np.median(sigma_mm))) if sigma_mm.size else None


def approach_values(approach: Approach | None) -> dict[str, Any]:
    """Values of what comes; time and place are None where nothing is about to touch."""
    coming = approach if approach is not None and approach.armed else Approach(watching=Watching.CLEAR)
    return {
        "approach": "" if approach is None else approach.words,
        "contact_s": number(coming.contact_s),
        "contact_sigma_s": number(coming.sigma_contact_s),
        "contact_x_mm": number(coming.x_mm),
        "contact_y_mm": number(coming.y_mm),
        "contact_sigma_mm": number(max(coming.sigma_x_mm, coming.sigma_y_mm)),
    }


def status_values(status: ContactStatus | None) -> dict[str, Any]:
    """Values of a texture that rubs; None where none does."""
    values = {name: None if status is None else getattr(status, name) for name in STATUS}
    known = {
        f"rubbing_{name}": number(one) if isinstance(one, float) else one for name, one in values.items()
    }
    slips = None if status is None or status.motion is Motion.UNKNOWN else status.motion is Motion.SLIP
    return {"rubbing": "" if status is None else status.words, "rubbing_slips": slips, **known}


class Readings:
    """Follows the steps of a session, in its thread; `values` may be asked for in any other."""

    def __init__(self, session: Session, calibration: str = "") -> None:
        """calibration: in words, "" for none."""
        self._session = session
        self._loops, self._reads = Rate(), Rate()
        self._rows: deque[tuple[float | int | None, ...]] = deque(maxlen=_KEPT_ROWS)
        self._lasting = LastingState()
        depth = session.rig.geometry.depth
        percent = 100 * math.sqrt(sum(mode[0] ** 2 for mode in depth)) if depth else None
        self._fixed: dict[str, Any] = {
            "calibration": calibration or _geometry_words(session.rig.geometry.known),
            "calibration_sigma_percent": percent,
            "simulated_time": not session.loop.live,
            "force_shear_n": None,
        }
        self._peak: dict[str, Any] = dict.fromkeys(
            (
                *("peak_mm", "peak_sigma_mm", "peak_x_mm", "peak_y_mm", "peak_x_sigma_mm", "peak_y_sigma_mm"),
                *("peak_where", "peak_time_s", "depth_sigma_um", "latency_ms"),
            )
        )
        self._peak |= {"contacts": [], "force_normal_n": None, "force_normal_sigma_n": None}
        self._pointers: deque[PointerEvent] = deque(maxlen=KEPT)
        self._peak |= status_values(None)
        self._fine: dict[str, Any] = dict.fromkeys(("fine_peak_mm", "fine_peak_sigma_mm", "fine_time_s"))
        self._spoiled, self._zero = Spoiled(), session.loop.zero
        self._frame: dict[str, Any] = {"frame": None, "exposure_ms": None, "delay_ms": None}
        self._newest = self._values(None)

    @property
    def values(self) -> dict[str, Any]:
        """Every value of `zeromethod.operating.run_table`, as of the newest step; not to be changed."""
        return self._newest

    def take_rows(self) -> list[tuple[float | int | None, ...]]:
        """Rows of the history since the last call, in `HISTORY`'s columns."""
        rows = []
        while self._rows:
            rows.append(self._rows.popleft())
        return rows

    def see(self, step: Step) -> tuple[str, ...]:
        """Take in a step of the session; what happened that a person should know, one line each."""
        if step.sensed:
            self._loops.note(step.time_s)
        if step.surface is not None and step.peak is not None:
            self._read(step, step.surface)
        self._spoiled = self._spoiled.seen(step.state, step.time_s, step.zero is not self._zero)
        self._zero = step.zero
        if step.fine is not None:
            self._read_fine(step)
        if step.frame_number is not None:
            self._frame = {
                "frame": step.frame_number,
                "exposure_ms": number(1e-6 * step.exposure_ns),
                "delay_ms": number(step.delay_ms) or self._frame["delay_ms"],
            }
        self._pointers.extend(step.pointers)
        values = self._newest = self._values(step)
        self._rows.append(history_row(values))
        before = self._lasting.shown
        shown = self._lasting.see(step.state, step.time_s)
        reason = step.reason.removeprefix(f"{shown}: ") if shown is step.state else ""
        words = f"{shown}: {reason}" if reason else str(shown)
        return ((words,) if shown is not before else ()) + step.notes

    def _read(self, step: Step, surface: Surface) -> None:
        peak = step.peak
        assert peak is not None
        at_s = step.time_s - 1e-9 * (step.time_ns - surface.time_ns)
        self._reads.note(at_s)
        self._peak = {
            "peak_mm": number(peak.depth_mm),
            "peak_sigma_mm": number(peak.sigma_mm),
            "peak_x_mm": number(peak.x_mm),
            "peak_y_mm": number(peak.y_mm),
            "peak_x_sigma_mm": number(peak.sigma_x_mm),
            "peak_y_sigma_mm": number(peak.sigma_y_mm),
            "peak_where": peak.where.value,
            "peak_time_s": max(at_s, 0.0),
            "depth_sigma_um": median_sigma_um(surface),
            "latency_ms": number(step.latency_ms),
            "force_normal_n": number(step.total_force_n),
            "force_normal_sigma_n": number(step.sigma_total_force_n),
            **status_values(step.contact_status),
            "contacts": [
                {key: number(value) if isinstance(value, float) else value for key, value in each.items()}
                for each in map(asdict, step.touching)
            ],
        }

    def _read_fine(self, step: Step) -> None:
        figures = self._session.result.fine[-1]  # worked out where it was read
        at_s = step.time_s - 1e-9 * (step.time_ns - figures.time_ns)
        self._fine = {
            "fine_peak_mm": number(figures.depth_peak_mm),
            "fine_peak_sigma_mm": number(figures.depth_peak_sigma_mm),
            "fine_time_s": max(at_s, 0.0),
        }

    def _values(self, step: Step | None) -> dict[str, Any]:
        session, loop = self._session, self._session.loop
        recording = session.recording
        if step is None:
            status = loop.status
            stepped: dict[str, Any] = {"state": status.state.value, "reason": status.reason, "phase": ""}
            stepped |= {"time_s": 0.0, "step": 0, "calibrated": not session.rig.geometry.relative}
            stepped |= {"residual_px": None, "valid_share": None, "loop_ms": None}
            state, now_s = status.state, 0.0
        else:
            state, now_s = step.state, step.time_s
            sensed = math.isfinite(step.residual_rms_px)
            stepped = {
                "state": state.value,
                "reason": step.reason,
                "phase": step.phase,
                "time_s": step.time_s,
            }
            stepped |= {"step": step.number, "calibrated": step.calibrated}
            stepped |= {
                "residual_px": number(step.residual_rms_px),
                "valid_share": number(step.valid_share) if sensed else None,
                "loop_ms": number(step.loop_ms),
            }
        read_s = self._peak["peak_time_s"]
        late_s = None if read_s is None else now_s - read_s
        doubt = doubt_of(state, late_s)
        return {
            **stepped,
            **self._fixed,
            **self._peak,
            **self._frame,
            **approach_values(None if step is None else step.approach),
            "pointers": [event.as_browsers_have_it for event in self._pointers],
            "advice": ADVICE[state],
            "fresh": state in FRESH and (late_s or 0.0) <= LATE_S,
            "doubt": doubt,
            **self._fine,
            "fine_doubt": self._spoiled.doubt(doubt, self._fine["fine_time_s"], now_s),
            "loop_rate_hz": self._loops.at(now_s),
            "read_rate_hz": self._reads.at(now_s),
            "dropped": session.result.dropped,
            "paused": loop.paused,
            "gain": loop.adjust.gain,
            "contrast": loop.adjust.target.contrast,
            "recording": "" if recording.path is None else recording.path.name,
            "recording_trouble": recording.words,
        }


def _geometry_words(known: str) -> str:
    return {"nominal": "not calibrated", "exact": "exact (a simulated bench)"}.get(known, known)
