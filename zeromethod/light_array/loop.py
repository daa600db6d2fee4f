"""The loop of LED and detector arrays: takes readings, fits depth modes, sends the next levels."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact import Contact
from zeromethod.light_array.channels import Channels
from zeromethod.light_array.depth import DepthReader
from zeromethod.light_array.devices import FULL_SCALE, Counts, LightArrays, Readings
from zeromethod.light_array.estimate import Fit, fit, look, model_of
from zeromethod.light_array.exchange import Exchange, GivenUp, Record, no_record
from zeromethod.light_array.finer import FinerDents
from zeromethod.light_array.next_levels import next_levels
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.light_array.start import Start, measure_start
from zeromethod.loop.state import LOCK_FRAMES, State
from zeromethod.loop.step import StepFigures
from zeromethod.surface import Peak, Surface

READ_EVERY = 5
"""Frames that are averaged to one reading of depth: 1 kHz of 5 kHz."""

SURFACE_EVERY = 20
"""Readings per map of depth and sigma."""

_LOCK_SIGMAS = 2.0
"""A frame is nulled when other levels could change the light by less: rms, in sigmas of one reading."""

_FITS = 2.0
"""Robust residual of the fit, in sigmas of one reading, above which the modes do not explain the light."""

_MOST_STRANGE = 6
"""When more detectors than these are off in one frame, single ones have not failed: it is a narrow dent, or a
contact."""

_SETTLED, _BY_NOISE = 0.02, 4.5
"""Change of the places looked at, LED pitches, below which one linear step of the fit is exact enough; or so
many sigmas of what noise changes, where that is more."""

_MOST_HIDDEN = 0.2
"""Depth that the modes miss of a finer dent, over the peak, above which nothing is read."""

_FEWEST_USED = 0.5
"""Share of the detectors that must be in use."""

_UNFIT_FRAMES = 50
"""Consecutive frames that the modes do not explain, after which the mirror is lost."""

_REST_SIGMAS = 5.0
"""A peak smaller than this counts as no press."""

_UNFIT_WORDS = (
    "the depth modes do not explain the light: too fine a dent, light from outside, more noise than the rig "
    "file says, another bench, or many channels failed at once"
)
_FINER_WORDS = "a dent finer than the depth modes, which would read it too shallow,"
_STRANGE_WORDS = "readings show levels that were not sent: is there a second host?"
_DARK_WORDS = "the arrays show no levels yet"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class LightStep(StepFigures):
    """One frame. light_residual: how far the light is from that at rest, rms over detectors, of full scale.

    shown, counts: levels that were lit and what was read; None without readings. modes: a reading of depth,
    mean of the last `READ_EVERY` frames, in the frame that completes it. surface: a map, every
    `SURFACE_EVERY` readings. contacts: always none; messages need it.
    """

    light_residual: float = math.nan
    shown: Counts | None = None
    counts: Counts | None = None
    modes: Float | None = None
    surface: Surface | None = None
    contacts: tuple[Contact, ...] = ()


class LightLoop:
    """Arrays under control.

    counts: events so far, by name. faults: channels that are left out, and why. start: what was measured
    first, None before. model: the optics, with the places that detectors were found to look at.
    """

    def __init__(self, rig: LightArrayRig, arrays: LightArrays, record: Record = no_record) -> None:
        """record: takes what a recording of the run has."""
        self.rig, self.arrays, self._record = rig, arrays, record
        self._link = Exchange(arrays, rig.arrays.reopen_s, record)
        self.counts = self._link.counts
        self.model = model_of(rig)
        self._finer = FinerDents(rig)
        self.reader = DepthReader(rig, self._finer)
        self.start: Start | None = None
        self.state, self.reason = State.STARTING, ""
        self.faults: dict[str, str] = {}
        self._frames = self._begin_ns = 0
        self._covariance = np.diag(1 / self.model.prior)
        self._nulled = self._unfit = 0
        self._settled = self._resting = self._at_rest = False
        self._readings: list[Fit] = []
        self._finer_dent = ""

    def run(self, frames: int | None = None, seconds: float | None = None) -> Iterator[LightStep]:
        """Measure the start, then close the loop for so many frames or seconds of the arrays' clock."""
        last_s = math.inf if seconds is None else seconds - 0.5 / self.rig.detectors.rate_hz
        last_frame = math.inf if frames is None else self._frames + frames
        try:
            if self.start is None:
                self.start = measure_start(self.rig, self.model, self._link.measure)
                self._channels = Channels(self.start, self._finer)
                self.faults, self.model = self._channels.faults, self.start.model
                self._from_rest()
                self._still = max(_SETTLED, _BY_NOISE * self._noise_of_places())
                self._link.send(self.start.levels)
                notes = (f"{name} is {why} and left out" for name, why in self.faults.items())
                yield self._step(notes=tuple(notes))
            while not self._link.stopped and self._frames < last_frame:
                got = self._link.next()
                step = self._step() if got is None else self._take(got)
                yield step
                if step.state is State.FAULT or step.time_s >= last_s:
                    return
        except GivenUp:
            yield self._step()

    def stop(self) -> None:
        """End the run after the frame in hand."""
        self._link.stopped = True

    def _from_rest(self) -> None:
        """Let the next frame's fit start from the mirror at rest."""
        self._estimate = np.zeros(len(self.model.prior))
        self._look = look(self.model, self._estimate[:-2])

    def _noise_of_places(self) -> float:
        """Standard deviation, LED pitches, that noise makes of a place looked at: the greatest, at rest."""
        start, used = self.start, self._channels.used
        assert start is not None
        lit, look_ = start.led * start.levels / FULL_SCALE, self._look
        fit(self.model, self._estimate, look_, self._covariance, True, lit, start.offset, start.rest, used)
        by = self.model.by_mode[:, used]
        return float(np.sqrt(np.max(np.sum((by @ self._covariance[:-2, :-2]) * by, axis=-1))))

    def _take(self, got: Readings) -> LightStep:
        """Once round: fit the modes, send the next levels, judge the state."""
        began = time.perf_counter()
        assert self.start is not None
        self._begin_ns = self._begin_ns or got.time_ns - self._link.shift_ns
        self._frames += 1
        counts = self._link.levels(got.shown)
        newest = self._link.newest_levels()
        if counts is None:
            self.counts["readings of levels never sent"] += 1
            self.state, self.reason = State.HOLDING, _STRANGE_WORDS if got.shown else _DARK_WORDS
            self._link.send(newest)
            return self._step(got)
        channels, sigma, shown = self._channels, self.model.sigma, counts / FULL_SCALE
        lit, reading = channels.led * shown, self.start.reading(got.counts)
        fresh = self._frames % READ_EVERY == 1 or not self._settled
        found = fit(
            self.model, self._estimate, self._look, self._covariance, fresh, lit, self.start.offset, reading,
            channels.used,
        )  # fmt: skip
        self._estimate, self._look = found.state, found.look
        self._settled = found.moved < self._still
        used = channels.used
        missing = np.where(used, self.start.rest - reading, 0.0)
        wanted, could, residual = next_levels(
            found.look, missing, channels.led, shown, newest / FULL_SCALE, self.rig.control.gain, sigma
        )
        self._link.send(np.rint(wanted * FULL_SCALE).astype(np.uint16))
        fits = found.scale < _FITS
        at_rest = self._at_rest and fits and (self._unfit < _UNFIT_FRAMES or bool(self._finer_dent))
        notes = channels.see(found, got.counts, shown, at_rest)
        self.counts.update(note.removesuffix(" and left out") for note in notes)
        fits = fits and channels.strange <= _MOST_STRANGE
        if notes:
            self._unfit = 0  # channels that fail together are left out one by one
        modes, peak, surface = self._read(found, got.time_ns) if fits else (None, None, None)
        used_share = float(used.mean())
        self._judge(could / sigma, fits and not self._finer_dent, used_share)
        step = self._step(
            got, notes=tuple(notes), sensed=True, readable=modes is not None, valid_share=used_share,
            loop_ms=1e3 * (time.perf_counter() - began), light_residual=residual, shown=counts,
            counts=got.counts, modes=modes, peak=peak, surface=surface,
        )  # fmt: skip
        if modes is not None and peak is not None:
            row = (peak.depth_mm, peak.sigma_mm, peak.x_mm, peak.y_mm)
            self._record("depth", step.number, step.time_ns, step.state.value.encode(), row, modes)
        return step

    def _judge(self, could: float, fits: bool, used_share: float) -> None:
        """State of the loop after a frame. could: light that levels can still add, in sigmas of a reading."""
        self._nulled = self._nulled + 1 if could < _LOCK_SIGMAS and fits else 0
        self._unfit = 0 if fits else self._unfit + 1
        if np.count_nonzero(self._channels.alive) < _FEWEST_USED * COUNT:
            self.state, self.reason = State.LOST, "more than half of the detectors are left out"
        elif self._unfit >= _UNFIT_FRAMES or used_share < _FEWEST_USED:
            self.state, self.reason = State.LOST, self._finer_dent or _UNFIT_WORDS
            if self._unfit % _UNFIT_FRAMES == 0 and not self._finer_dent:
                self._from_rest()  # a fit that went astray would not come back by itself
        elif self._nulled >= LOCK_FRAMES:
            self.state, self.reason = State.RESTING if self._resting else State.LOCKED, ""
        else:
            self.state, self.reason, self._resting = State.NULLING, "", False

    def _read(self, found: Fit, time_ns: int) -> tuple[Float | None, Peak | None, Surface | None]:
        """Modes, their peak and, now and then, a map, in the frame that completes a reading; else None."""
        self._readings = [*self._readings[1 - READ_EVERY :], found] if self._settled else []
        if self._frames % READ_EVERY or len(self._readings) < READ_EVERY:
            return None, None, None
        modes = np.mean([one.state[:-2] for one in self._readings], axis=0)
        left = np.mean([one.left for one in self._readings], axis=0)
        finer = self._finer.find(np.where(self._channels.read, left, 0.0), READ_EVERY)
        self._channels.pressed = finer.sure
        peak, noise_mm = self.reader.peak(modes, self._covariance, finer, READ_EVERY)
        self._at_rest = abs(peak.depth_mm) < _REST_SIGMAS * peak.sigma_mm
        self._resting = abs(peak.depth_mm) < _REST_SIGMAS * noise_mm and not finer.sure
        self._finer_dent = ""
        if finer.sure and finer.hidden_mm > _MOST_HIDDEN * abs(peak.depth_mm):
            self._finer_dent = f"{_FINER_WORDS} at {finer.x_mm:.0f}, {finer.y_mm:.0f} mm"
            return None, None, None
        surface = None
        if self._frames % (READ_EVERY * SURFACE_EVERY) == 0:
            surface = self.reader.surface(modes, self._covariance, finer, READ_EVERY, time_ns)
        return modes, peak, surface

    def _step(self, got: Readings | None = None, notes: tuple[str, ...] = (), **more: Any) -> LightStep:
        """Step of the newest readings, or of none, in the state that this makes."""
        if got is None and self._link.trouble:
            self.state, self.reason = self._link.trouble
        last = got or self._link.last
        at_ns = 0 if last is None else last.time_ns
        notes, self._link.notes = self._link.notes + notes, ()
        return LightStep(
            number=self._frames,
            time_ns=at_ns,
            time_s=1e-9 * (at_ns - self._begin_ns - self._link.shift_ns) if self._begin_ns else 0.0,
            state=self.state,
            reason=self.reason,
            phase=self.arrays.phase_at(at_ns),
            frame_number=None if got is None else got.number,
            dropped=self.counts["readings lost"],
            notes=notes,
            **more,
        )
