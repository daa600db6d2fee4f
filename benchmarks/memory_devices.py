"""Devices of memory for timing the loop: frames rendered beforehand, pictures taken at once.

The mirror is at rest, pressed or the press slides, in `STATES` steps. A frame of the simulated bench is drawn
beforehand for every state that the camera may see while another one is shown, so that the loop stays closed:
a frame shows what the newest pictures have not followed yet. The strips of a frame hold the codes of the
pictures that its exposure saw, by the panel's own timing. So a frame costs the camera less than a millisecond
and the time that is left is the loop's.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from benchmarks.pads import pad
from zeromethod.arrays import Float, Mask
from zeromethod.clock import Clock, HostClock
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import PanelTiming, entry_weights
from zeromethod.exposure.strip_reading import find_strips
from zeromethod.gl import create_context
from zeromethod.optics import Dented, Optics
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.pattern.coded import Coded
from zeromethod.pattern.strips import CODES
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Piece
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

DEPTHS_MM = (0.0, 0.05, 0.1, 0.15, 0.2)
SLIDE_MM = (0.75, 1.5, 2.25, 3.0)
STATES = len(DEPTHS_MM) + len(SLIDE_MM)
AT_MM, SIGMA_MM = 42.0, 5.0

PATH = np.repeat(
    [0, 1, 2, 3, 4, 5, 6, 7, 8, 7, 6, 5, 4, 3, 2, 1, 0],
    [24, 12, 12, 12, 24, 12, 12, 12, 12, 12, 12, 12, 12, 12, 12, 12, 16],
)
"""State of the mirror, frame by frame: untouched, pressed, held, slid and back, lifted.

It moves in steps that the loop has time to null: pictures that are not would be held longer in the live loop.
"""

REACH = 2
"""Most states between mirror and picture; more is cut off, and caught up by later frames."""

SEEN_NODES = 8
"""Every so many-th node shows which state a picture was drawn for."""

SETTLED_S = 0.002
"""Waited really where time is skipped, so that a picture that was asked for comes before and not after."""

PICTURES = 8
"""Pictures that one exposure may span."""


def _mirror(state: int) -> Mirror:
    depth_mm = DEPTHS_MM[min(state, len(DEPTHS_MM) - 1)]
    away_mm = (0.0, *SLIDE_MM)[max(0, state - len(DEPTHS_MM) + 1)]
    return Mirror((pad(AT_MM + away_mm, 0.0, depth_mm, SIGMA_MM),))


class Prepared:
    """Frames of one rig, for as many loops as are wanted, one after the other."""

    def __init__(self, rig: Rig) -> None:
        """Draw everything: a second or ten."""
        self.rig = rig
        self.optics = Optics(rig)
        self.timing = PanelTiming.of(rig.display)
        rest = Rest.of(rig, self.optics)
        self.strips = find_strips(rig, rest)
        if self.strips is not None and not self.strips.along_u:
            raise ValueError("strips at the left and right edges are not prepared")
        self._warps = warps = [self._warp(rest, state) for state in range(STATES)]
        self._nodes = np.stack([self.sampled(q) for q in warps])
        rng = np.random.default_rng(rig.simulation.seed)
        self._normal = rng.standard_normal((rig.camera.rows, rig.camera.columns), np.float32)
        self._draw(rest, warps)

    def sampled(self, q: Float) -> Float:
        """Some nodes of a warp."""
        return np.ascontiguousarray(q[::SEEN_NODES, ::SEEN_NODES])

    def state_of(self, nodes: Float) -> int:
        """State whose warp is nearest."""
        return int(np.argmin(((self._nodes - nodes) ** 2).sum(axis=(1, 2, 3))))

    def with_residual(self, measured: Warp, shown: Warp, frame_number: int) -> Warp:
        """A measured warp with the residual of the state that was seen, which its frame did not show.

        A frame of the state that its picture was drawn for shows none, although the loop's warp is off by a
        hundredth of the dent, as it was sensed in one step. A real camera would show that.
        """
        seen = int(PATH[frame_number % len(PATH)])
        if self.state_of(self.sampled(shown.q)) != seen:
            return measured
        return replace(measured, q=measured.q + (self._warps[seen] - shown.q))

    def grey(self, light: NDArray[np.float32], rows: slice, sign: int) -> NDArray[Any]:
        """Grey levels under light of some rows; noise `sign` times the same: two frames' errors cancel."""
        camera, noise = self.rig.camera, self.rig.camera.noise
        full = 2**camera.bits - 1
        signal = (self.rig.simulation.peak_grey_share * full - noise.black_grey) * light
        shot = signal / noise.electrons_per_grey if noise.electrons_per_grey else 0.0
        spread = np.sqrt(noise.read_grey**2 + shot)
        values = np.rint(noise.black_grey + signal + sign * spread * self._normal[rows])
        grey: NDArray[Any] = np.clip(values, 0, full).astype(np.uint8 if camera.bits == 8 else np.uint16)
        return grey

    def _warp(self, rest: Rest, state: int) -> Float:
        q = self.optics.trace(*rest.grid.mesh(), Dented(self.optics.rest, _mirror(state))).q
        return np.where(np.isfinite(q), q, rest.q)

    def _draw(self, rest: Rest, warps: list[Float]) -> None:
        """Fill `images`, two for every pair of states seen and shown, and the strips' light by code."""
        rig = self.rig
        bench = GpuRenderer(rig)
        lit = np.ones(rig.display.rows, np.float32)
        with bench.context:
            renderer = PatternRenderer(
                bench.context,
                rest.grid,
                rest.q,
                rest.display_size,
                Target.from_spec(rig.target),
                Response.from_rig(rig.display),
                self.strips,
            )

            def light(seen: int, shown: int, code: int | None = None) -> NDArray[np.float32]:
                picture = bench.upload(renderer.image(warps[shown], code))
                exposed = bench.expose([Piece(1.0, _mirror(seen), [(picture, lit)])]).copy()
                bench.release(picture)
                return exposed

            self.images: dict[tuple[int, int], tuple[NDArray[Any], ...]] = {}
            for seen in range(STATES):
                for shown in range(max(0, seen - REACH), min(STATES, seen + REACH + 1)):
                    lit_so = light(seen, shown)
                    self.images[seen, shown] = tuple(self.grey(lit_so, slice(None), sign) for sign in (1, -1))
            self.strip_light: list[tuple[slice, NDArray[np.float32], NDArray[np.intp]]] = []
            if self.strips is not None:
                whole = [light(0, 0, code) for code in range(CODES)]
                rows = rig.camera.rows
                first = slice(0, math.ceil(self.strips.first.edge_px))
                last = slice(math.ceil(self.strips.last.edge_px), rows)
                for at, strip in ((first, self.strips.first), (last, self.strips.last)):
                    middle = rest.grid.v_px.searchsorted(0.5 * sum(strip.read_px))
                    columns = np.interp(np.arange(rig.camera.columns), rest.grid.u_px, rest.q[middle, :, 1])
                    panel_rows = np.rint(np.clip(columns, 0, rig.display.rows - 1)).astype(np.intp)
                    self.strip_light.append((at, np.stack([one[at] for one in whole]), panel_rows))
            self.plain = {
                states: [[image[at].copy() for at, _, _ in self.strip_light] for image in images]
                for states, images in self.images.items()
            }
            """The same rows without codes: strips are put into the images themselves."""
        bench.close()


@dataclass(slots=True)
class Picture:
    """One that was shown. nodes: some of its warp. state: nearest one, when it was looked up."""

    nodes: Float
    code: int | None
    time_ns: int
    state: int | None = None


def fingerprint(q: Float) -> float:
    """A number that differs between warps."""
    return float(q[q.shape[0] // 2, q.shape[1] // 2].sum())


class Noted:
    """In place of the renderer: only notes the warp. Drawing by a graphics card costs as little."""

    def __init__(self, *_: object) -> None:
        pass

    def render(
        self,
        display: MemoryDisplay,
        q: Float,
        code: int | None = None,
        coded: Coded | None = None,
        lamp: Mask | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Take the picture."""
        del coded, lamp, shift  # only the command is looked at
        display.noted = q, code


class Drawn(PatternRenderer):
    """Draws as well."""

    def render(
        self,
        display: Any,
        q: Float,
        code: int | None = None,
        coded: Coded | None = None,
        lamp: Mask | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Draw the picture."""
        display.noted = q, code
        super().render(display.framebuffer, q, code, coded, lamp, shift)


class FastClock:
    """The host's time, but what is waited for comes at once. No `HostClock`: the loop does all in turn."""

    def __init__(self, waits: bool) -> None:
        self.waits = waits
        # (when it stood still, None: it goes; skipped), one value: threads see both of one moment
        self._state: tuple[int | None, int] = None, 0

    def now_ns(self) -> int:
        """Time with all that was skipped, ns."""
        stood_ns, skipped_ns = self._state
        return (time.monotonic_ns() if stood_ns is None else stood_ns) + skipped_ns

    def stand_still(self) -> None:
        """Let no time pass until `go_on`."""
        self._state = time.monotonic_ns(), self._state[1]

    def go_on(self) -> None:
        """Go on from where it stood."""
        stood_ns, skipped_ns = self._state
        if stood_ns is not None:
            self._state = None, skipped_ns - (time.monotonic_ns() - stood_ns)

    def sleep_until_ns(self, time_ns: int) -> None:
        """Skip to `time_ns`, or sleep."""
        left_ns = max(0, time_ns - self.now_ns())
        if self.waits:
            time.sleep(1e-9 * left_ns)
        elif left_ns:
            time.sleep(SETTLED_S)  # what other threads are about to do they have done by then
            self._state = None, self._state[1] + max(0, time_ns - self.now_ns())


class FastLiveClock(FastClock, HostClock):
    """The same for a live loop."""


class _NoContext:
    info: ClassVar = {"GL_RENDERER": "nothing is drawn"}


class MemoryDisplay:
    """Takes every picture at once. drawn: by software where there is no graphics card, into memory."""

    def __init__(self, prepared: Prepared, drawn: bool, clock: Clock) -> None:
        self._prepared = prepared
        self._drawn = drawn
        self._clock = clock
        display = prepared.rig.display
        self.size = display.columns, display.rows
        self.refresh_hz = display.refresh_hz
        self.noted: tuple[Float, int | None] | None = None
        self.newest: deque[Picture] = deque(maxlen=PICTURES)
        self.began_s: dict[float, float] = {}
        """When the drawing of a warp began, by the performance counter; by `fingerprint`."""
        self.busy_s = self.cpu_s = 0.0

    @cached_property
    def context(self) -> Any:
        """Made in the thread that draws."""
        return create_context() if self._drawn else _NoContext()

    @cached_property
    def framebuffer(self) -> moderngl.Framebuffer:
        """What is drawn into."""
        framebuffer: moderngl.Framebuffer = self.context.framebuffer([self.context.texture(self.size, 4)])
        return framebuffer

    def draw(self, render: Callable[[Any], None]) -> int:
        """Take a picture; its presentation is now."""
        began_s, cpu_s = time.perf_counter(), time.thread_time()
        if self._drawn:
            with self.context:
                render(self)
                self.context.finish()
        else:
            render(self)
        assert self.noted is not None
        q, code = self.noted
        time_ns = self._clock.now_ns()
        self.newest.append(Picture(self._prepared.sampled(q), code, time_ns))
        self.began_s.setdefault(fingerprint(q), began_s)
        self.busy_s += time.perf_counter() - began_s
        self.cpu_s += time.thread_time() - cpu_s
        return time_ns

    def show(self, image: NDArray[np.uint8]) -> int:
        """Not of use: pictures are drawn."""
        raise NotImplementedError

    def close(self) -> None:
        """Nothing is open."""


class MemoryCamera:
    """Hands out prepared frames at the rig's rate by the clock, which may be one that nobody waits for."""

    def __init__(self, prepared: Prepared, display: MemoryDisplay, clock: FastClock) -> None:
        self._prepared = prepared
        self._display = display
        self._clock = clock
        camera = prepared.rig.camera
        self.shape, self.bits = (camera.rows, camera.columns), camera.bits
        self._exposure_ns = round(1e9 * camera.exposure_s)
        self._after_ns = self._exposure_ns + round(1e9 * prepared.rig.simulation.camera_latency_s)
        self._period_ns = round(1e9 / camera.rate_hz)
        self._begin_ns: int | None = None
        self._number = -1
        self._sign = 0
        self.given_s: dict[int, float] = {}
        """When each frame was handed over, by the performance counter."""
        self.cpu_s = 0.0

    def read(self, timeout_s: float) -> Frame:  # noqa: ARG002 - frames always come
        """Newest frame."""
        due_ns = self._clock.now_ns() - self._after_ns
        steps = 1 if self._begin_ns is None else max(1, (due_ns - self._begin_ns) // self._period_ns)
        begin_ns = due_ns if self._begin_ns is None else self._begin_ns + steps * self._period_ns
        if not self._clock.waits:
            # no frame is left out: the one after a slow turn is exposed later
            steps, begin_ns = 1, max(begin_ns, due_ns)
        self._number += steps
        self._begin_ns = begin_ns
        self._clock.sleep_until_ns(begin_ns + self._after_ns)
        began_s = time.thread_time()
        middle_ns = begin_ns + self._exposure_ns // 2
        frame = Frame(self._image(middle_ns), middle_ns, self._exposure_ns, self._number, steps - 1)
        self.cpu_s += time.thread_time() - began_s
        self.given_s[self._number] = time.perf_counter()
        return frame

    def close(self) -> None:
        """Nothing is open."""

    def _image(self, middle_ns: int) -> NDArray[Any]:
        prepared = self._prepared
        seen = int(PATH[self._number % len(PATH)])
        pictures = list(self._display.newest)
        number = self._sign = 1 - self._sign
        if not pictures:
            return prepared.images[seen, seen][number]
        times_ns = np.array([picture.time_ns for picture in pictures])
        exposed = Frame(np.empty(0), middle_ns, self._exposure_ns, self._number)
        weights, _ = entry_weights(times_ns, False, exposed, prepared.timing)
        for picture in pictures:
            if picture.state is None:
                picture.state = prepared.state_of(picture.nodes)
        shown = round(float(weights.mean(axis=1) @ np.array([picture.state for picture in pictures])))
        pair = seen, min(max(shown, seen - REACH), seen + REACH)
        image = prepared.images[pair][number]
        coded = pictures[-1].code is not None
        for (rows, light, panel_rows), plain in zip(
            prepared.strip_light, prepared.plain[pair][number], strict=True
        ):
            if not coded:
                image[rows] = plain
                continue
            place = (panel_rows * (weights.shape[1] - 1)) // (prepared.rig.display.rows - 1)
            at = weights[:, place].astype(np.float32)
            lit = sum(
                w * light[picture.code or 0] for w, picture in zip(at, pictures, strict=True) if w.any()
            )
            image[rows] = prepared.grey(lit, rows, 1 if number == 0 else -1)
        return image
