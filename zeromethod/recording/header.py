"""What a recording says about itself: rig, rest, versions, how it was made."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomlkit

from zeromethod.arrays import Image
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

LIBRARIES = ("numpy", "scipy", "numba", "h5py", "moderngl", "opencv-contrib-python-headless")


def about(
    rig: Rig,
    *,
    keep: Sequence[str],
    every: int,
    command_line: str,
    live: bool,
    gl_renderer: str,
    calibration: str,
    compressed: bool,
) -> dict[str, Any]:
    """Attributes of the file's root."""
    versions = {name: version(name) for name in LIBRARIES}
    versions |= {"python": platform.python_version(), "platform": platform.platform()}
    versions["hdf5"] = h5py.version.hdf5_version
    return {
        "zeromethod_version": version("zeromethod"),
        "versions": json.dumps(versions),
        "command_line": command_line,
        "started_utc": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "seed": rig.simulation.seed,
        "live": live,
        "keep": list(keep),
        "every": every,
        "gl_renderer": gl_renderer,
        "rig": rig_text(rig)[0],
        "calibration": calibration,
        "compressed": compressed,
    }


def rig_text(rig: Rig) -> tuple[str, dict[str, bytes]]:
    """Rig as TOML with all its values, and the files that it names, by the names that it then has for them.

    A rest map is left out: what came of it is in the file's `rest`.
    """
    data = rig.model_dump(mode="json", exclude_none=True)
    data["camera"].pop("rest_map", None)
    files: dict[str, bytes] = {}
    if rig.prism.rest.file is not None:
        data["prism"]["rest"]["file"] = "rest.npy"
        files["rest.npy"] = rig.prism.rest.file.read_bytes()
    if rig.scenario.endswith(".toml"):
        data["scenario"] = "press.toml"
        files["press.toml"] = Path(rig.scenario).read_bytes()
    return tomlkit.dumps(data), files


def rest_arrays(rest: Rest) -> dict[str, tuple[Image, str, str]]:
    """The warp at rest with its units and meaning."""
    return {
        "q": (rest.q, "LCD px", "warp of the untouched mirror: (column, row) on the LCD per camera node"),
        "flags": (rest.flags, "", "why a node sees nothing at rest: bits named in the attribute `flags`"),
        "seen": (rest.seen, "", "nodes that are measurable at rest"),
        "pixels": (
            np.stack(rest.grid.mesh(), axis=-1),
            "camera px",
            "(u, v) of every node; where rest was measured, those of the ideal camera that has its ray",
        ),
        "nodes_u": (rest.grid.u_px, "camera px", "column of every node in the image"),
        "nodes_v": (rest.grid.v_px, "camera px", "row of every node in the image"),
    }
