"""The loop of LED and detector arrays: readings in, depth modes and the next levels out."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact import Contact
from zeromethod.light_array.channels import Channels, Seen
from zeromethod.light_array.depth import DepthReader
from zeromethod.light_array.devices import FULL_SCALE, Counts, LightArrays, Readings
from zeromethod.light_array.estimate import Fit, fit, look, model_of, next_levels
from zeromethod.light_array.exchange import Exchange, GivenUp
from zeromethod.light_array.finer import FinerDents
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.light_array.start import Start, measure_start
from zeromethod.loop.state import LOCK_FRAMES, State
from zeromethod.loop.step import StepFigures
from zeromethod.surface import Peak, Surface

READ_EVERY = 5
"""Frames that are averaged to one reading of depth: 1 kHz of 5."""

SURFACE_EVERY = 20
"""Readings to one map of depth and sigma."""

_LOCK_SIGMAS = 2.0
"""Light, rms, that other levels could still add, in sigmas of one reading, below which a frame is nulled."""

_FITS = 2.0
"""Robust residual, in sigmas, above which the modes do not explain what is seen."""

_MOST_STRANGE = 6
"""Detectors that are off in a frame, beyond which it is none of single ones: a narrow dent, a contact."""

_SETTLED = 0.02
"""Step of a place looked at, LED pitches, below which a frame's linear reading is exact enough."""

_MOST_HIDDEN = 0.2
"""Depth that the modes miss of a finer dent, of the peak, from which they do not read it."""

_FEWEST_USED = 0.5
_UNFIT_FRAMES = 50
_UNFIT_WORDS = "the depth modes do not explain the light: too fine a dent, light from outside, another bench"
_FINER_WORDS = "a dent finer than the depth modes, which would read it too shallow,"
_STRANGE_WORDS = "readings show levels that were not sent: is there a second host?"
_DARK_WORDS = "the arrays show no levels yet"
_REST_SIGMAS = 5.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class LightStep(StepFigures):
    """One frame. light_residual: how far readings are from rest, rms over the detectors used, of full scale.

    shown, counts: levels that were lit and what was read, None without readings. modes: a reading of depth,
    mean of the last frames, where this frame ends one. surface: a map, now and then. contacts: none are
    found.
    """

    light_residual: float = math.nan
    shown: Counts | None = None
    counts: Counts | None = None
    modes: Float | None = None
    surface: Surface | None = None
    contacts: tuple[Contact, ...] = ()


class LightLoop:
    """Arrays under control. counts: events so far, by name; start: what was measured first, None before."""

    def __init__(self, rig: LightArrayRig, arrays: LightArrays) -> None:
        self.rig, self.arrays = rig, arrays
        self._link = Exchange(arrays, rig.arrays.reopen_s)
        self.counts = self._link.counts
        self.model = model_of(rig)
        self._finer = FinerDents(rig)
        self.reader = DepthReader(rig, self._finer)
        self.start: Start | None = None
        self.state, self.reason = State.STARTING, ""
        self._frames = 0
        self._from_rest()
        self._covariance = np.diag(1 / self.model.prior)
        self._nulled = self._unfit = 0
        self._settled = self._resting = self._at_rest = False
        self._readings: list[Fit] = []
        self._finer_dent = ""
        self._begin_ns = 0

    @property
    def faults(self) -> dict[str, str]:
        """Channels that are left out, and why."""
        return {} if self.start is None else self._channels.faults

    def run(self, frames: int | None = None, seconds: float | None = None) -> Iterator[LightStep]:
        """Measure the start, then close the loop for so many frames or seconds of the arrays' clock."""
        try:
            if self.start is None:
                self.start = measure_start(self.rig, self.model, self._link.measure)
                self._channels = Channels(self.start, self._finer)
                self.model = self.start.model
                self._from_rest()
                self._link.send(self.start.levels)
                yield self._step(
                    notes=tuple(f"{name} is {why} and left out" for name, why in self.faults.items())
                )
            done = 0
            while not self._link.stopped and (frames is None or done < frames):
                got = self._link.next()
                if got is None:
                    yield self._without_readings()
                    if self.state is State.FAULT:
                        return
                    continue
                done += 1
                step = self._take(got)
                yield step
                if seconds is not None and step.time_s >= seconds - 0.5 / self.rig.detectors.rate_hz:
                    break
        except GivenUp:
            yield self._without_readings()

    def _without_readings(self) -> LightStep:
        """Step in the state that missing readings make."""
        if self._link.trouble:
            self.state, self.reason = self._link.trouble
        return self._step()

    def _from_rest(self) -> None:
        """Take it that the mirror is at rest, for the next frame to start from."""
        self._estimate = np.zeros(len(self.model.prior))
        self._look = look(self.model, self._estimate[:-2])

    def stop(self) -> None:
        """End the run after the frame in hand."""
        self._link.stopped = True

    def _take(self, got: Readings) -> LightStep:
        """Once round: fit the modes, command the next levels, keep the state."""
        began = time.perf_counter()
        assert self.start is not None
        if not self._begin_ns:
            self._begin_ns = got.time_ns - self._link.shift_ns
        self._frames += 1
        shown = self._link.levels(got.shown)
        if shown is None:
            self.counts["readings of levels never sent"] += 1
            self.state, self.reason = State.HOLDING, _STRANGE_WORDS if got.shown else _DARK_WORDS
            self._link.send(self._link.newest_levels())
            return self._step(got)
        channels = self._channels
        lit = channels.led * (shown / FULL_SCALE)
        reading = self.start.reading(got.counts)
        fresh = self._frames % READ_EVERY == 1 or not self._settled
        found = fit(
            self.model,
            self._estimate,
            self._look,
            self._covariance,
            fresh,
            lit,
            self.start.offset,
            reading,
            channels.used,
        )
        self._estimate, self._look = found.state, found.look
        self._settled = found.moved < _SETTLED
        fits = found.scale < _FITS
        light = found.look.light
        missing = np.where(channels.used, self.start.rest - reading, 0.0)
        used = int(np.count_nonzero(channels.used))
        wanted, could, residual = next_levels(
            light,
            missing,
            channels.led,
            shown / FULL_SCALE,
            self._link.newest_levels() / FULL_SCALE,
            self.rig.control.gain,
            self.model.sigma,
        )
        self._link.send(np.rint(wanted * FULL_SCALE).astype(np.uint16))
        at_rest = self._at_rest and fits and (self._unfit < _UNFIT_FRAMES or bool(self._finer_dent))
        frame = Seen(found.left, found.scale, got.counts, reading, light, lit, self.model.sigma)
        notes = channels.see(frame, at_rest)
        for note in notes:
            self.counts[note.removesuffix(" and left out")] += 1
        fits = fits and channels.strange <= _MOST_STRANGE
        read = self._read(found, got.time_ns) if fits else None
        self._judge(could / self.model.sigma, fits and not self._finer_dent, used)
        modes, peak, surface = read or (None, None, None)
        return self._step(
            got,
            notes=tuple(notes),
            sensed=True,
            readable=modes is not None,
            valid_share=used / COUNT,
            loop_ms=1e3 * (time.perf_counter() - began),
            light_residual=residual,
            shown=shown,
            counts=got.counts,
            modes=modes,
            peak=peak,
            surface=surface,
        )

    def _judge(self, could: float, fits: bool, used: int) -> None:
        """State of the loop after a frame. could: light that levels can still add, in sigmas of a reading."""
        self._nulled = self._nulled + 1 if could < _LOCK_SIGMAS and fits else 0
        self._unfit = 0 if fits else self._unfit + 1
        if np.count_nonzero(self._channels.alive) < _FEWEST_USED * COUNT:
            self.state, self.reason = State.LOST, "more than half of the detectors are left out"
        elif self._unfit >= _UNFIT_FRAMES or used < _FEWEST_USED * COUNT:
            self.state, self.reason = State.LOST, self._finer_dent or _UNFIT_WORDS
            if self._unfit % _UNFIT_FRAMES == 0 and not self._finer_dent:
                self._from_rest()  # to look for the mirror again
        elif self._nulled >= LOCK_FRAMES:
            self.state, self.reason = State.RESTING if self._resting else State.LOCKED, ""
        else:
            self.state, self.reason, self._resting = State.NULLING, "", False

    def _read(self, found: Fit, time_ns: int) -> tuple[Float, Peak, Surface | None] | None:
        """Modes, mean of the last frames, where this frame ends them, their peak, and now and then a map."""
        self._readings = [*self._readings[1 - READ_EVERY :], found] if self._settled else []
        if self._frames % READ_EVERY or len(self._readings) < READ_EVERY:
            return None
        modes = np.mean([one.state[:-2] for one in self._readings], axis=0)
        left = np.mean([one.left for one in self._readings], axis=0)
        finer = self._finer.find(np.where(self._channels.alive, left, 0.0), READ_EVERY)
        self._channels.pressed = finer.sure
        peak, noise_mm = self.reader.peak(modes, self._covariance, finer, READ_EVERY)
        self._at_rest = abs(peak.depth_mm) < _REST_SIGMAS * peak.sigma_mm
        self._resting = abs(peak.depth_mm) < _REST_SIGMAS * noise_mm and not finer.sure
        self._finer_dent = ""
        if finer.sure and finer.hidden_mm > _MOST_HIDDEN * abs(peak.depth_mm):
            self._finer_dent = f"{_FINER_WORDS} at {finer.x_mm:.0f}, {finer.y_mm:.0f} mm"
            return None
        surface = None
        if self._frames % (READ_EVERY * SURFACE_EVERY) == 0:
            surface = self.reader.surface(modes, self._covariance, finer, READ_EVERY, time_ns)
        return modes, peak, surface

    def _step(self, got: Readings | None = None, **more: Any) -> LightStep:
        """Step of the newest readings, or of none."""
        last = got or self._link.last
        at_ns = 0 if last is None else last.time_ns
        phase = getattr(self.arrays, "phase_at", None)
        notes, self._link.notes = self._link.notes + more.pop("notes", ()), ()
        return LightStep(
            number=self._frames,
            time_ns=at_ns,
            time_s=1e-9 * (at_ns - self._begin_ns - self._link.shift_ns) if self._begin_ns else 0.0,
            state=self.state,
            reason=self.reason,
            phase=phase(at_ns) if phase is not None else "",
            frame_number=None if got is None else got.number,
            dropped=self.counts["readings lost"],
            notes=notes,
            **more,
        )
