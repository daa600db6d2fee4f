"""Cost of the LCD as a window: drawing and swapping at full size, and how well swaps keep the refreshes.

Needs a screen. On software OpenGL the figures are the processor's, not a graphics card's.
"""

from __future__ import annotations

import time

import click
import moderngl
import numpy as np

from benchmarks.report import start
from zeromethod.cli.numbers import Whole
from zeromethod.drivers.monitors import monitors
from zeromethod.drivers.window import WindowDisplay
from zeromethod.errors import InputError
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.warp.grid import NodeGrid

GRID = NodeGrid((1024, 1280))


def spread(values: np.ndarray, unit: str) -> str:
    middle, high = np.percentile(values, (50, 95))
    return f"{middle:7.3f} median, {high:7.3f} at 95 %, {values.max():7.3f} worst, {unit}"


@click.command("window_speed", help=__doc__, epilog="Example: python -m benchmarks.window_speed --monitor 1")
@click.option("--monitor", "index", type=Whole(min=0), default=0, show_default=True, help="See `devices`.")
@click.option("--pictures", type=Whole(min=2), default=300, show_default=True, help="How many to draw.")
def command(index: int, pictures: int) -> None:
    known = monitors()
    if index not in range(len(known)):
        raise InputError(f"--monitor: {index}: no such monitor; allowed: {', '.join(map(str, known))}")
    monitor = known[index]
    size = monitor.columns, monitor.rows
    display = WindowDisplay(*size, monitor.refresh_hz or 60.0, index)
    u, v = GRID.mesh()
    rest = np.stack([u * size[0] / 1280, v * size[1] / 1024], axis=-1)
    with display.context:
        print(f"{monitor}; {display.context.info['GL_RENDERER']}")
        renderer = PatternRenderer(display.context, GRID, rest, size, Target("cosines"), Response(2.2))
    drawing_ms, polls_ms, times_ns = [], [], []

    def render(framebuffer: moderngl.Framebuffer) -> None:
        begin = time.perf_counter()
        renderer.render(framebuffer, rest)
        display.context.finish()
        drawing_ms.append(1e3 * (time.perf_counter() - begin))

    for _ in range(pictures):
        times_ns.append(display.draw(render))
        begin = time.perf_counter()
        display.poll()
        polls_ms.append(1e3 * (time.perf_counter() - begin))
    swaps_ms = []
    with display.context:
        for _ in range(pictures):
            display.context.screen.clear()
            display.context.finish()
            begin = time.perf_counter()
            display._window.swap()
            display.context.finish()
            swaps_ms.append(1e3 * (time.perf_counter() - begin))
    print("drawing a warp ", spread(np.array(drawing_ms), "ms"))
    print("a swap         ", spread(np.array(swaps_ms), "ms"))
    print("a poll         ", spread(np.array(polls_ms), "ms"))
    print("between swaps  ", spread(np.diff(times_ns) * 1e-9 * display.refresh_hz, "periods"))
    print(f"missed refreshes {display.dropped_refreshes} of {pictures}")
    for warning in display.warnings:
        print(warning)
    display.close()


if __name__ == "__main__":
    start(command)
