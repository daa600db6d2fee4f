"""Make touch.h5.xz and leds.h5.xz; they were made by 0.2.0 and stay: replays must not change.

PYTHONPATH=<checkout of 0.2.0> python tools/golden/recorded/record.py FOLDER
"""

from __future__ import annotations

import lzma
import os
import sys
from pathlib import Path

import zeromethod as zm
from zeromethod.light_array.rig import load_light_array
from zeromethod.light_array.session import LightSession
from zeromethod.loop.loop import Loop
from zeromethod.recording.recorder import Recorder
from zeromethod.session.fine import with_moving_target

TOUCH = """
object = [{ shape = "ball", radius_mm = 40.0, albedo = "grey", path = [
    { time_s = 0.24, x_mm = 42.0, y_mm = 0.0, depth_mm = 0.0 },
    { time_s = 0.26, x_mm = 42.0, y_mm = 0.0, depth_mm = 0.02 },
] }]
"""
"""A ball that stays, seen by the 112 x 96 pixels in the middle."""
DENT = """
press = [{ shape = "gaussian", sigma_mm = 5.0, path = [
    { time_s = 0.2, x_mm = 40.0, y_mm = 2.0, depth_mm = 0.0 },
    { time_s = 0.206, x_mm = 40.0, y_mm = 2.0, depth_mm = 0.02 },
] }]
"""
MIDDLE = {"camera.columns": 112, "camera.rows": 96, "camera.centre_px": [55.5, 47.5]}
COARSE_LCD = {"display.columns": 960, "display.rows": 540, "display.pitch_mm": 0.126}
TOUCH_FRAMES, LED_FRAMES = 30, 60


def touch(path: Path) -> None:
    """Frames and warps of a touch under a moving target, with a fine surface."""
    Path("press.toml").write_text(TOUCH, encoding="utf-8")
    rig = zm.binned(zm.load_rig("simulated"), 4).replace(MIDDLE | COARSE_LCD, scenario="press.toml")
    rig = with_moving_target(rig)

    def recorder(loop: Loop) -> Recorder:
        return Recorder(path, rig, loop.rest, keep=("frames", "warps"), compress=True, fine=True)

    with zm.Session(rig, record=recorder, fine=True) as session:
        list(session.run(frames=TOUCH_FRAMES))


def leds(path: Path) -> None:
    """What is measured at the start, and a press from there on; little noise, as that does not compress."""
    Path("press.toml").write_text(DENT, encoding="utf-8")
    rig = load_light_array("leds")
    assert rig is not None
    quiet = rig.changed("press.toml", detectors={"noise": 3e-5}, simulation={"begin_s": 0.285})
    with LightSession(quiet, record=path) as session:
        list(session.run(LED_FRAMES, None))


if __name__ == "__main__":
    os.chdir(sys.argv[1])
    zm.limit_threads()
    for make in (touch, leds):
        file = Path(f"{make.__name__}.h5").resolve()
        make(file)
        Path(f"{file}.xz").write_bytes(lzma.compress(file.read_bytes(), preset=9 | lzma.PRESET_EXTREME))
