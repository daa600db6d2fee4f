"""The procedure "from_warps": depth read again from recorded warps, with other settings of the rig."""

from __future__ import annotations

import warnings as raised
from pathlib import Path

import numpy as np

from zeromethod.errors import MeasurementError
from zeromethod.recording.recording import Recording
from zeromethod.recording.source import DamagedWarning
from zeromethod.session.replay.from_warps import Reader
from zeromethod.study.settings import with_settings
from zeromethod.study.task import Figures, Procedure, Task


def read_warps(task: Task) -> Figures:
    """Figures of one recording, every `every`-th of its measured warps read again.

    Raises InputError for a file that is no recording, DamagedWarning for one that is damaged,
    MeasurementError where it has no measured warp.
    """
    assert task.recording is not None
    path = Path(task.recording)
    with raised.catch_warnings(), Recording(path) as recording:
        raised.simplefilter("error", DamagedWarning)
        rig = with_settings(recording.rig, task.rig_settings, 1, path)
        reader = Reader(recording, rig, recording.grid)
        recorded = {int(row["step"]): float(row["depth_mm"]) for row in recording.peaks}
        depths, sigmas, differences, areas = [], [], [], []
        for row in recording.steps[:: int(task.settings["every"])]:
            number = int(row["number"])
            measured = recording.measured(number)
            if measured is None:
                continue
            surface, found = reader.read(number, measured)
            if not np.isfinite(found.depth_mm):
                continue
            depths.append(found.depth_mm)
            sigmas.append(found.sigma_mm)
            areas.append(float(surface.valid.mean()))
            if number in recorded:
                differences.append(1e3 * (found.depth_mm - recorded[number]))
        if not depths:
            raise MeasurementError(f"{path}: no measured warp that gives a depth")
        deepest = int(np.argmax(np.abs(depths)))
        return {
            "frames": len(depths),
            "seconds": float(recording.seconds),
            "deepest_mm": depths[deepest],
            "deepest_sigma_mm": sigmas[deepest],
            "depth_median_mm": float(np.median(depths)),
            "change_rms_um": float(np.sqrt(np.mean(np.square(differences)))) if differences else None,
            "valid_share": float(np.mean(areas)),
            "residual_px_rms": _median(recording.steps["residual_rms_px"]),
            "recorded_rig": recording.rig.name,
        }


def _median(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else None


FROM_WARPS = Procedure(
    read_warps,
    {
        "frames": "warps that were read",
        "seconds": "time that the recording spans, s",
        "deepest_mm": "peak of largest |depth| over all frames, mm (a bulge is negative)",
        "deepest_sigma_mm": "standard deviation stated for it, mm",
        "depth_median_mm": "peak's depth, median over the frames, mm",
        "change_rms_um": "peak's depth against the recorded one, rms over the frames, um",
        "valid_share": "share of the nodes that were read, mean over the frames",
        "residual_px_rms": "recorded residual, median over its steps, camera px",
        "recorded_rig": "name of the rig that was recorded",
    },
    {"every": 1},
    reads_recordings=True,
)
