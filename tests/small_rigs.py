"""The packaged bench with fewer pixels of camera and LCD, as values of a rig file: quick to simulate."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod import binned, load_rig
from zeromethod.resources import resource
from zeromethod.rig.model import Layer, Rig
from zeromethod.rig.save import save_values

BENCH_320: Mapping[str, Any] = {
    "camera.columns": 320,
    "camera.rows": 256,
    "camera.focal_px": [2250.0, 2250.0],
    "camera.centre_px": [159.5, 127.5],
    "display.columns": 480,
    "display.rows": 270,
    "display.pitch_mm": 0.252,
}
"""A quarter of the pixels on each axis, of camera and LCD."""

BENCH_160: Mapping[str, Any] = {
    "camera.columns": 160,
    "camera.rows": 128,
    "camera.focal_px": [1125.0, 1125.0],
    "camera.centre_px": [79.5, 63.5],
    "display.columns": 480,
    "display.rows": 270,
    "display.pitch_mm": 0.252,
}
"""An eighth of the camera's pixels on each axis, a quarter of the LCD's."""


def small_rig_file(path: Path, values: Mapping[str, Any] = BENCH_320, of: str = "simulated") -> Path:
    """Write the packaged rig `of` that name with `values` in place of its own."""
    save_values(resource("calibration", "rigs", f"{of}.toml"), values, path)
    return path


def with_tables(rig: Rig, **tables: Any) -> Rig:
    """The rig with tables changed, unchecked: each given whole, or as a dict of the keys that change."""
    update = {
        name: getattr(rig, name).model_copy(update=value) if isinstance(value, dict) else value
        for name, value in tables.items()
    }
    return rig.model_copy(update=update)


SMALL_LCD = {"columns": 480, "rows": 270, "pitch_mm": 0.252}
"""Table [display]: the LCD of these benches. A run on the whole one takes three times as long."""

HALF_LCD = {"display.columns": 960, "display.rows": 540, "display.pitch_mm": 0.126}
"""The packaged LCD with pixels twice as large, for contacts: their borders need a finer picture than that."""


def quarter(**tables: Any) -> Rig:
    """The packaged bench with 320 x 256 camera pixels and its whole LCD; `tables` as for `with_tables`."""
    return with_tables(binned(load_rig("simulated"), 4), **tables)


def paper(scenario: str | Path) -> Rig:
    """The paper's bench on an LCD of half its resolution."""
    lcd = load_rig("paper").display
    size = {"columns": lcd.columns // 2, "rows": lcd.rows // 2, "pitch_mm": 2 * lcd.pitch_mm}
    return with_tables(load_rig("paper"), display=size, scenario=str(scenario))


def telecentric(
    angle_deg: float = 50.0, layers: Sequence[Layer] = (), pixel_mm: float = 0.1, **parts: Any
) -> Rig:
    """A symmetric prism, parallel rays at right angles to both faces: incidence = the prism's angle."""
    angle = np.radians(angle_deg)
    mirror_mm = 2 * 60.0 * np.cos(angle)
    look = np.array([mirror_mm / 2, 0.0, 0.0])
    position = look + 150.0 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    camera: dict[str, Any] = {"projection": "orthographic", "pixel_mm": pixel_mm, "focal_px": None}
    camera |= {"position_mm": tuple(position), "look_at_mm": tuple(look)} | parts.pop("camera", {})
    prism = {"pattern_angle_deg": angle_deg, "camera_angle_deg": angle_deg} | parts.pop("prism", {})
    return quarter(camera=camera, prism=prism, pattern_layers=tuple(layers), **parts)
