"""The loop of LED and detector arrays: readings in, depth modes and the next levels out."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact import Contact
from zeromethod.light_array.channels import Channels, Seen
from zeromethod.light_array.depth import DepthReader
from zeromethod.light_array.devices import FULL_SCALE, ArraysLost, Counts, LightArrays, Readings
from zeromethod.light_array.estimate import Fit, fit, look, model_of, next_levels
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

_REMEMBERED = 256
"""Levels sent that readings may still show."""

_LOCK_SIGMAS = 2.0
"""Light, rms, that other levels could still add, in sigmas of one reading, below which a frame is nulled."""

_FITS = 2.0
"""Robust residual, in sigmas, above which the modes do not explain what is seen."""

_RESTARTED = 20
"""Readings in a row whose numbers are not above the last, by which the arrays have started again."""

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
_TIMEOUT_S, _RETRY_S = 0.1, 0.2


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
        self.model = model_of(rig)
        self._finer = FinerDents(rig)
        self.reader = DepthReader(rig, self._finer)
        self.counts: Counter[str] = Counter()
        self.start: Start | None = None
        self.state, self.reason = State.STARTING, ""
        self.stopped = False
        self._sent: deque[tuple[int, Counts]] = deque(maxlen=_REMEMBERED)
        self._number = self._frames = self._refused = 0
        self._last: Readings | None = None
        self._from_rest()
        self._covariance = np.diag(1 / self.model.prior)
        self._nulled = self._unfit = 0
        self._settled = self._resting = self._at_rest = False
        self._silent_s = 0.0
        self._backwards = 0
        self._notes: tuple[str, ...] = ()
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
                self.start = measure_start(self.rig, self.model, self._exchange)
                self._channels = Channels(self.start, self._finer)
                self.model = self.start.model
                self._from_rest()
                self._send(self.start.levels)
                yield self._step(
                    notes=tuple(f"{name} is {why} and left out" for name, why in self.faults.items())
                )
            done = 0
            while not self.stopped and (frames is None or done < frames):
                got = self._next()
                if got is None:
                    yield self._step()
                    if self.state is State.FAULT:
                        return
                    continue
                done += 1
                step = self._take(got)
                yield step
                if seconds is not None and step.time_s >= seconds - 0.5 / self.rig.detectors.rate_hz:
                    break
        except _GivenUp:
            yield self._step()

    def _from_rest(self) -> None:
        """Take it that the mirror is at rest, for the next frame to start from."""
        self._estimate = np.zeros(len(self.model.prior))
        self._look = look(self.model, self._estimate[:-2])

    def stop(self) -> None:
        """End the run after the frame in hand."""
        self.stopped = True

    def _send(self, levels: Counts) -> None:
        self._number += 1
        self._sent.append((self._number, levels))
        try:
            self.arrays.send(self._number, levels)
        except ArraysLost as error:
            self._lost(str(error))

    def _exchange(self, wanted: Sequence[Counts]) -> list[Readings | None]:
        """Have levels lit, one after the other; the readings of each."""
        first = self._number + 1
        found: list[Readings | None] = [None] * len(wanted)
        for k in range(len(wanted) + _REMEMBERED // 4):
            self._send(wanted[min(k, len(wanted) - 1)])
            got = self._wait()
            if got is not None and 0 <= got.shown - first < len(wanted):
                found[got.shown - first] = got
            if found[-1] is not None and k >= len(wanted) - 1:
                break
        return found

    def _wait(self) -> Readings | None:
        """Return the next readings while the start is measured. Raises _GivenUp where none come."""
        for _ in range(max(round(self.rig.arrays.reopen_s / _TIMEOUT_S), 1)):
            got = self._next()
            if self.stopped:
                raise _GivenUp
            if got is not None or self.state is State.FAULT:
                break
        if got is None:
            self.state, self.reason = State.FAULT, self.reason or "the arrays send no readings"
            raise _GivenUp
        self.state, self.reason = State.STARTING, ""
        return got

    def _next(self) -> Readings | None:
        """Return the next readings; None after a time without, which the state then says."""
        try:
            got = self.arrays.receive(_TIMEOUT_S)
        except ArraysLost as error:
            self._lost(str(error))
            return None
        if broken := self.arrays.refused - self._refused:
            self.counts["frames broken on the way"] += broken
            self._refused = self.arrays.refused
        last = self._last
        if got is None:
            self.counts["times without readings"] += not self._silent_s
            silent_s = self._silent_s = self._silent_s + _TIMEOUT_S
            self.state, self.reason = (
                State.HOLDING,
                f"no readings for {silent_s:.1f} s: power, cable, address",
            )
            if silent_s >= self.rig.arrays.reopen_s:
                self.state, self.reason = State.FAULT, f"the arrays sent nothing for {silent_s:.1f} s"
            elif self._sent:  # arrays that were off do not know whom to send readings to
                self.arrays.send(*self._sent[-1])
            return None
        self._silent_s = 0.0
        if last is not None and got.number <= last.number:
            self._backwards += 1
            if self._backwards < _RESTARTED:
                return None
            self._restarted(got, last)
        elif last is not None:
            late = {"readings out of order": self._backwards, "readings lost": got.number - last.number - 1}
            self.counts.update({name: count for name, count in late.items() if count})
        self._backwards = 0
        self._last = got
        return got

    def _restarted(self, got: Readings, last: Readings) -> None:
        """Go on with arrays that count from the start again, and whose clock may, too."""
        self.counts.update({"arrays started again": 1, "readings lost": self._backwards - 1})
        self._notes += ("the arrays started again: readings go on by what was measured before",)
        if self._begin_ns:
            self._begin_ns += got.time_ns - last.time_ns

    def _lost(self, why: str) -> None:
        """Try to open what was lost, for as long as the rig says."""
        self.counts["arrays lost"] += 1
        until = time.monotonic() + self.rig.arrays.reopen_s
        while not self.arrays.reopen():
            if time.monotonic() >= until or self.stopped:
                self.state, self.reason = State.FAULT, f"the arrays are lost: {why}"
                raise _GivenUp
            time.sleep(_RETRY_S)
        self.state, self.reason = State.HOLDING, f"the arrays were lost and are open again: {why}"

    def _take(self, got: Readings) -> LightStep:
        """Once round: fit the modes, command the next levels, keep the state."""
        began = time.perf_counter()
        assert self.start is not None
        if not self._begin_ns:
            self._begin_ns = got.time_ns
        self._frames += 1
        shown = next((levels for number, levels in reversed(self._sent) if number == got.shown), None)
        if shown is None:
            self.counts["readings of levels never sent"] += 1
            self.state, self.reason = State.HOLDING, _STRANGE_WORDS if got.shown else _DARK_WORDS
            self._send(self._sent[-1][1])
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
            self._sent[-1][1] / FULL_SCALE,
            self.rig.control.gain,
            self.model.sigma,
        )
        self._send(np.rint(wanted * FULL_SCALE).astype(np.uint16))
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
            if (
                self._unfit % _UNFIT_FRAMES == 0 and not self._finer_dent
            ):  # look for it again from the mirror at rest
                self._from_rest()
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
        last = got or self._last
        at_ns = 0 if last is None else last.time_ns
        phase = getattr(self.arrays, "phase_at", None)
        notes, self._notes = self._notes + more.pop("notes", ()), ()
        return LightStep(
            number=self._frames,
            time_ns=at_ns,
            time_s=1e-9 * (at_ns - self._begin_ns) if self._begin_ns else 0.0,
            state=self.state,
            reason=self.reason,
            phase=phase(at_ns) if phase is not None else "",
            frame_number=None if got is None else got.number,
            dropped=self.counts["readings lost"],
            notes=notes,
            **more,
        )


class _GivenUp(Exception):
    """The arrays cannot be had any more; the state says why."""
