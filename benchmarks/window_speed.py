"""Cost of the LCD as a window: drawing and swapping at full size, and how well swaps keep the refreshes.

    python -m benchmarks.window_speed [--monitor 1] [--pictures 300]

Needs a screen. On software OpenGL the figures are the processor's, not a graphics card's.
"""

from __future__ import annotations

import argparse
import time

import moderngl
import numpy as np

from zeromethod.drivers.monitors import monitors
from zeromethod.drivers.window import WindowDisplay
from zeromethod.gl import renderer_name
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.warp.grid import NodeGrid

GRID = NodeGrid((1024, 1280))
HALF_FULL = (50, 95)
"""Percentiles that are told."""


def told(values: np.ndarray, unit: str) -> str:
    middle, high = np.percentile(values, HALF_FULL)
    return f"{middle:7.3f} median, {high:7.3f} at 95 %, {values.max():7.3f} worst, {unit}"


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("--monitor", type=int, default=0)
    options.add_argument("--pictures", type=int, default=300)
    given = options.parse_args()
    monitor = monitors()[given.monitor]
    size = monitor.columns, monitor.rows
    display = WindowDisplay(*size, monitor.refresh_hz or 60.0, given.monitor)
    u, v = GRID.mesh()
    rest = np.stack([u * size[0] / 1280, v * size[1] / 1024], axis=-1)
    with display.context:
        print(f"{monitor}; {renderer_name(display.context)}")
        renderer = PatternRenderer(display.context, GRID, rest, size, Target("cosines"), Response(2.2))
    drawing_ms, polls_ms, times_ns = [], [], []

    def render(framebuffer: moderngl.Framebuffer) -> None:
        begin = time.perf_counter()
        renderer.render(framebuffer, rest)
        display.context.finish()
        drawing_ms.append(1e3 * (time.perf_counter() - begin))

    for _ in range(given.pictures):
        times_ns.append(display.draw(render))
        begin = time.perf_counter()
        display.poll()
        polls_ms.append(1e3 * (time.perf_counter() - begin))
    swaps_ms = []
    with display.context:
        for _ in range(given.pictures):
            display.context.screen.clear()
            display.context.finish()
            begin = time.perf_counter()
            display._window.swap()
            display.context.finish()
            swaps_ms.append(1e3 * (time.perf_counter() - begin))
    print("drawing a warp ", told(np.array(drawing_ms), "ms"))
    print("a swap         ", told(np.array(swaps_ms), "ms"))
    print("a poll         ", told(np.array(polls_ms), "ms"))
    print("between swaps  ", told(np.diff(times_ns) * 1e-9 * display.refresh_hz, "periods"))
    print(f"missed refreshes {display.dropped_refreshes} of {given.pictures}")
    for warning in display.warnings:
        print(warning)
    display.close()


if __name__ == "__main__":
    main()
