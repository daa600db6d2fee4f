"""A recording as its page is shown it: the step of a moment, with what was read up to then."""

from __future__ import annotations

from typing import Any

import numpy as np

from zeromethod.approach import Approach
from zeromethod.arrays import Float
from zeromethod.interactive.pointers import KEPT, PointerEvent
from zeromethod.operating.advice import ADVICE, FRESH, LATE_S, doubt_of
from zeromethod.operating.fine_doubt import Spoiled
from zeromethod.operating.lasting import LastingState
from zeromethod.operating.player import Player
from zeromethod.operating.rates import Rate
from zeromethod.operating.readings import (
    approach_values,
    history_row,
    median_sigma_um,
    number,
    status_values,
)
from zeromethod.page.fine_maps import FineMaps
from zeromethod.page.message import Content, Said
from zeromethod.page.run_content import lattice_of, residual_maps, surface_maps
from zeromethod.recording.columns import CONTACTS
from zeromethod.recording.recording import Recording
from zeromethod.recording.schema import STATES
from zeromethod.rubbing import ContactStatus
from zeromethod.surface import Surface

MOST_ROWS = 4000
"""Rows of the history that are shown of a recording."""

_CONTACT = tuple(
    name
    for name in CONTACTS
    if name not in {"step", "time_ns", "outline_mm"} and not name.startswith("sigma")
)


class ReplayContent:
    """Composes contents of a recording. Tables are read once, arrays when a moment is shown."""

    def __init__(self, recording: Recording, player: Player) -> None:
        self._recording, self._player = recording, player
        self.steps = recording.steps
        self._start_ns = int(self.steps["time_ns"][0])
        self.times_s = 1e-9 * (self.steps["time_ns"] - self._start_ns)
        self._peaks, self._contacts = recording.peaks, recording.contacts
        self._approaches, self._status = recording.tables.approaches(), recording.tables.contact_status()
        pointers = recording.tables.pointers()
        self._pointer_steps = pointers["step"]
        self._pointers = [PointerEvent.of_row(one).as_browsers_have_it for one in pointers]
        self._surfaces = recording.steps_with("surface")
        self._fine_steps, peaks = recording.steps_with("fine"), recording.fine_peaks
        self._fine_peaks = peaks[np.isin(peaks["step"], self._fine_steps)]
        self._spoiled = self._spoils()
        self._fine: tuple[int, FineMaps] | None = None
        self._lattice = lattice_of(recording.grid)
        self._dropped = np.cumsum(self.steps["dropped"])
        self._rate = self._rates()
        geometry = recording.rig.geometry
        self._calibrated = not geometry.relative
        percent = (
            100 * float(np.sqrt(sum(mode[0] ** 2 for mode in geometry.depth))) if geometry.depth else None
        )
        self._fixed: dict[str, Any] = {
            "calibration": "as recorded" if recording.calibration else geometry.known,
            "calibration_sigma_percent": percent,
            "simulated_time": not recording.live,
            "force_shear_n": None,
            "duration_s": player.duration_s,
        }
        self._rows: list[tuple[Any, ...]] | None = self._history()
        self._read: tuple[int, Surface] | None = None

    def _rates(self) -> list[float | None]:
        rate, found = Rate(), []
        for time_s, sensed in zip(self.times_s.tolist(), self.steps["sensed"].tolist(), strict=True):
            if sensed:
                rate.note(time_s)
            found.append(rate.at(time_s))
        return found

    def _spoils(self) -> list[Spoiled]:
        """After each step, up to when fine surfaces do not count."""
        zeros = frozenset(self._recording.steps_with("zeros").tolist())
        spoiled, found = Spoiled(), []
        rows = self.times_s.tolist(), self.steps["state"].tolist(), self.steps["number"].tolist()
        for time_s, state, step in zip(*rows, strict=True):
            spoiled = spoiled.seen(STATES[state], time_s, step in zeros)
            found.append(spoiled)
        return found

    def _history(self) -> list[tuple[Any, ...]]:
        stride = -(-len(self.steps) // MOST_ROWS)
        return [history_row(self.values(index)) for index in range(0, len(self.steps), stride)]

    def index_at(self, time_s: float) -> int:
        """Index of the step of a moment: the last one up to it."""
        return max(0, int(np.searchsorted(self.times_s, time_s + 1e-9, side="right")) - 1)

    def said(self) -> list[Said]:
        """States, notes and calls of the recording, in order."""
        text = Recording.text
        found = [(int(row["time_ns"]), "note", text(row["text"])) for row in self._recording.notes]
        for row in self._recording.calls:
            words = f"{text(row['method'])} {text(row['arguments'])} ({text(row['source'])})"
            found.append((int(row["time_ns"]), "call", words))
        found += self._states()
        return [Said(kind, words, 1e-9 * (at - self._start_ns)) for at, kind, words in sorted(found)]

    def _states(self) -> list[tuple[int, str, str]]:
        """Time, "state" and words of each state that lasted, as the run said them."""
        found, lasting = [], LastingState()
        times_s, states = self.times_s.tolist(), self.steps["state"].tolist()
        for index, (time_s, number_of_state) in enumerate(zip(times_s, states, strict=True)):
            before, state = lasting.shown, STATES[number_of_state]
            if lasting.see(state, time_s) is not before:
                row = self.steps[index]
                reason = Recording.text(row["reason"]).removeprefix(f"{state}: ")
                words = (
                    f"{lasting.shown}: {reason}" if reason and lasting.shown is state else str(lasting.shown)
                )
                found.append((int(row["time_ns"]), "state", words))
        return found

    def values(self, index: int) -> dict[str, Any]:
        """Values of the table, of a step by its index."""
        row = self.steps[index]
        state = STATES[int(row["state"])]
        sensed = bool(np.isfinite(row["residual_rms_px"]))
        peak = self._peak_at(int(row["number"]))
        read_s = peak["peak_time_s"]
        late_s = None if read_s is None else float(self.times_s[index]) - read_s
        doubt, fine = doubt_of(state, late_s), self._fine_peak_at(int(row["number"]))
        now_s = float(self.times_s[index])
        return {
            **self._fixed,
            **peak,
            "state": state.value,
            "reason": Recording.text(row["reason"]),
            "advice": ADVICE[state],
            "fresh": state in FRESH and (late_s or 0.0) <= LATE_S,
            "doubt": doubt,
            **approach_values(self._approach_at(int(row["number"]))),
            "pointers": self._pointers_at(int(row["number"])),
            **fine,
            "fine_doubt": self._spoiled[index].doubt(doubt, fine["fine_time_s"], now_s),
            "phase": Recording.text(row["phase"]),
            "time_s": float(self.times_s[index]),
            "step": int(row["number"]),
            "frame": None if row["frame_number"] < 0 else int(row["frame_number"]),
            "residual_px": number(float(row["residual_rms_px"])),
            "valid_share": float(row["valid_share"]) if sensed else None,
            "loop_rate_hz": self._rate[index],
            "dropped": int(self._dropped[index]),
            "loop_ms": number(float(row["loop_ms"])),
            "delay_ms": number(float(row["delay_ms"])),
            "exposure_ms": number(1e-6 * float(row["exposure_ns"])) or None,
            "calibrated": self._calibrated,
            "depth_sigma_um": None,
            "from_s": self._player.from_s,
            "to_s": self._player.to_s,
            "playing": self._player.playing,
            "speed": self._player.speed,
        }

    def _approach_at(self, step: int) -> Approach | None:
        index = int(np.searchsorted(self._approaches["step"], step, side="right")) - 1
        return None if index < 0 else Approach.of_row(self._approaches[index])

    def _peak_at(self, step: int) -> dict[str, Any]:
        index = int(np.searchsorted(self._peaks["step"], step, side="right")) - 1
        names = ("mm", "sigma_mm", "x_mm", "y_mm", "x_sigma_mm", "y_sigma_mm")
        fields = ("depth_mm", "depth_sigma_mm", "x_mm", "y_mm", "x_sigma_mm", "y_sigma_mm")
        if index < 0:
            unknown = dict.fromkeys(f"peak_{name}" for name in (*names, "where", "time_s"))
            return {
                **unknown,
                **status_values(None),
                "contacts": [],
                "force_normal_n": None,
                "force_normal_sigma_n": None,
            }
        row = self._peaks[index]
        found = {f"peak_{name}": number(float(row[field])) for name, field in zip(names, fields, strict=True)}
        touching = self._contacts[self._contacts["step"] == row["step"]]
        rubbing = self._status[self._status["step"] == row["step"]]
        return {
            **found,
            "peak_where": str(row["where"]),
            "peak_time_s": float(row["time_s"]),
            "force_normal_n": number(float(row["total_force_n"])),
            "force_normal_sigma_n": number(float(row["sigma_total_force_n"])),
            **status_values(ContactStatus.of_row(rubbing[0]) if len(rubbing) else None),
            "contacts": [
                {name: number(float(one[name])) if name != "id" else int(one[name]) for name in _CONTACT}
                for one in touching
            ],
        }

    def _pointers_at(self, step: int) -> list[dict[str, Any]]:
        """Pointer events up to a step, the last ones."""
        return self._pointers[: int(np.searchsorted(self._pointer_steps, step, side="right"))][-KEPT:]

    def _fine_peak_at(self, step: int) -> dict[str, Any]:
        index = int(np.searchsorted(self._fine_peaks["step"], step, side="right")) - 1
        if index < 0:
            return dict.fromkeys(("fine_peak_mm", "fine_peak_sigma_mm", "fine_time_s"))
        row = self._fine_peaks[index]
        return {
            "fine_peak_mm": number(float(row["depth_mm"])),
            "fine_peak_sigma_mm": number(float(row["depth_sigma_mm"])),
            "fine_time_s": 1e-9 * float(row["time_ns"] - self._start_ns),
        }

    def compose(self, index: int, parts: frozenset[str]) -> Content:
        """Content of a step by its index, with these parts, as far as they were kept."""
        recording, values = self._recording, self.values(index)
        step = values["step"]
        arrays: dict[str, dict[str, Any]] = {}
        meta: dict[str, dict[str, Any]] = {}
        image = recording.image(step) if "camera" in parts else None
        if image is not None:
            arrays["camera"] = {"image": image}
            meta["camera"] = {"step": step, "time_s": values["time_s"], "bits": recording.rig.camera.bits}
        residual = recording.residual(step) if "residual" in parts else None
        if residual is not None:
            arrays["residual"], meta["residual"] = residual_maps(residual, recording.measured(step), step)
            meta["residual"]["lattice"] = self._lattice
        q = recording.commanded(step) if "lcd" in parts else None
        if q is not None:
            arrays["lcd"], meta["lcd"] = {"q": np.ascontiguousarray(q, np.float32)}, {"step": step}
        surface = self._surface_at(step)
        if surface is not None:
            values["depth_sigma_um"] = median_sigma_um(surface)
            if "surface" in parts:
                arrays["surface"], meta["surface"] = surface_maps(surface)
                outlines, peak = self._outlines(surface, values)
                meta["surface"] |= {"lattice": self._lattice, "time_s": values["peak_time_s"]}
                meta["surface"] |= {"outlines": outlines, "peak_node": peak}
        fine = self._fine_at(step, values["fine_time_s"]) if "fine" in parts else None
        if fine is not None:
            arrays["fine"], meta["fine"] = fine.part
        rows, self._rows = self._rows or [], None
        return Content(values, rows, {}, arrays, meta)

    def _surface_at(self, step: int) -> Surface | None:
        """Surface read last, up to a step."""
        index = int(np.searchsorted(self._surfaces, step, side="right")) - 1
        if index < 0:
            return None
        of = int(self._surfaces[index])
        if self._read is None or self._read[0] != of:
            surface = self._recording.surface(of)
            if surface is None:
                return None
            self._read = of, surface
        return self._read[1]

    def _fine_at(self, step: int, time_s: float | None) -> FineMaps | None:
        """Fine surface read last, up to a step; None where that one was not kept whole."""
        index = int(np.searchsorted(self._fine_steps, step, side="right")) - 1
        if index < 0:
            return None
        of = int(self._fine_steps[index])
        if self._fine is None or self._fine[0] != of:
            surface = self._recording.fine(of)
            if surface is None or 1e-9 * (surface.time_ns - self._start_ns) != time_s:
                return None
            self._fine = of, FineMaps(surface, time_s, of, self._lattice["image"])
        return self._fine[1]

    def _outlines(
        self, surface: Surface, values: dict[str, Any]
    ) -> tuple[list[dict[str, Any]], list[float] | None]:
        """Borders of the contacts and the peak, as the camera sees them."""
        index = int(np.searchsorted(self._peaks["step"], values["step"], side="right")) - 1
        if index < 0:
            return [], None
        touching = self._contacts[self._contacts["step"] == self._peaks["step"][index]]
        first, spacing = np.array(self._lattice["first"]), self._lattice["spacing"]
        found = []
        for one in touching:
            nodes = nodes_of(surface, np.asarray(one["outline_mm"], float))
            found.append({"id": int(one["id"]), "px": np.round(first + spacing * nodes, 1).tolist()})
        place = np.array([[values["peak_x_mm"] or np.nan, values["peak_y_mm"] or 0.0]])
        peak = None if np.isnan(place).any() else nodes_of(surface, place)[0].tolist()
        return found, peak


def nodes_of(surface: Surface, places_mm: Float) -> Float:
    """(column, row) of the lattice where (n, 2) places of the mirror are seen, to first order."""
    x, y = surface.x_mm, surface.y_mm
    found = np.empty(places_mm.shape)
    rows, columns = x.shape
    for index, (at_x, at_y) in enumerate(places_mm):
        away = (x - at_x) ** 2 + (y - at_y) ** 2
        j, i = (int(one) for one in np.unravel_index(int(np.nanargmin(away)), x.shape))
        j0, j1 = max(j - 1, 0), min(j + 1, rows - 1)
        i0, i1 = max(i - 1, 0), min(i + 1, columns - 1)
        jacobian = np.array(
            [
                [(x[j, i1] - x[j, i0]) / (i1 - i0), (x[j1, i] - x[j0, i]) / (j1 - j0)],
                [(y[j, i1] - y[j, i0]) / (i1 - i0), (y[j1, i] - y[j0, i]) / (j1 - j0)],
            ]
        )
        step = np.linalg.solve(jacobian, [at_x - x[j, i], at_y - y[j, i]])
        found[index] = i + step[0], j + step[1]
    return found
