"""A bench of nodes only: no image, but the light of an LCD in time, summed as carrier phasors.

The panel is integrated numerically (many instants per exposure), so that the controller's closed form is
held against something that is not itself. The sensing window is taken as perfect, unwrapping as well.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from zeromethod.control.controller import controller_of
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.exposures import Exposures
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.loop.circle import Circle, FrameResult
from zeromethod.pattern.stepping import shift_of
from zeromethod.rig.model import ControlSpec, DisplaySpec
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import sample
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag

PERIOD_PX = 16
SIGMA_PX = 0.01
LCD_PER_CAMERA = 0.84
PANEL = (400, 400)
INSTANTS = 150


def panel(
    rise_s: float = 0.004,
    refresh_hz: float = 60.0,
    latency_s: float = 0.0,
    scan: str = "down",
    size: tuple[int, int] = PANEL,
) -> DisplaySpec:
    timing = {"refresh_hz": refresh_hz, "rise_s": rise_s, "latency_s": latency_s, "scan": scan}
    return DisplaySpec(columns=size[0], rows=size[1], pitch_mm=0.1, centre_mm=(0.0, 0.0), **timing)  # type: ignore[arg-type]


def rest_warp(image_px: int = 256) -> Rest:
    grid = NodeGrid((image_px, image_px), PERIOD_PX)
    u, v = grid.mesh()
    middle = 0.5 * (np.array(PANEL) - 1)
    away = np.stack([u, v], axis=-1) - 0.5 * (image_px - 1)
    return Rest.from_map(grid, middle + LCD_PER_CAMERA * away, PANEL)


def dent(rest: Rest, peak_lcd_px: float, sigma_px: float = 40.0, shift_px: float = 0.0) -> np.ndarray:
    """Displacement (rows, cols, 2) like that of a Gaussian press: its gradient, largest at one sigma."""
    u, v = rest.grid.mesh()
    centre_px = 0.5 * (rest.grid.image_shape[0] - 1) + shift_px
    x = np.stack([u - centre_px, v - centre_px], axis=-1) / sigma_px
    return -peak_lcd_px * math.exp(0.5) * x * np.exp(-0.5 * np.sum(x * x, axis=-1, keepdims=True))


class PhasorSensor:
    """Hands on the residual that the bench put in place of an image, less a moving target's known phase."""

    expected: np.ndarray
    """(rows, cols, 2) camera px, from which the order is known as a perfect unwrapper has it."""

    def measure(
        self,
        image: Residual,
        guess: np.ndarray | None = None,
        continued: np.ndarray | None = None,
        *,
        light_share: np.ndarray | None = None,
        target_rad: np.ndarray | None = None,
    ) -> Residual:
        if target_rad is None:
            return image
        d = image.d - PERIOD_PX / (2 * np.pi) * target_rad
        d += PERIOD_PX * np.rint((self.expected - d) / PERIOD_PX)
        return replace(image, d=np.where(image.flags[..., None] != 0, 0.0, d))

    def set_reference(self, residual: Residual | None) -> None:
        pass

    def scale_reference(self, ratio: float) -> None:
        pass


@dataclass
class NodeBench:
    """Free-running camera and panel around a `Circle`; `truth(time_s)` is the displacement from rest.

    step: of a moving target, as in a rig file; one_way: it never turns back. late_s: by which pictures are
    lit later than the circle is made to believe.
    """

    rest: Rest
    truth: Callable[[float], np.ndarray]
    display: DisplaySpec = field(default_factory=panel)
    control: ControlSpec = field(default_factory=ControlSpec)
    camera_hz: float = 60.0
    exposure_s: float = 0.008
    phase: float = 0.3
    camera_latency_s: float = 0.004
    noise: float = SIGMA_PX
    seed: int = 0
    step: int = 0
    one_way: bool = False
    late_s: float = 0.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        exposures = Exposures(self.rest.grid, PanelTiming.of(self.display), "cosines")
        controller = controller_of(self.control, self.rest)
        self.sensor = PhasorSensor()
        self.circle = Circle(self.rest, exposures, self.sensor, controller)
        self.pictures: list[tuple[float, np.ndarray, tuple[float, float]]] = []
        self.shown = 0
        self.now_s = 0.0

    def run(self, frames: int, frozen: bool = False) -> Iterator[FrameResult]:
        self._show()
        number = -1
        for _ in range(frames):
            # the newest frame in hand that was not yet returned, else the next one
            in_hand_s = self.now_s - self.exposure_s - self.camera_latency_s
            newest = math.floor(in_hand_s * self.camera_hz - self.phase)
            number = max(number + 1, newest)
            start_s = (number + self.phase) / self.camera_hz
            self.now_s = max(self.now_s, start_s + self.exposure_s + self.camera_latency_s)
            mid_s = start_s + 0.5 * self.exposure_s
            frame = Frame(self._expose(start_s), round(1e9 * mid_s), round(1e9 * self.exposure_s), number)
            self.mid_s = mid_s
            taken = self.circle.take(frame, frozen)
            if taken.changed:
                self._show()
            yield taken

    def _show(self) -> None:
        refresh = math.floor(self.now_s * self.display.refresh_hz) + 1
        self.now_s = refresh / self.display.refresh_hz
        q = self.circle.controller.commanded
        along = self.shown / self.step if self.one_way else 0.0
        shift = (along, 2 * along) if self.one_way else shift_of(self.step, self.shown)
        self.shown += 1
        self.pictures.append((self.now_s, q.copy(), shift))
        # older ones have faded
        self.pictures = self.pictures[-7:]
        source_ns = self.circle.source_ns
        self.circle.presented(round(1e9 * self.now_s), q, source_ns=source_ns, shift=shift)

    def _weights(self, row: np.ndarray, start_s: float) -> np.ndarray:
        """(pictures, rows, cols): light of each picture in each node, summed over many instants."""
        tau = self.display.rise_s / math.log(9)
        instants = start_s + self.exposure_s * (np.arange(INSTANTS) + 0.5) / INSTANTS
        rows = np.linspace(0, PANEL[1] - 1, 65)
        scan = rows[::-1] if self.display.scan == "up" else rows
        delays = self.display.latency_s + self.late_s + scan / (PANEL[1] - 1) / self.display.refresh_hz
        since = np.array([t for t, *_ in self.pictures])[:, None] + delays
        after = np.maximum(instants[:, None, None] - since, 0)
        risen = 1 - np.exp(-after / tau) if tau else 1.0 * (after > 0)
        risen[:, :-1] -= risen[:, 1:]
        return np.stack([np.interp(row, rows, one) for one in risen.mean(axis=0)])

    def _expose(self, start_s: float) -> Residual:
        grid = self.rest.grid
        true_q = self.rest.q + self.truth(start_s + 0.5 * self.exposure_s)
        weights = self._weights(true_q[..., 1], start_s)
        phasor = np.zeros_like(true_q, dtype=complex)
        expected = np.zeros_like(true_q)
        lit = 0.0
        for share, (_, q, shift) in zip(weights, self.pictures, strict=True):
            if share.max() > 1e-6:
                d = _seen_at(self.rest, q, true_q)
                phasor += share[..., None] * np.exp(2j * np.pi * (d / PERIOD_PX + shift))
                expected += share[..., None] * d
                lit = lit + share
        turns = np.angle(phasor) / (2 * np.pi)
        d = PERIOD_PX * (turns + np.rint(expected / PERIOD_PX - turns))
        self.sensor.expected = expected
        d = d + self.noise * self.rng.standard_normal(d.shape)
        flags = np.full(grid.shape, Flag.OUTSIDE, np.uint16)
        flags[grid.inner] = np.where(np.isfinite(d[grid.inner]).all(axis=-1), 0, Flag.MODULATION)
        d[flags != 0] = 0.0
        sigma = np.full_like(d, max(self.noise, 1e-4))
        mean = np.full(grid.shape, 100.0, np.float32) * np.asarray(lit, np.float32)
        return Residual(d, sigma, flags, np.ones_like(d, dtype=np.float32), mean)

    def error_px(self) -> np.ndarray:
        """(rows, cols, 2) commanded minus true warp at the inner nodes, LCD px."""
        inner = self.rest.grid.inner
        true_q = self.rest.q + self.truth(self.mid_s)
        return (self.circle.controller.commanded - true_q)[inner]


def _seen_at(rest: Rest, q: np.ndarray, true_q: np.ndarray) -> np.ndarray:
    """d with q((u, v) + d) = true_q, camera px, by fixed-point iteration against the rest map's scale."""
    grid = rest.grid
    u, v = grid.mesh()
    d = np.zeros_like(q)
    for _ in range(12):
        col = (u + d[..., 0] - grid.u_px[0]) / grid.spacing_px
        row = (v + d[..., 1] - grid.v_px[0]) / grid.spacing_px
        here = sample(q, np.clip(col, 1, grid.shape[1] - 2), np.clip(row, 1, grid.shape[0] - 2))
        d += 0.8 * (true_q - here) / LCD_PER_CAMERA
    return d
