"""Play one scenario, and write everything that it says: python -m tools.golden.play NAME FILE.npz."""

from __future__ import annotations

import lzma
import os
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np

import zeromethod as zm
from tools.golden.table import Table, add, save
from zeromethod.light_array import recording as light_recording
from zeromethod.light_array.loop import LightLoop
from zeromethod.light_array.rig import LightArrayRig, load_light_array
from zeromethod.light_array.session import LightSession
from zeromethod.session.replay import differences, fine, from_frames

HERE = Path(__file__).parent
SCENARIOS: dict[str, dict[str, Any]] = tomllib.loads((HERE / "scenarios.toml").read_text(encoding="utf-8"))
PRESSES = SCENARIOS.pop("presses")
PRESS_FILE = "press.toml"


def rig_of(scenario: dict[str, Any]) -> zm.Rig:
    """The scenario's rig; raises InputError for values that it cannot have."""
    rig, lcd = zm.binned(zm.load_rig(scenario["rig"]), scenario.get("binned", 1)), scenario.get("lcd", 1)
    display = rig.display
    values = {
        "display.columns": display.columns // lcd,
        "display.rows": display.rows // lcd,
        "display.pitch_mm": display.pitch_mm * lcd,
    }
    press = {"scenario": PRESS_FILE} if "press" in scenario else {}
    return rig.replace(values | scenario.get("set", {}) | press)


def of_session(scenario: dict[str, Any]) -> Table:
    """Steps and summary of a run on the bench, in simulated time; its recording, where asked for."""
    table: Table = {}
    record = Path("run.h5") if scenario.get("record") else None
    with zm.Session(rig_of(scenario), fine=scenario.get("fine", False), record=record) as session:
        for frame, step in enumerate(session.run(frames=scenario.get("frames"))):
            add(table, frame, step)
        add(table, 0, session.loop.ended, "ended")
        add(table, 0, session.figures, "summary")
    if record is not None:
        with h5py.File(record) as file:
            for name, data in every_dataset(file):
                for row, value in enumerate(data if data.ndim else [data]):
                    add(table, row, value, f"file.{name.replace('/', '.')}")
    return table


def every_dataset(file: h5py.File) -> list[tuple[str, Any]]:
    """Names and contents of all datasets of a file."""
    found: list[tuple[str, Any]] = []
    file.visititems(
        lambda name, item: found.append((name, np.asarray(item[()]))) if hasattr(item, "dtype") else None
    )
    return found


def of_arrays(scenario: dict[str, Any]) -> Table:
    """Steps and summary of a run of LED and detector arrays."""
    table: Table = {}
    rig = load_light_array(scenario["rig"])
    assert rig is not None
    with LightSession(rig.changed(PRESS_FILE)) as session:
        for frame, step in enumerate(session.run(None, None)):
            add(table, frame, step)
        add(table, 0, session.figures, "summary")
    return table


def unpacked(name: str) -> Path:
    """A recording made by 0.2.0 (recorded/record.py), in the present folder."""
    path = Path(name).absolute()
    path.write_bytes(lzma.decompress((HERE / "recorded" / f"{name}.xz").read_bytes()))
    return path


@contextmanager
def heard(part: type[Any], table: Table, *names: str) -> Iterator[None]:
    """Within this context, what a replay hands to `part` to be compared is taken into the table by names."""
    own = part.add

    def told(self: Any, of: Any, *values: Any) -> None:
        frame = int(of if isinstance(of, int) else of["number"])
        for name, value in zip(names, values, strict=True):
            add(table, frame, value.commanded if hasattr(value, "commanded") else value, name)
        own(self, of, *values)

    with mock.patch.object(part, "add", told):
        yield


def of_recording(scenario: dict[str, Any]) -> Table:
    """Everything that the replays of a recording give: from its warps, and from its frames."""
    whole: Table = {}
    with zm.open_recording(unpacked(scenario["recording"])) as recording:
        for mode in ("from-warps", "from-frames"):
            table: Table = {}
            with (
                heard(differences.DepthDifferences, table, "surface", "peak"),
                heard(from_frames.WarpDifferences, table, "taken", "measured", "commanded"),
                heard(fine.FineDifferences, table, "fine"),
            ):
                add(table, 0, zm.replay(recording, mode), "figures")
            whole |= {f"{mode}.{name}": frames for name, frames in table.items()}
    return whole


def of_recorded_arrays(scenario: dict[str, Any]) -> Table:
    """Steps of the loop of arrays on recorded readings, and whether they are the recorded ones."""
    table: Table = {}
    path = unpacked(scenario["arrays"])
    with h5py.File(path, "r") as file:
        rig, readings = LightArrayRig.model_validate_json(file.attrs["rig"]), file["readings"][:]
    for frame, step in enumerate(LightLoop(rig, light_recording.PlayedArrays(readings)).run()):
        add(table, frame, step)
    add(table, 0, light_recording.replay(path), "figures")
    return table


def play(name: str) -> Table:
    """Everything that a scenario says, played in a folder of its own."""
    scenario = SCENARIOS[name]
    zm.limit_threads()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        if "press" in scenario:
            Path(PRESS_FILE).write_text(PRESSES[scenario["press"]], encoding="utf-8")
        if "recording" in scenario:
            return of_recording(scenario)
        if "arrays" in scenario:
            return of_recorded_arrays(scenario)
        return of_arrays(scenario) if scenario["rig"] == "leds" else of_session(scenario)


if __name__ == "__main__":
    to = Path(sys.argv[2]).resolve()  # before the folder is another
    save(play(sys.argv[1]), to)
