"""Rigs and presses of the benchmarks, and how a run's frames are compared with the truth."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.salt import seed
from zeromethod.arrays import Float, Mask
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import TrueMirror
from zeromethod.loop.loop import Loop
from zeromethod.loop.step import Step
from zeromethod.optics import Dented, DepthField, Optics
from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.simulation.scenario import Scenario
from zeromethod.surface.comparison import TruthSource, usable_nodes

VIEW_MIDDLE_MM = 42.0
"""x of the mirror point in the middle of the packaged rig's view."""


def coarser(rig: Rig, factor: int) -> Rig:
    """The same bench with `factor` times larger pixels of camera and LCD: as many LCD px per camera px.

    It costs 1 / factor^2. The noise per pixel stays, so depth is noisier than at full size. Raises InputError
    where `factor` does not divide the camera's pixels.
    """
    display = rig.display
    larger = {
        "columns": display.columns // factor,
        "rows": display.rows // factor,
        "pitch_mm": display.pitch_mm * factor,
    }
    return binned(rig, factor).model_copy(update={"display": display.model_copy(update=larger)})


def small_rig(factor: int = 4) -> Rig:
    """The packaged rig with `factor` times larger pixels."""
    return changed(coarser(load_rig("simulated"), factor), simulation={"seed": seed(0)})


def changed(rig: Rig, **tables: dict[str, Any]) -> Rig:
    """Rig with some keys of its tables changed; values are checked as those of a rig file are."""
    update = {}
    for name, values in tables.items():
        table = getattr(rig, name)
        update[name] = type(table).model_validate({**table.model_dump(), **values})
    return rig.model_copy(update=update)


@contextmanager
def pressed(
    rig: Rig,
    path: list[tuple[float, float]],
    sigma_mm: float = 5.0,
    at_mm: tuple[float, float] = (VIEW_MIDDLE_MM, 0.0),
    shape: str = "load",
) -> Iterator[Rig]:
    """Rig under a load that follows (time s, depth mm) points; equal times are a jump.

    sigma_mm, shape: as `pressing` has them.
    """
    x_mm, y_mm = at_mm
    points = ",".join(f"{{time_s={t!r},x_mm={x_mm!r},y_mm={y_mm!r},depth_mm={depth!r}}}" for t, depth in path)
    text = f"[[press]]\n{pressing(sigma_mm, shape)}\npath=[{points}]\n"
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "press.toml"
        file.write_text(text)
        yield rig.model_copy(update={"scenario": str(file)})


def pressing(sigma_mm: float, shape: str = "load") -> str:
    """Shape and size of loads in a press file, or of "gaussian", the dent that is as curved in its middle."""
    if shape == "gaussian":
        return f'shape="gaussian"\nsigma_mm={sigma_mm!r}'
    return f'shape="{shape}"\nwidth_mm={sigma_mm / sqrt(2)!r}'


def step_path(time_s: float, depth_mm: float = 0.2) -> list[tuple[float, float]]:
    """Path of a sudden press that stays."""
    return [(time_s, 0.0), (time_s, depth_mm)]


@dataclass(frozen=True)
class Bench:
    """An opened bench: the loop, its optics, and the truth, which the loop does not have."""

    rig: Rig
    loop: Loop
    optics: Optics
    truth: TruthSource

    def usable(self, mirror: TrueMirror) -> Mask:
        """(rows, cols) nodes whose true ray is totally reflected and lands well inside the LCD."""
        return usable_nodes(self.optics, self.loop.grid, mirror)

    def true_warp(self, mirror: DepthField) -> Float:
        """(rows, cols, 2) LCD px where the nodes truly look."""
        return self.optics.trace(*self.loop.grid.mesh(), Dented(self.optics.rest, mirror)).q


@contextmanager
def opened(rig: Rig, true_rig: Rig | None = None, scenario: Scenario | None = None) -> Iterator[Bench]:
    """Open the rig's simulated devices for a loop over them; closed at the end.

    true_rig: what the bench truly is, where the rig that the loop has is wrong. scenario: in place of its.
    """
    optics = Optics(rig)
    with open_devices(true_rig or rig) as devices:
        camera: Any = devices.camera
        camera.scenario = scenario or camera.scenario
        reopen = devices.reopen_camera
        loop = Loop(rig, camera, devices.display, devices.clock, reopen_camera=reopen, optics=optics)
        # bound to the scenario, as the camera itself may be opened again
        yield Bench(rig, loop, optics, camera.scenario.mirror_at)


def usable_residual_px(step: Step, usable: Mask) -> tuple[float, float]:
    """(rms length of the residual over usable nodes called valid, camera px; their share of the usable)."""
    if step.residual is None:
        return float("nan"), 0.0
    good = usable & (step.residual.flags == 0)
    share = np.count_nonzero(good) / max(int(np.count_nonzero(usable)), 1)
    if not good.any():
        return float("nan"), 0.0
    return float(np.sqrt(np.mean(np.sum(step.residual.d[good] ** 2, axis=-1)))), share
