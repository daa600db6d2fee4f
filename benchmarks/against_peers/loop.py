"""The whole loop on the simulated bench: frame in hand to command, drawing, reading; noise of the depth.

The run is the one of `zeromethod run`: untouched, then a sudden press of 0.2 mm held. DIS fast reads the
same frames in turn with the loop, on the same thread; and the same warps are read from rest ("read_cold"), as
the run's own readings start from the ones before. Drawing is that of the machine's OpenGL, which may be
software; simulating the bench itself is in no figure.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.against_peers.methods import dis_solver
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import Frame
from zeromethod.optics import Optics
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.session.reading import timed
from zeromethod.session.session import Session
from zeromethod.session.speed import percentiles
from zeromethod.session.summary import summarise
from zeromethod.surface import Peak, Surface, SurfaceReader, peak
from zeromethod.warp.warp import Warp

Figures = dict[str, Any]
OnStep = Callable[[str], None]

PRESS = "step"
WARM_UP_FRAMES = 5


def steps(quick: bool) -> int:
    """How often `measure` reports a step."""
    return 1 + _frames(quick)


def _frames(quick: bool) -> int:
    """Of the press's 60 frames; untouched are the first 12."""
    return 30 if quick else 60


class _Watched:
    """A camera that keeps the frame it last gave; all else is the camera's own."""

    def __init__(self, camera: Any) -> None:
        self._camera = camera
        self.image: NDArray[Any] | None = None

    def read(self, timeout_s: float) -> Frame:
        frame: Frame = self._camera.read(timeout_s)
        self.image = frame.image
        return frame

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)


def _reading_ms(reader: SurfaceReader, warp: Warp) -> float:
    """Time of a reading from rest, with its peak."""

    def read() -> tuple[Surface, Peak]:
        surface = reader.read(warp)
        return surface, peak(surface)

    return timed(read)[2]


def measure(figures: Figures, on_step: OnStep, quick: bool) -> None:
    """Fill `figures`: ms with percentiles, frames per second, depth noise; errors against the truth."""
    given = load_rig("simulated").replace({"geometry.known": "exact"}, scenario=PRESS)
    rig = binned(given, 2 if quick else 1)
    flow = dis_solver("FAST")
    dis_ms: list[float] = []
    cold_ms: list[float] = []
    with open_devices(rig) as devices:
        camera = _Watched(devices.camera)
        devices.camera = camera
        session = Session(rig, devices=devices)
        on_step("loop")
        cold = SurfaceReader(rig, Optics(rig), session.loop.grid)
        before = None
        result = session.result
        try:
            for record in session.run(frames=_frames(quick)):
                image = camera.image
                if before is not None and image is not None and record.number > WARM_UP_FRAMES:
                    started = time.perf_counter()
                    flow(before, image)
                    dis_ms.append(1e3 * (time.perf_counter() - started))
                if record.measured is not None and record.number > WARM_UP_FRAMES:
                    cold_ms.append(_reading_ms(cold, record.measured))
                before = image
                on_step("loop")
        except KeyboardInterrupt:
            result.interrupted = True
    figures.update(
        frame_px=[rig.camera.columns, rig.camera.rows], press=PRESS, gl_renderer=result.gl_renderer
    )
    records = [r for r in result.records if r.number > WARM_UP_FRAMES and np.isfinite(r.read_ms)]
    figures["frames"] = len(records)
    figures["loop"] = percentiles(r.loop_ms for r in records)
    figures["draw"] = percentiles(r.draw_ms for r in records)
    figures["read"] = percentiles(r.read_ms for r in records)
    figures["read_cold"] = percentiles(cold_ms)
    figures["loop_and_draw"] = percentiles(r.loop_ms + r.draw_ms for r in records)
    figures["dis_fast"] = percentiles(dis_ms)
    for name in ("loop", "loop_and_draw"):
        # the rate that a frame of this percentile would allow
        figures[f"{name}_fps"] = {key: 1e3 / ms for key, ms in figures[name].items() if ms}
    for name in ("loop", "read", "read_cold"):
        if dis_ms and figures[name]["median"]:
            figures[f"{name}_of_dis_fast"] = figures[name]["median"] / figures["dis_fast"]["median"]
    summary = summarise(result)
    figures["depth_noise"] = summary["untouched"]
    figures["truth"] = summary["truth"]
    if result.interrupted:
        raise KeyboardInterrupt
