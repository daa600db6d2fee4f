"""One frame's way round the circle. No device is touched here.

frame -> observation   what was shown while it was exposed         exposure/
      -> residual      how far what was seen is from the target    sensing/
      -> measured      shown o (id + residual)                     loop/measured_warp
      -> commanded     controller(measured)                        control/
      -> drawn on the LCD, noted as presented, and seen by a later frame
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.control.controller import Controller
from zeromethod.control.velocity import Horizon
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.exposures import Exposures, Unpaired
from zeromethod.exposure.pairing import Observation
from zeromethod.loop.beside_dark import BesideDark
from zeromethod.loop.burst import Burst
from zeromethod.loop.events import Event
from zeromethod.loop.light_quality import LightWatch
from zeromethod.loop.lost_light import LostLight
from zeromethod.loop.measured_warp import Expected, expect, measure_warp, unmixed
from zeromethod.loop.node_figures import node_figures
from zeromethod.loop.order_check import Order, OrderCheck
from zeromethod.loop.panel_blur import PanelBlur
from zeromethod.loop.rest_memory import is_at_rest
from zeromethod.loop.state import LOCK_RESIDUAL_PX
from zeromethod.loop.unsteady_nodes import UnsteadyNodes
from zeromethod.pattern.coded import Coded
from zeromethod.sensing.residual import Residual
from zeromethod.sensing.sensor import Sensor
from zeromethod.surface.expected_light import ExpectedLight
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Role, Warp

READ_AGAIN_LCD_PX = 0.5
"""Motion of a node between frames above which, where the light follows the slope, the image is read a second
time, under the light that the first reading predicts: else a slide of 10 mm/s loses nodes at the kink of the
light, and 2 % of the peak with them."""

_REFUSALS = {Unpaired.CONTRADICTED: Event.STRIPS_CONTRADICT, Unpaired.NOT_LIT: Event.NOT_LIT}


@dataclass(frozen=True, slots=True)
class FrameResult:
    """What became of one frame.

    changed: there is a new command. refusal: why it brought none. observation, residual and measured are None
    where the frame could not be paired or is dark. residual_rms_px: rms length of the residual over valid
    nodes. valid_share, covered_share: those valid, and those without light, of the nodes visible at rest.
    order: whether it is known which period of the carrier is seen, is being found, or cannot be. coded: the
    frame may have seen coded pictures in places. unread: nodes that no burst has read wait for one, or one
    is under way for them. lamp_image: they have more light than at rest.
    """

    changed: bool = False
    refusal: Event | None = None
    observation: Observation | None = None
    residual: Residual | None = None
    measured: Warp | None = None
    residual_rms_px: float = float("nan")
    valid_share: float = 0.0
    covered_share: float = 0.0
    order: Order = Order.KNOWN
    coded: bool = False
    unread: bool = False
    lamp_image: bool = False

    @property
    def believed(self) -> Warp | None:
        """The measured warp, None where its peak may be wrong: of mixed pictures, or whole periods off."""
        mixed = self.refusal is Event.PICTURES_MIXED
        return None if mixed or self.order is not Order.KNOWN else self.measured

    def measured_from(self, zero: Float | None) -> Warp | None:
        """The believed warp less a zero (rows, cols, 2), LCD px, with what was left to null; to be read."""
        if self.believed is None or self.observation is None or self.residual is None:
            return None
        return self.believed.less(zero).with_left(self.observation.shown.q, zero, self.residual.valid)


class Circle:
    """Everything between a frame in hand and the next warp to draw, and its state from frame to frame.

    Call `presented` whenever a warp was given to the panel and `take` for every frame that may be used.
    """

    def __init__(
        self,
        rest: Rest,
        exposures: Exposures,
        sensor: Sensor,
        controller: Controller,
        black_grey: float = 0.0,
        expected_light: ExpectedLight | None = None,
        panel_blur: PanelBlur | None = None,
        order_check: OrderCheck | None = None,
        burst: Burst | None = None,
        unsteady: UnsteadyNodes | None = None,
    ) -> None:
        """Put the parts together.

        expected_light: None where the light at rest is the light everywhere. panel_blur: None for a panel
        that has none. order_check: None for a target without periods. burst: None where none is ever drawn.
        unsteady: counts nodes that are to be followed slowly; None where none are.
        """
        self.rest = rest
        self.exposures = exposures
        self.controller = controller
        self._sensor = sensor
        self._light_watch = LightWatch(rest.visible, black_grey)
        self._exposure_ns = 0
        self._beside_dark = BesideDark(rest.flags.shape, rest.grid.period_px)
        self._lost_light = LostLight(rest.flags.shape, rest.grid.period_px, black_grey)
        self._expected_light = expected_light
        self._panel_blur = panel_blur
        self._order_check = order_check
        self.burst = burst
        self._unsteady = unsteady
        self._horizon = Horizon(exposures.timing.upwards)
        self._source_ns: int | None = None
        self._pending: tuple[Float, Float, Residual, Mask, float] | None = None
        # At rest the order of every node is known: it is that of the rest map.
        self._trusted = rest.visible

    @property
    def source_ns(self) -> int | None:
        """Mid-exposure of the newest frame that the present command was made from; None: of no frame."""
        return self._source_ns

    @property
    def commanded(self) -> Warp:
        """The warp that is to be shown next."""
        return Warp.drawn(self._commanded_q, Role.COMMANDED, self._source_ns or 0)

    @property
    def _commanded_q(self) -> Float:
        checking = None if self._order_check is None else self._order_check.commanded
        return self.controller.commanded if checking is None else checking

    @property
    def horizon_s(self) -> float:
        """Delay from the mid-exposure of a frame to that of those that see its picture; NaN: unknown."""
        age_s = self._horizon.age_s
        return float("nan") if age_s is None else float(age_s.mean())

    @property
    def coded(self) -> Coded | None:
        """The fringes that are to be shown over the command."""
        return None if self.burst is None else self.burst.coded

    def presented(
        self,
        time_ns: int,
        q: Float,
        code: int | None = None,
        *,
        source_ns: int | None,
        coded: int | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Note that `q` (copied) was presented at `time_ns`, with `code` in its strips.

        source_ns: what the property of this name was when `q` was the command. coded: number of the coded
        picture drawn over it. shift: of a moving target, periods.
        """
        self.exposures.log.record(time_ns, q, source_ns, code, shift)
        if self.burst is not None:
            self.burst.presented(time_ns, coded)

    def take(self, frame: Frame, frozen: bool = False) -> FrameResult:
        """Take one frame round the circle; the command stays as it is where `frozen`."""
        self.learn_pending()
        self._expect_light(frame.exposure_ns)
        known_q = self.controller.estimate
        observation = self.exposures.observe(frame, known_q)
        if isinstance(observation, Unpaired):
            return FrameResult(refusal=_REFUSALS[observation])
        self._horizon.learn(observation.age_ns)
        expected = expect(observation, known_q, self._trusted, self.rest)
        residual, measured = self._measure(observation, expected, known_q)
        if self._light_watch.is_off(residual.mean):
            return FrameResult(refusal=Event.LIGHT_OFF)
        drawn = self._commanded_q
        order, settled = self._carrier_order(observation, residual, expected, frozen)
        if settled is not None:
            expected = settled
            residual, measured = self._measure(observation, expected, known_q)
        if self._expected_light is not None and _has_moved(measured, known_q):
            continued = continue_smoothly(measured.q - self.rest.q, measured.valid)
            residual, measured = self._measure(observation, expected, self.rest.q + continued)
        if self.burst is None or not self.burst.blinding:
            self._beside_dark.learn(measured.flags)
        redraw, read = self._coded(observation, residual, measured, known_q, frozen)
        refusal = self._command(residual, measured, frozen)
        changed = redraw or self._commanded_q is not drawn
        valid = measured.valid
        nulled = valid if read is None else valid & ~read
        square, share, covered = node_figures(residual.d, nulled, valid, self.rest.visible, measured.flags)
        rms_px = float(np.sqrt(square))
        self._pending = observation.shown.q, self.rest.q, residual, valid, rms_px
        near = frozen and rms_px < LOCK_RESIDUAL_PX
        if near and is_at_rest(measured.q, self.rest.q, measured.sigma, measured.valid):
            self._lost_light.learn(residual)  # a frozen loop never reaches the state RESTING
        burst = self.burst
        return FrameResult(
            changed=changed,
            refusal=refusal,
            observation=observation,
            residual=residual,
            measured=measured,
            residual_rms_px=rms_px,
            valid_share=share,
            covered_share=covered,
            order=order,
            coded=burst is not None and burst.blinding,
            unread=burst is not None and burst.unread,
            lamp_image=burst is not None and burst.lamp_image,
        )

    def expect_touch(self, expected: bool) -> None:
        """Keep coded pictures away while a touch is expected: its first frame is to be measured."""
        if self.burst is not None:
            self.burst.waits = expected

    def _expect_light(self, exposure_ns: int) -> None:
        """Hold a frame against the light that its exposure brings."""
        if self._exposure_ns not in (0, exposure_ns):
            ratio = exposure_ns / self._exposure_ns
            self._sensor.scale_reference(ratio)
            self._light_watch.scale(ratio)
        self._exposure_ns = exposure_ns

    def learn_pending(self) -> None:
        """Learn from the last frame what only later frames need; its command need not wait for that."""
        pending, self._pending = self._pending, None
        if pending is not None and self._panel_blur is not None:
            self._panel_blur.learn(*pending)

    def _carrier_order(
        self, observation: Observation, residual: Residual, expected: Expected, frozen: bool
    ) -> tuple[Order, Expected | None]:
        """Whether the carrier's order is known, and what the frame is to be held against if just now."""
        check = self._order_check
        if check is None:
            return Order.KNOWN, None
        settled = None if frozen else check.look(observation, residual, expected)
        return check.order(observation.shown.time_ns), settled

    def _coded(
        self, observation: Observation, residual: Residual, measured: Warp, known_q: Float, frozen: bool
    ) -> tuple[bool, Mask | None]:
        """Whether other fringes are to be drawn; the nodes whose warp a burst has read."""
        burst = self.burst
        if burst is None:
            return False, None
        if frozen and not burst.blinding:  # none begins while nothing may be drawn
            return False, burst.merge(measured)
        redraw = burst.take(observation.frame.image, observation, residual, measured, known_q)
        return redraw, burst.merge(measured)

    def _measure(self, observation: Observation, expected: Expected, lit_q: Float) -> tuple[Residual, Warp]:
        """Residual and measured warp under the light that a mirror seen at `lit_q` reflects."""
        residual = self._sense(observation, expected, lit_q)
        blind = None if self.burst is None else self.burst.blinds(observation)
        parts = self.rest, self._panel_blur, self._beside_dark
        return residual, measure_warp(observation, residual, expected, *parts, blind=blind)

    def _sense(self, observation: Observation, expected: Expected, lit_q: Float) -> Residual:
        """Residual against the mix that was shown."""
        bias_px = None if observation.mixture is None else observation.mixture.bias_px
        moved = 0.0 if bias_px is None else bias_px
        guesses = expected.residual_px + moved, expected.continued_px + moved
        light = None if self._expected_light is None else self._expected_light.share(lit_q)
        target = None if observation.target is None else observation.target.node_rad
        seen = self._sensor.measure(observation.frame.image, *guesses, light_share=light, target_rad=target)
        residual = unmixed(seen, observation, self.rest.grid)
        self._lost_light.widen_sigma(residual)
        return residual

    def _command(self, residual: Residual, measured: Warp, frozen: bool) -> Event | None:
        """Let the controller have the measurement; why the command must not change."""
        if frozen:
            return Event.FROZEN
        if self.coded is not None:
            return None
        unsteady = None
        if self._unsteady is not None:
            unsteady = self._unsteady.learn(measured, self.controller.estimate)
        taken = self.controller.update(residual, measured, self._horizon.age_s, unsteady)
        if not taken and measured.valid.any():
            return Event.PICTURES_MIXED
        self._trusted = measured.valid
        if taken:
            self._source_ns = measured.time_ns
        return None

    def take_reference(self, result: FrameResult) -> None:
        """Compare the light of later frames with that of this one, taken while the loop is locked."""
        if result.residual is not None:
            self._sensor.set_reference(result.residual)
            if self.burst is not None:
                self.burst.take_reference(result.residual)

    def learn_rest(self, result: FrameResult) -> None:
        """Learn the light of the untouched mirror from a frame of it."""
        if result.residual is not None:
            self._lost_light.learn(result.residual)


def _has_moved(measured: Warp, known_q: Float) -> bool:
    """Whether any valid node moved so far that the light predicted from the frame before misleads."""
    valid = measured.valid
    return bool(valid.any() and np.abs(measured.q[valid] - known_q[valid]).max() > READ_AGAIN_LCD_PX)
