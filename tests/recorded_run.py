"""A short real recording of a simulated run."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
from small_rigs import with_tables

from benchmarks.against_peers.open_loop import coarser
from zeromethod import Loop, Optics, Peak, Rig, Step, Surface, SurfaceReader, load_rig, open_devices, peak
from zeromethod.devices.abilities import script_of
from zeromethod.recording.checksums import canonical, checksum_of, checksums_of
from zeromethod.recording.columns import TABLES
from zeromethod.recording.recorder import Recorder
from zeromethod.recording.schema import KEEP
from zeromethod.session.dirt import DirtCorrection
from zeromethod.session.zero_doubt import ZeroDoubt


def small_rig(press: str = "step", seed: int = 0, factor: int = 4) -> Rig:
    """The packaged bench with pixels of camera and LCD `factor` times as large."""
    return with_tables(coarser(load_rig("simulated"), factor), scenario=press, simulation={"seed": seed})


def sum_again(file: h5py.File) -> None:
    """Let changed tables and attributes pass for what was written; arrays keep their checksums."""
    for name in TABLES:
        if f"{name}/checksums" in file:
            rows, sums = file[f"{name}/table"][()], file[f"{name}/checksums"]
            sums.resize(len(rows), axis=0)
            sums[...] = checksums_of(rows).astype(sums.dtype)
    file.attrs["checksum"] = np.uint64(checksum_of(canonical(file.attrs)))


def recorded(
    path: Path,
    seconds: float = 0.5,
    *,
    rig: Rig | None = None,
    keep: Sequence[str] = KEEP,
    every: int = 1,
    compress: bool = False,
    on_step: Callable[[Loop, Step], None] | None = None,
    on_reading: Callable[[Step, Surface, Peak], None] | None = None,
) -> Path:
    """Record a simulated run in `path`; every measured step is read. Returns `path`.

    rig: `small_rig()` without. on_step: called after every step, on_reading: after every reading.
    """
    rig = rig or small_rig()
    optics = Optics(rig)
    with open_devices(rig) as devices:
        scenario = script_of(devices.camera)
        loop = Loop(
            rig,
            devices.camera,
            devices.display,
            devices.clock,
            reopen_camera=devices.reopen_camera,
            optics=optics,
        )
        reader, dirt = SurfaceReader(rig, optics, loop.grid), DirtCorrection(loop.q_rest)
        doubt = ZeroDoubt(rig, loop.rest)
        with Recorder(
            path,
            rig,
            loop.rest,
            keep=keep,
            every=every,
            compress=compress,
            command_line="zeromethod run --record",
            gl_renderer=loop.gl_renderer,
        ) as recorder:
            for step in loop.run(seconds=seconds):
                phase = (scenario.phase_at(step.time_ns) if scenario is not None else None) or ""
                recorder.add_step(replace(step, phase=phase))
                if on_step is not None:
                    on_step(loop, step)
                if step.measured is not None:
                    surface = reader.follow(
                        dirt.corrected(doubt.stated(step.measured, step.zero), step.state, step.zero)
                    )
                    deepest = peak(surface)
                    recorder.add_reading(replace(step, surface=surface, peak=deepest, read_ms=0.0))
                    if on_reading is not None:
                        on_reading(step, surface, deepest)
            if loop.ended is not None:
                recorder.add_step(loop.ended)
    return path
