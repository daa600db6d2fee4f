"""One frame's way round the circle: pair, sense, measure, control. No device is touched here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numba
import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.control.composition import Composition, Controller
from zeromethod.control.integrator import Integrator
from zeromethod.control.velocity import Horizon
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.delay import DelayWatch
from zeromethod.exposure.pairing import PanelTiming, pair
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.loop.events import Event
from zeromethod.loop.light_watch import LightWatch
from zeromethod.loop.measured_warp import Observation, expected_residual, measure, unmixed
from zeromethod.rig.model import ControlSpec
from zeromethod.sensing.residual import Residual
from zeromethod.surface.expected_light import ExpectedLight
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

REST_BLOCK = 8
"""Nodes on a side of the blocks that must all be at rest for the mirror to be."""

REST_WITHIN_LCD_PX = 0.05
"""Displacement rms of a block, beyond three deviations of noise, that counts as rest: 0.2 um of press."""


MOVED_LCD_PX = 0.5
"""Where a node moved further between frames, and the light follows the slope, the image is read a second
time under the light that the first reading foretells: else a slide of 10 mm/s loses nodes at the kink of
the light, and 2 % of the peak with them."""


class Sensor(Protocol):
    """What turns an image into the residual."""

    def measure(
        self,
        image: Image,
        guess: Float | None = None,
        *,
        light_share: Single | None = None,
    ) -> Residual:
        """Residual of a (rows, cols) image; guess: (rows, cols, 2) px expected, NaN = none.

        light_share: (rows, cols) of the image, light expected over that at rest; None = as at rest.
        """

    def set_reference(self, residual: Residual | None) -> None:
        """Take the brightness to hold later frames against from a residual; None forgets."""


@dataclass(frozen=True, slots=True)
class Taken:
    """What a frame came to. `changed`: there is a new command. `held`: why it brought none.

    seen and measured are None where the frame could not be paired or is dark. residual_rms_px: rms length
    of the residual over valid nodes. valid_share: valid ones among the nodes seen at rest.
    """

    changed: bool = False
    held: str = ""
    events: tuple[Event, ...] = ()
    seen: Observation | None = None
    measured: Warp | None = None
    residual_rms_px: float = float("nan")
    valid_share: float = 0.0


def controller_of(control: ControlSpec, rest: Rest) -> Controller:
    """Make the controller that the rig asks for."""
    if control.controller == "integrator":
        return Integrator(rest, control.gain, control.leak)
    return Composition(rest, control.gain)


@numba.njit(cache=True)
def _figures(d: Float, valid: Mask, seen: Mask) -> tuple[float, float]:
    """(mean square length of d over valid nodes, valid share of the seen ones)."""
    total = 0.0
    nodes = both = wanted = 0
    for j in range(valid.shape[0]):
        for i in range(valid.shape[1]):
            if seen[j, i]:
                wanted += 1
            if valid[j, i]:
                nodes += 1
                both += seen[j, i]
                total += d[j, i, 0] ** 2 + d[j, i, 1] ** 2
    return total / nodes if nodes else np.nan, both / max(wanted, 1)


@numba.njit(cache=True)
def _away_from_rest(q: Float, q_rest: Float, sigma: Float, valid: Mask, size: int) -> tuple[float, float]:
    """(largest mean square displacement of any block, mean sigma^2), both per component, LCD px^2."""
    rows, cols = valid.shape
    largest = noise = 0.0
    every = 0
    for top in range(0, rows, size):
        for left in range(0, cols, size):
            total = 0.0
            nodes = 0
            for j in range(top, min(top + size, rows)):
                for i in range(left, min(left + size, cols)):
                    if valid[j, i]:
                        nodes += 1
                        for k in range(2):
                            total += 0.5 * (q[j, i, k] - q_rest[j, i, k]) ** 2
                            noise += 0.5 * sigma[j, i, k] ** 2
            if nodes:
                every += nodes
                largest = max(largest, total / nodes)
    return largest, noise / max(every, 1)


def _has_moved(measured: Warp, known_q: Float) -> bool:
    """Whether the mirror moved so far since it was known that the light foretold from then misleads."""
    valid = measured.valid
    return bool(valid.any() and np.abs(measured.q[valid] - known_q[valid]).max() > MOVED_LCD_PX)


def _continued(measured: Warp, rest: Rest) -> Float:
    """Measured warp (rows, cols, 2), nodes that are not valid filled from their neighbours."""
    return rest.q + continue_smoothly(measured.q - rest.q, measured.valid)


class Circle:
    """Everything between a frame in hand and the next warp to show, and its state from frame to frame.

    Call `presented` whenever a warp was given to the panel and `take` for every frame that may be used.
    """

    def __init__(
        self,
        rest: Rest,
        sensor: Sensor,
        controller: Controller,
        timing: PanelTiming,
        black_grey: float = 0.0,
        target_kind: str = "cosines",
        expected_light: ExpectedLight | None = None,
        delay: DelayWatch | None = None,
    ) -> None:
        """Put the parts together. expected_light: None where the light at rest is the light everywhere.

        delay: reads when pictures were lit from coded strips; None where there are none, and `timing` holds.
        """
        self.rest = rest
        self.controller = controller
        self.timing = timing
        self._sensor = sensor
        self._log = PresentationLog(rest.q.shape[:2])
        self._light = LightWatch(rest.seen, black_grey)
        self._kind = target_kind
        self._expected_light = expected_light
        self.delay = delay
        self._horizon = Horizon(timing.upwards)
        # Mid-exposure of the newest frame that the command was made from.
        self._seen_ns: int | None = None
        # At rest the order of every node is known: it is that of the rest map.
        self._trusted = rest.seen

    @property
    def seen_ns(self) -> int | None:
        """Mid-exposure of the newest frame that the present command was made from; None: of no frame."""
        return self._seen_ns

    @property
    def horizon_s(self) -> float:
        """From a frame's mid-exposure to that of those that see what was made of it; NaN: not known yet."""
        age_s = self._horizon.age_s
        return float("nan") if age_s is None else float(age_s.mean())

    def presented(self, time_ns: int, q: Float, code: int | None = None, *, seen_ns: int | None) -> None:
        """Note that `q` (copied) was presented at `time_ns`, with `code` in its strips.

        seen_ns: what the property of this name was when `q` was the command.
        """
        self._log.record(time_ns, q, seen_ns, code)

    def take(self, frame: Frame, hold: bool = False) -> Taken:
        """Measure `frame` and, unless told to `hold`, let the controller have it."""
        rest, controller = self.rest, self.controller
        known_q = controller.estimate
        timing: PanelTiming | None = self.timing
        if self.delay is not None:
            timing = self.delay.timing_of(frame.image, frame, self._log)
            self.timing = self.delay.timing
        if timing is None:
            return Taken(held="the coded strips contradict what was shown", events=(Event.STRIPS_CONTRADICT,))
        shown = pair(self._log, frame, timing, known_q, rest.grid, self._kind)
        if shown is None:
            return Taken(held="the picture was not lit yet", events=(Event.NOT_LIT,))
        self._horizon.learn(shown.age_ns)
        expected = expected_residual(shown, known_q, self._trusted, rest)
        mixing = shown.mixture
        guess = expected if mixing is None or mixing.bias_px is None else expected + mixing.bias_px
        light = self._expected_light.share(known_q) if self._expected_light is not None else None
        residual = self._sensor.measure(frame.image, guess, light_share=light)
        if self._light.is_off(residual.mean):
            return Taken(held="the light is off", events=(Event.LIGHT_OFF,))
        seen = Observation(frame, shown, unmixed(residual, shown, rest.grid))
        measured = measure(seen, rest, expected, self._trusted)
        if self._expected_light is not None and _has_moved(measured, known_q):
            light = self._expected_light.share(_continued(measured, rest))
            residual = self._sensor.measure(frame.image, guess, light_share=light)
            seen = Observation(frame, shown, unmixed(residual, shown, rest.grid))
            measured = measure(seen, rest, expected, self._trusted)
        events: tuple[Event, ...] = ()
        held = ""
        if hold:
            events, held = (Event.HELD_BY_REQUEST,), "held by request"
        changed = not hold and controller.update(seen.residual, measured, self._horizon.age_s)
        if not hold and not changed and measured.valid.any():
            events, held = (Event.PICTURES_MIXED,), "two different pictures in one exposure"
        if not held:
            self._trusted = measured.valid
        if changed:
            self._seen_ns = frame.time_ns
        square, share = _figures(seen.residual.d, measured.valid, rest.seen)
        return Taken(changed, held, events, seen, measured, float(np.sqrt(square)), share)

    def take_reference(self, taken: Taken) -> None:
        """Hold the light of later frames against that of this one, taken while the loop is locked."""
        if taken.seen is not None:
            self._sensor.set_reference(taken.seen.residual)

    def at_rest(self, measured: Warp, rest_q: Float | None = None) -> bool:
        """Whether the controller's estimate is that of the untouched mirror, within noise.

        rest_q: (rows, cols, 2) warp of the untouched mirror, LCD px, where it has drifted from the rig's.
        """
        estimate = self.controller.estimate
        rest_q = self.rest.q if rest_q is None else rest_q
        worst, noise = _away_from_rest(estimate, rest_q, measured.sigma, measured.valid, REST_BLOCK)
        return bool(worst < (3 * noise**0.5 + REST_WITHIN_LCD_PX) ** 2)
