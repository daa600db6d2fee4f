"""Made-up steps of a loop: noise everywhere, so that nothing is mistaken for anything else."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from recorded_run import small_rig

from zeromethod import Optics, Rig, State, Step
from zeromethod.fine.lattice import pixel_box
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.drawing import Drawn
from zeromethod.recording.recorder import Recorder
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Anchor, Peak, Surface
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Role, Warp

FRAME_NS = 16_666_667


@cache
def bench() -> tuple[Rig, Rest]:
    rig = small_rig()
    return rig, Rest.of(rig, Optics(rig))


def recorder(path: Path, **more: Any) -> Recorder:
    rig, rest = bench()
    return Recorder(path, rig, rest, **more)


def a_step(number: int, **more: Any) -> Step:
    """Step `number`, all of whose arrays are its own."""
    rig, rest = bench()
    rng = np.random.default_rng(number)
    nodes = rest.grid.shape
    q = rest.q + rng.standard_normal(rest.q.shape)
    sigma = rng.uniform(0.01, 0.02, q.shape)
    time_ns = number * FRAME_NS
    measured = Warp(q, sigma, rng.integers(0, 1024, nodes, dtype=np.uint16), time_ns)
    residual = Residual(
        0.1 * rng.standard_normal(q.shape),
        sigma,
        measured.flags,
        np.ones(q.shape, np.float32),
        rng.uniform(0, 255, nodes).astype(np.float32),
    )
    values: dict[str, Any] = {
        "state": State.LOCKED,
        "reason": "nulled",
        "events": (),
        "time_s": 1e-9 * time_ns,
        "commanded": Warp.drawn(q + 0.25, Role.COMMANDED, time_ns),
        "filtered": measured,
        "frame_number": number + 1000,
        "exposure_ns": 8_000_000,
        "sensed": True,
        "presented": (Drawn(time_ns - 5, q + 0.5, time_ns - FRAME_NS, number % 16, 1.5),),
        "presented_before": 1,
        "image": rng.integers(0, 256, (rig.camera.rows, rig.camera.columns), dtype=np.uint8),
        "residual": residual,
        "shown": Warp.drawn(q + 0.75, Role.SHOWN, time_ns),
        "measured": measured,
        "residual_rms_px": 0.01,
        "valid_share": 1.0,
    }
    return Step(number=number, time_ns=time_ns, **(values | more))


def reading(number: int) -> tuple[Surface, Peak]:
    """A surface read from step `number`."""
    _, rest = bench()
    rng = np.random.default_rng(number)
    one = [rng.standard_normal(rest.grid.shape) for _ in range(4)]
    two = [rng.standard_normal(rest.q.shape) for _ in range(2)]
    masks = [rng.random(rest.grid.shape) < 0.5 for _ in range(3)]
    anchor = Anchor("known", masks[0], 1e-4, 2e-4)
    surface = Surface(
        one[0], two[0], one[1], one[2], one[3], two[1], masks[1], masks[2], anchor, number * FRAME_NS, 5
    )
    j, i = np.unravel_index(np.argmax(np.where(masks[1], np.abs(one[0]), 0.0)), masks[1].shape)
    return surface, Peak(float(one[0][j, i]), float(one[1][j, i]), float(one[2][j, i]), 1e-4)


def read(step: Step) -> Step:
    """The step with its reading."""
    surface, peak = reading(step.number)
    return replace(step, surface=surface, peak=peak, read_ms=1.0)


def fine_shape() -> tuple[int, int]:
    """Pixels of a fine surface."""
    rows, cols = pixel_box(bench()[1].grid)
    return rows.stop - rows.start, cols.stop - cols.start


def read_fine(step: Step) -> Step:
    """The step with a fine surface."""
    shape, grid = fine_shape(), bench()[1].grid
    rng = np.random.default_rng(step.number)
    depth, x, y, sigma, share = rng.random((5, *shape)).astype(np.float32)
    slope, sigma_slope = rng.random((2, *shape, 2)).astype(np.float32)
    valid, coarse = np.ones(shape, bool), reading(step.number)[0]
    first = pixel_box(grid)[0].start, pixel_box(grid)[1].start
    surface = FineSurface(
        depth, slope, x, y, sigma, sigma_slope, valid, share, first, step.time_ns, 24, coarse
    )
    return replace(step, fine=replace(surface, spacing_px=grid.spacing_px))


@dataclass
class Bytes:
    """Sizes, for tests that fill memory or disks."""

    step: int
    image: int


def sizes() -> Bytes:
    rig, rest = bench()
    image = rig.camera.rows * rig.camera.columns
    return Bytes(image + rest.q.size * (8 + 8 + 8 + 4 + 4 + 4 + 4) + rest.flags.size * (2 + 2 + 4), image)
