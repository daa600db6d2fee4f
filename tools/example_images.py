"""Make the example images and their rig file: a speckle seen in the simulated mirror.

python tools/example_images.py
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

import zeromethod as zm
from zeromethod.rig.save import save_values

FOLDER = Path(__file__).parent.parent / "examples"
SPECKLE_LCD_PX = 6.0
DEPTH_MM, WIDTH_MM = 0.2, 3.54
BINNING = 4

_PRESS = f"""[[press]]
shape = "load"
width_mm = {WIDTH_MM}
path = [
    {{ time_s = 0.2, x_mm = 42.0, y_mm = 0.0, depth_mm = 0.0 }},
    {{ time_s = 0.2, x_mm = 42.0, y_mm = 0.0, depth_mm = {DEPTH_MM} }},
]
"""


def rig_file(path: Path) -> None:
    """The packaged rig with four times larger camera pixels, whose pictures are simulated by it."""
    packaged = Path(__file__).parent.parent / "calibration/rigs/simulated.toml"
    small = zm.binned(zm.load_rig("simulated"), BINNING).camera
    path.write_text(packaged.read_text())
    keys = ("columns", "rows", "focal_px", "centre_px", "psf_px")
    camera = {f"camera.{key}": getattr(small, key) for key in keys}
    save_values(path, {"name": "still", **camera, "geometry.known": "exact"})


def speckle(columns: int, rows: int) -> np.ndarray:
    """Grey codes (rows, columns) of a random texture, black and white about equally."""
    noise = np.random.default_rng(1).standard_normal((rows, columns))
    smooth = cv2.GaussianBlur(noise, (0, 0), SPECKLE_LCD_PX)
    return np.clip(128 + 100 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def main() -> None:
    """Write the three files."""
    rig_path = FOLDER / "still.toml"
    rig_file(rig_path)
    press = FOLDER / "press.tmp.toml"
    press.write_text(_PRESS)
    try:
        rig = zm.load_rig(rig_path).model_copy(update={"scenario": str(press)})
        with zm.open_devices(rig) as devices:
            devices.display.show(speckle(rig.display.columns, rig.display.rows))
            for name, time_s in (("rest.png", 0.1), ("pressed.png", 0.3)):
                devices.clock.sleep_until_ns(round(1e9 * time_s))
                devices.camera.read(1.0)
                cv2.imwrite(str(FOLDER / name), devices.camera.read(1.0).image)
    finally:
        press.unlink()


if __name__ == "__main__":
    main()
