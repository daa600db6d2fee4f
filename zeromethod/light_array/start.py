"""What is measured before the loop closes, at rest: dark readings, each LED alone, the pattern."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import MeasurementError
from zeromethod.light_array.devices import FULL_SCALE, Counts, Readings
from zeromethod.light_array.estimate import Light, Model, look, seen
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import SIDE, LightArrayRig

_DARK_FRAMES, _REST_FRAMES = 100, 250
_ROUNDS, _MOST_ROUNDS = 8, 24
"""How often each LED is lit alone, and at most where readings are lost."""

_FITS, _STEP = 2, 0.01
"""Rounds of places and gains by turns; LED pitches by which places are moved to see what that does."""

_TURNS = 400
"""Turns of LEDs' and detectors' gains: what neighbours share takes hundreds to find."""

_FEWEST = 4
_DEAD = 0.2
"""Gain, over the median, below which a channel is dead."""

_TINY = 1e-12
_SATURATED = 0.98
_FEWEST_ALIVE = 0.5

Exchange = Callable[[Sequence[Counts]], list[Readings | None]]
"""Have levels lit, one after the other; the readings that show each of them, None where they were lost."""


@dataclass(frozen=True)
class Start:
    """What the arrays are like. model: with the places that detectors are seen to look at.

    led, detector: gains (256,), 0 for dead ones. dark: (256,) of full scale. offset: (256,) what readings at
    rest have that the optics have not. rest: (256,) readings at rest, over the gains. levels: (256,) at rest.
    faults: names of channels left out, and why.
    """

    model: Model
    led: Float
    detector: Float
    dark: Float
    offset: Float
    rest: Float
    levels: Counts
    faults: dict[str, str]

    def reading(self, counts: Counts) -> Float:
        """(256,) light by counts; 0 where a detector is left out."""
        gain = np.where(self.detector > 0, self.detector, np.inf)
        return np.asarray((counts / FULL_SCALE - self.dark) / gain)


def levels_at_rest(rig: LightArrayRig) -> Counts:
    """(256,) levels at rest: crossed cosines, on whose flanks the detectors look."""
    pattern = rig.pattern
    wave = np.cos(2 * np.pi * (np.arange(SIDE) + 0.5) / pattern.period_pitches)
    light = pattern.mean * (1 + pattern.contrast * (wave[:, None] + wave))
    return np.asarray(np.rint(np.clip(light, 0, 1).ravel() * FULL_SCALE), np.uint16)


def measure_start(rig: LightArrayRig, model: Model, exchange: Exchange) -> Start:
    """Measure what the arrays are like, the mirror at rest. Raises MeasurementError where it cannot."""
    dark = _mean(exchange, np.zeros(COUNT, np.uint16), _DARK_FRAMES)
    total, times = np.zeros((COUNT, COUNT)), np.zeros(COUNT)
    for round_ in range(_MOST_ROUNDS):
        if round_ >= _ROUNDS and times.min() >= _FEWEST:
            break
        for number, found in enumerate(exchange(list(FULL_SCALE * np.eye(COUNT, dtype=np.uint16)))):
            if found is not None:
                total[:, number] += found.counts / FULL_SCALE
                times[number] += 1
    if times.min() == 0:
        raise MeasurementError("the arrays: no readings of some LEDs alone: see docs/leds.md, the link")
    response = total / times - dark[:, None]
    faults = {f"detector {k}": "saturated" for k in np.flatnonzero(dark > _SATURATED)}
    response[dark > _SATURATED] = 0.0
    led, detector = _gains(response, footprints(model), 1)
    for _ in range(_FITS):  # places first: gains that rise along the array would pass for another place
        model = _placed(model, response, led, detector)
        led, detector = _gains(response, footprints(model))
    faults |= {f"detector {k}": "dead" for k in np.flatnonzero((detector == 0) & (dark <= _SATURATED))}
    faults |= {f"LED {k}": "dead" for k in np.flatnonzero(led == 0)}
    if min(np.mean(led > 0), np.mean(detector > 0)) < _FEWEST_ALIVE:
        raise MeasurementError("the arrays: more than half of the LEDs or detectors are dead")
    levels = np.where(led > 0, levels_at_rest(rig), 0).astype(np.uint16)
    rest = (_mean(exchange, levels, _REST_FRAMES) - dark) / np.where(detector > 0, detector, np.inf)
    offset = rest - seen(_at_rest(model), led * levels / FULL_SCALE)
    return Start(model, led, detector, dark, np.where(detector > 0, offset, 0.0), rest, levels, faults)


def _at_rest(model: Model) -> Light:
    """What detectors see by the mirror at rest."""
    return look(model, np.zeros(model.by_mode.shape[2])).light


def footprints(model: Model) -> Float:
    """(detectors, LEDs) light of each LED alone, at rest."""
    light = _at_rest(model)
    return np.array([seen(light, one) for one in np.eye(COUNT)]).T


def _placed(model: Model, response: Float, led: Float, detector: Float) -> Model:
    """Model whose detectors, an array moved as a whole, look where responses to LEDs alone say."""
    expected = footprints(model) * led
    row, column = np.divmod(np.arange(COUNT), SIDE)
    moves = np.stack([np.ones(COUNT), column / SIDE - 0.5, row / SIDE - 0.5], axis=1)
    changes = []
    for axis in (0, 1):
        off = model.off.copy()
        off[:, axis] += _STEP
        change = detector[:, None] * (footprints(model._replace(off=off)) * led - expected) / _STEP
        changes += [move[:, None] * change for move in moves.T]
    by = np.array(changes).reshape(len(changes), -1)
    left = (response - detector[:, None] * expected).ravel()
    off = moves @ np.linalg.solve(by @ by.T, by @ left).reshape(2, -1).T
    return model._replace(off=model.off + off)


def _mean(exchange: Exchange, levels: Counts, frames: int) -> Float:
    """(256,) mean of the readings under levels, of full scale."""
    found = [one.counts for one in exchange([levels] * frames) if one is not None]
    if len(found) < _FEWEST:
        raise MeasurementError(
            "the arrays: no readings that show the levels sent: see docs/leds.md, the link"
        )
    return np.asarray(np.mean(found, axis=0) / FULL_SCALE)


def _gains(response: Float, expected: Float, turns: int = _TURNS) -> tuple[Float, Float]:
    """Gains of LEDs and detectors by which what is expected fits responses (detectors, LEDs) best."""
    both, square, led = expected * response, expected**2 + _TINY, np.ones(COUNT)
    for _ in range(turns):
        detector = both @ led / (square @ led**2)
        led = both.T @ detector / (square.T @ detector**2)
        led = np.where(led > _DEAD * np.median(led), led, 0.0)
        detector = np.where(detector > _DEAD * np.median(detector), detector, 0.0)
        led = np.asarray(led / led[led > 0].mean())
    return led, detector
