"""A recording of planted surfaces: what an export must say is known in closed form."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from recorded_run import small_rig

from zeromethod import Optics, Recording, State, Step
from zeromethod.recording.recorder import Recorder
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Anchor, Peak, Surface
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Role, Warp

FIRST_NS = 5_000_000_000
STEP_NS = 20_000_000
DENT_MM = (42.0, 3.0)
WIDTH_MM = 6.0
DEEPEST_MM = 0.2
"""Of the last step; depth grows evenly from the second."""
SIGMA_MM = 1e-4


@dataclass(frozen=True)
class Planted:
    """steps: numbers. time_s: since the first. depth_mm: peak of each, NaN where nothing was read."""

    path: Path
    steps: np.ndarray
    time_s: np.ndarray
    depth_mm: np.ndarray
    image: np.ndarray

    def depth_at(self, step: int, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        away = (x_mm - DENT_MM[0]) ** 2 + (y_mm - DENT_MM[1]) ** 2
        return self.depth_mm[step - 1] * np.exp(-0.5 * away / WIDTH_MM**2)

    def slope_at(self, step: int, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        depth = self.depth_at(step, x_mm, y_mm)
        away = np.stack([x_mm - DENT_MM[0], y_mm - DENT_MM[1]], axis=-1)
        return -depth[..., None] * away / WIDTH_MM**2


HOLE = (slice(8, 11), slice(30, 34))
"""Nodes that could not be read, far from the dent's middle."""


def plant(path: Path, keep: tuple[str, ...] = ("frames", "residual", "warps", "surface")) -> Planted:
    """Step 1 without a frame, steps 2 to 9 a growing dent; between steps 6 and 7 three frames are missing."""
    rig = small_rig()
    optics = Optics(rig)
    rest = Rest.of(rig, optics)
    u, v = rest.grid.mesh()
    origin, direction = optics.rubber_rays(u, v)
    along = -origin[..., 2] / direction[..., 2]
    x, y = origin[..., 0] + along * direction[..., 0], origin[..., 1] + along * direction[..., 1]
    ticks = np.array([0, 1, 2, 3, 4, 5, 9, 10, 11])
    depths = np.array([np.nan, *np.linspace(0.025, DEEPEST_MM, 8)])
    image = np.arange(256 * 320, dtype=np.uint32).reshape(256, 320)
    planted = Planted(path, np.arange(1, 10), 1e-9 * STEP_NS * ticks, depths, (image % 151).astype(np.uint8))
    valid = np.zeros(x.shape, bool)
    valid[rest.grid.inner] = True
    valid[HOLE] = False
    contact = np.zeros(x.shape, bool)
    contact[HOLE] = True
    # What is rubber at rest does not matter here: the mirror is flat.
    with Recorder(path, rig, rest, keep=keep) as recorder:
        for number, tick in zip(planted.steps.tolist(), ticks, strict=True):
            time_ns = FIRST_NS + int(tick) * STEP_NS
            filtered = Warp(rest.q, np.ones_like(rest.q), rest.flags, time_ns)
            commanded = Warp.drawn(rest.q, Role.COMMANDED, time_ns)
            about = {"number": number, "time_ns": time_ns, "time_s": 0.0, "state": State.STARTING}
            step = Step(**about, commanded=commanded, filtered=filtered)
            if number == 1:
                recorder.add_step(step)
                continue
            residual = Residual.empty(rest.grid)
            residual.d[..., 0] = 0.02 * number
            residual.flags[rest.grid.inner] = 0
            step = replace(
                step,
                state=State.LOCKED,
                frame_number=number,
                exposure_ns=1_000_000,
                image=planted.image,
                residual=residual,
                measured=filtered,
                shown=Warp.drawn(rest.q, Role.SHOWN, time_ns),
                residual_rms_px=0.02 * number,
            )
            recorder.add_step(step)
            depth, slope = planted.depth_at(number, x, y), planted.slope_at(number, x, y)
            surface = Surface(
                np.where(valid, depth, np.nan),
                np.where(valid[..., None], slope, np.nan),
                x,
                y,
                np.where(valid, SIGMA_MM, np.nan),
                np.where(valid[..., None], 1e-5, np.nan) * np.ones(2),
                valid,
                contact,
                Anchor("loads", valid, 0.0),
                time_ns,
                3,
            )
            peak = Peak(float(depths[number - 1]), *DENT_MM, SIGMA_MM)
            recorder.add_reading(replace(step, surface=surface, peak=peak, read_ms=1.0))
    return planted


@pytest.fixture(scope="session")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Planted:
    return plant(tmp_path_factory.mktemp("planted") / "session.h5")


@pytest.fixture
def recording(planted: Planted):
    with Recording(planted.path) as opened:
        yield opened


@pytest.fixture(scope="session")
def with_only(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Make a recording of the planted surfaces that kept these alone."""
    return cache(lambda *keep: plant(tmp_path_factory.mktemp("part") / "session.h5", keep).path)
