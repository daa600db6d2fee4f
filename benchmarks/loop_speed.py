"""Time from a frame in hand to the commanded warp, beside OpenCV's DIS optical flow on the same frames.

    python benchmarks/loop_speed.py [--threads 1] [--frames 60]

Both run in one process, in turn, on frames of the simulated bench at 1280 x 1024 with the same number of
threads. The bar: the loop's median is at most 0.3 of DIS "fast", which only finds a displacement field.
"""

from __future__ import annotations

import argparse
import platform
import time

import cv2
import numpy as np

from zeromethod.control import Loop
from zeromethod.devices.opening import open_devices
from zeromethod.rig.load import load_rig
from zeromethod.threads import limit_threads

BAR = 0.3


def measure(frames: int, press: str) -> tuple[np.ndarray, np.ndarray]:
    """(loop times, DIS times) in ms per frame; the first ten frames warm up."""
    rig = load_rig("simulated").model_copy(update={"press": press})
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    loop_ms, dis_ms = [], []
    with open_devices(rig) as devices:
        loop = Loop(rig, devices.camera, devices.display, devices.clock)
        before = None
        for step in loop.run(frames=frames + 10):
            if before is not None and step.image is not None:
                started = time.perf_counter()
                flow.calc(before, step.image, None)
                elapsed = 1e3 * (time.perf_counter() - started)
                if step.number > 10 and step.measured is not None:
                    loop_ms.append(step.loop_ms)
                    dis_ms.append(elapsed)
            before = step.image
    return np.array(loop_ms), np.array(dis_ms)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--press", default="hold")
    options = parser.parse_args()
    limit_threads(options.threads)
    loop_ms, dis_ms = measure(options.frames, options.press)
    print(f"{platform.machine()}, Python {platform.python_version()}, OpenCV {cv2.__version__}")
    print(f"{len(loop_ms)} frames of 1280 x 1024, {options.threads} thread(s)")
    for name, values in (("loop", loop_ms), ("DIS fast", dis_ms)):
        print(f"{name:>9}: median {np.median(values):6.2f} ms, p99 {np.percentile(values, 99):6.2f} ms")
    ratio = float(np.median(loop_ms) / np.median(dis_ms))
    print(f"    ratio: {ratio:.3f} (bar {BAR}: {'met' if ratio <= BAR else 'MISSED'})")


if __name__ == "__main__":
    main()
