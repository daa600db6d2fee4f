"""What is measured before the loop closes, with the mirror at rest: darkness, each LED alone, the pattern."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import MeasurementError
from zeromethod.light_array.devices import FULL_SCALE, Counts, Readings
from zeromethod.light_array.estimate import Look, Model, each_led, look, seen
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import SIDE, LightArrayRig

_DARK_FRAMES, _REST_FRAMES = 100, 250
_ROUNDS, _MOST_ROUNDS = 8, 24
"""How often each LED is lit alone; at most, where readings are lost."""

_FITS, _STEP = 2, 0.01
"""How often places and gains are fitted in turn; by how many LED pitches places are moved to find out what
that changes."""

_TURNS = 400
"""How often gains of LEDs and of detectors are fitted in turn: errors that neighbours share take hundreds."""

_FEWEST = 4
"""Readings of one LED alone, or of one mean, at the least."""

_DEAD = 0.2
"""Gain, over the median, below which a channel is dead."""

_FAINT = 0.02
"""Light that a detector sees of an LED, over the most, below which it does not see it: noise would pass for a
gain."""

_UNSEEN = {"detector": "looking beyond the LEDs", "LED": "seen by no detector"}

_TINY = 1e-12
SATURATED = 0.98
"""Reading, of full scale, above which a detector is saturated."""

_FEWEST_ALIVE = 0.5

Exchange = Callable[[Sequence[Counts]], list[Readings | None]]
"""Has levels lit, one after the other; returns the readings of each, None where they were lost."""


@dataclass(frozen=True)
class Start:
    """What the arrays are like, measured with the mirror at rest.

    model: with the places that detectors were found to look at. led: (256,) gains, 0 for dead ones. detector:
    (256,) gains, infinite for those left out. dark: (256,) readings without light, of full scale. rest:
    (256,) light at rest. offset: (256,) by how much that is more than the model says. levels: (256,) at rest.
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
        return np.asarray((counts / FULL_SCALE - self.dark) / self.detector)


def levels_at_rest(rig: LightArrayRig) -> Counts:
    """(256,) levels at rest: crossed cosines, on whose flanks the detectors look."""
    pattern = rig.pattern
    wave = np.cos(2 * np.pi * (np.arange(SIDE) + 0.5) / pattern.period_pitches)
    light = pattern.mean * (1 + pattern.contrast * (wave[:, None] + wave))
    return np.asarray(np.rint(np.clip(light, 0, 1).ravel() * FULL_SCALE), np.uint16)


def measure_start(rig: LightArrayRig, model: Model, exchange: Exchange) -> Start:
    """Measure what the arrays are like, with the mirror at rest. Raises MeasurementError where it cannot."""
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
    response[dark > SATURATED] = 0.0
    model = _shifted(model, response)
    led, detector = _gains(response, footprints(model), 1)
    for _ in range(_FITS):  # places first: gains that change along the array look like another place
        model = _placed(model, response, led, detector)
        led, detector = _gains(response, footprints(model))
    light = footprints(model)
    unseen = {
        "detector": light.max(axis=1) < _FAINT * light.max(),
        "LED": light.max(axis=0) < _FAINT * light.max(),
    }
    detector[unseen["detector"]], led[unseen["LED"]] = 0.0, 0.0
    levels = np.where(led > 0, levels_at_rest(rig), 0).astype(np.uint16)
    pattern = _mean(exchange, levels, _REST_FRAMES)
    saturated = np.maximum(dark, pattern) > SATURATED
    detector[saturated] = 0.0
    gains = {"LED": led, "detector": detector}
    faults = {f"{kind} {k}": "dead" for kind, gain in gains.items() for k in np.flatnonzero(gain == 0)}
    faults |= {f"{kind} {k}": _UNSEEN[kind] for kind in unseen for k in np.flatnonzero(unseen[kind])}
    faults |= {f"detector {k}": "saturated" for k in np.flatnonzero(saturated)}
    if min(np.mean(led > 0), np.mean(detector > 0)) < _FEWEST_ALIVE:
        raise MeasurementError("the arrays: more than half of the LEDs or detectors are dead, or not in view")
    detector = np.where(detector > 0, detector, np.inf)
    rest = (pattern - dark) / detector
    offset = np.where(np.isfinite(detector), rest - seen(_at_rest(model), led * levels / FULL_SCALE), 0.0)
    return Start(model, led, detector, dark, offset, rest, levels, faults)


def _at_rest(model: Model) -> Look:
    """What detectors see of the LEDs in the mirror at rest."""
    return look(model, np.zeros(model.by_mode.shape[2]))


def footprints(model: Model) -> Float:
    """(detectors, LEDs) light that each detector sees of each LED alone, in the mirror at rest."""
    return each_led(_at_rest(model))


def _shifted(model: Model, response: Float) -> Model:
    """Model whose detectors all look elsewhere by as much, from the middles of what they see, gains apart."""
    light, places = footprints(model), np.stack(np.divmod(np.arange(COUNT), SIDE)[::-1], axis=1)
    most = response.sum(axis=1)
    good = (most > np.median(most) / 2) & (light.sum(axis=1) > light.sum(axis=1).max() / 2)
    found, expected = (part[good] @ places / part[good].sum(axis=1)[:, None] for part in (response, light))
    return model._replace(off=model.off + np.median(found - expected, axis=0))


def _placed(model: Model, response: Float, led: Float, detector: Float) -> Model:
    """Model whose detectors look where responses (detectors, LEDs) to each LED alone say.

    All of them are moved together: shifted, stretched or turned, as one array is.
    """
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
    """Gains of LEDs and detectors that make expected responses (detectors, LEDs) fit the measured ones."""
    both, square, led = expected * response, expected**2 + _TINY, np.ones(COUNT)
    for _ in range(turns):
        detector = both @ led / (square @ led**2)
        led = both.T @ detector / (square.T @ detector**2)
        led = np.where(led > _DEAD * np.median(led), led, 0.0)
        detector = np.where(detector > _DEAD * np.median(detector), detector, 0.0)
        led = np.asarray(led / led[led > 0].mean())
    return led, detector
