"""A screen and an eye of a lab's own, which observes the screen in a mirror.

Nothing here knows the loop; of the package it uses the contract (`zeromethod.devices.protocols`), clocks and
the rays of the mirror at rest. The real ones live in the host's time, the simulated ones on the run's clock.
"""

import threading
from collections.abc import Callable
from typing import Any

import moderngl
import numpy as np
from scipy.ndimage import map_coordinates

from zeromethod import Optics, binned, load_rig
from zeromethod.clock import Clock, HostClock
from zeromethod.devices.protocols import Frame
from zeromethod.gl import create_context
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.model import DisplaySpec, Rig

KEPT = 8
BLACK, FULL = 4.0, 190.0
NOISE_GREY = 2.0


class Screen:
    """A panel that lights up at once; swaps wait for the refresh. `before_show` may raise, or hang."""

    def __init__(self, columns: int, rows: int, refresh_hz: float, gamma: float, clock: Clock) -> None:
        self.size = (columns, rows)
        self.refresh_hz = refresh_hz
        self.gamma = gamma
        self.clock = clock
        self.lock = threading.Lock()
        self.pictures: list[tuple[int, np.ndarray]] = []
        self.shown = 0
        self.closed = False
        self.before_show: Callable[[int], None] = lambda _count: None

    def show(self, image: np.ndarray) -> int:
        self.shown += 1
        self.before_show(self.shown)
        light = (image / 255.0) ** self.gamma
        period_ns = 1e9 / self.refresh_hz
        time_ns = round(period_ns * (self.clock.now_ns() // period_ns + 1))
        self.clock.sleep_until_ns(time_ns)
        with self.lock:
            self.pictures = [*self.pictures[1 - KEPT :], (time_ns, light)]
        return time_ns

    def close(self) -> None:
        self.closed = True


class RealScreen(Screen):
    def __init__(self, columns: int, rows: int, refresh_hz: float, gamma: float) -> None:
        super().__init__(columns, rows, refresh_hz, gamma, HostClock())


class Window(RealScreen):
    """One whose driver reports what happens to its window. `on_poll` may raise."""

    warnings: tuple[str, ...] = ()
    asleep = False
    on_poll: Callable[[], None] = staticmethod(lambda: None)

    def poll(self) -> None:
        self.polled_in = threading.current_thread()
        self.on_poll()


class Canvas(RealScreen):
    """One that is drawn on in place, in a context made by whoever asks for it first."""

    _context: moderngl.Context | None = None

    @property
    def context(self) -> moderngl.Context:
        if self._context is None:
            self._context = create_context()
        return self._context

    def draw(self, render: Callable[[moderngl.Framebuffer], None]) -> int:
        columns, rows = self.size
        with self.context:
            texture = self.context.texture(self.size, 1)
            framebuffer = self.context.framebuffer([texture])
            render(framebuffer)
            image = np.frombuffer(framebuffer.read(components=1, alignment=1), np.uint8)
            framebuffer.release()
            texture.release()
        return self.show(image.reshape(rows, columns)[::-1])

    def close(self) -> None:
        super().close()
        if self._context is not None:
            self._context.release()
            self._context = None


class Eye:
    """A free-running camera. `before_read` may raise, or hang; `alter` makes of a frame what it likes."""

    def __init__(self, rig: Rig, display: Screen, clock: Clock) -> None:
        spec = rig.camera
        self.shape = (spec.rows, spec.columns)
        self.bits = spec.bits
        self.rate_hz, self.exposure_ns = spec.rate_hz, round(1e9 * spec.exposure_s)
        self.screen = display
        self.clock = clock
        self.number = 0
        self.reads = 0
        self.closed = False
        self.exposure_start_ns = self.clock.now_ns()
        u, v = np.meshgrid(np.arange(spec.columns), np.arange(spec.rows))
        self.rest_q = Optics(rig).rest_map(u.astype(float), v.astype(float))
        self.away_px: Any = 0.0
        self.light: Callable[[float], float] = lambda _time_s: 1.0
        self.rng = np.random.default_rng(1)
        self.before_read: Callable[[int], None] = lambda _reads: None
        self.alter: Callable[[Frame], Any] = lambda frame: frame

    def read(self, timeout_s: float) -> Any:
        self.reads += 1
        self.before_read(self.reads)
        frame_ns = 1e9 / self.rate_hz
        newest = (self.clock.now_ns() - self.exposure_ns - self.exposure_start_ns) / frame_ns
        number = max(self.number + 1, int(newest))
        start_ns = self.exposure_start_ns + round(number * frame_ns)
        self.clock.sleep_until_ns(start_ns + self.exposure_ns)
        dropped, self.number = number - self.number - 1, number
        middle_ns = start_ns + self.exposure_ns // 2
        return self.alter(Frame(self._exposed(start_ns), middle_ns, self.exposure_ns, number, dropped))

    def close(self) -> None:
        self.closed = True

    def _exposed(self, start_ns: int) -> np.ndarray:
        with self.screen.lock:
            pictures = list(self.screen.pictures)
        end_ns = start_ns + self.exposure_ns
        light = np.zeros(self.shape)
        for k, (time_ns, picture) in enumerate(pictures):
            until_ns = pictures[k + 1][0] if k + 1 < len(pictures) else end_ns
            lit_ns = min(until_ns, end_ns) - max(time_ns, start_ns)
            if lit_ns > 0:
                light += lit_ns / self.exposure_ns * self._reflected(picture)
        grey = BLACK + FULL * self.light(1e-9 * start_ns) * light
        return np.clip(np.rint(self.rng.normal(grey, NOISE_GREY)), 0, 255).astype(np.uint8)

    def _reflected(self, picture: np.ndarray) -> np.ndarray:
        """Picture, bilinear, where the mirror at rest sends each pixel, `away_px` further on."""
        q = self.rest_q + self.away_px
        seen = np.isfinite(q).all(axis=-1)
        light = map_coordinates(
            picture, np.where(seen, q[..., ::-1].transpose(2, 0, 1), 0.0), order=1, mode="nearest"
        )
        return np.where(seen, light, 0.0)


class RealEye(Eye):
    def __init__(self, rig: Rig, display: Screen) -> None:
        super().__init__(rig, display, HostClock())


def small_rig(camera: str = "live_devices:RealEye", display: str = "live_devices:RealScreen") -> Rig:
    """A rig of 160 x 128 camera px, with a coarse panel that changes at once, on these devices.

    No picture and no frame takes as long as its time-out, however busy the machine.
    """
    rig = binned(load_rig("simulated"), 8)
    values = rig.display.model_dump(exclude_unset=True)
    coarse = {"driver": display, "columns": 480, "rows": 270, "pitch_mm": 0.252, "scanout_s": 0.0}
    panel = DisplaySpec.model_validate(values | coarse | {"rise_s": 0.0, "fill_factor": (1.0, 1.0)})
    eye = rig.camera.model_copy(update={"driver": camera, "exposure_s": 0.004})
    control = rig.control.model_copy(update={"timeout_s": 30.0})
    known = GeometrySpec(known="exact")
    return rig.model_copy(update={"display": panel, "camera": eye, "control": control, "geometry": known})
