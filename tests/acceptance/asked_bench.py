"""A virtual bench that is pressed when a line on its standard input asks for it: a patient hand.

    python asked_bench.py RIG.toml MONITOR

prints the camera's address; "press X Y DEPTH" and "lift" on standard input do just that.
"""

import sys
import threading
from dataclasses import replace
from typing import Any

from zeromethod import limit_threads, load_rig
from zeromethod.simulation.loads import load
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.scenario import Scenario
from zeromethod.simulation.virtual_bench.bench import Bender, Performance, VirtualBench
from zeromethod.simulation.virtual_bench.grab import MonitorGrabber, find_monitor
from zeromethod.simulation.virtual_bench.stream import FrameServer, stream_header

MOVE_S = 0.5
PAD = load(0.0, 0.0, 1.0, 3.5)


class Asked(Scenario):
    """Presses that come and go as they are asked for, straight down and up."""

    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depth_mm = 0.0
    wanted_mm = 0.0
    last_ns = 0

    def mirror_at(self, time_ns: int) -> Mirror:
        step = 1e-9 * (time_ns - self.last_ns) / MOVE_S * self.place[2]
        away = self.wanted_mm - self.depth_mm
        new = self.depth_mm + max(-step, min(step, away))
        object.__setattr__(self, "depth_mm", new)
        object.__setattr__(self, "last_ns", time_ns)
        x, y, _ = self.place
        return Mirror((replace(PAD, x_mm=x, y_mm=y, depth_mm=new),) if new > 0 else ())

    def obey(self, line: str) -> None:
        words = line.split()
        if words[0] == "press":
            x, y, depth = map(float, words[1:])
            object.__setattr__(self, "place", (x, y, depth))
            object.__setattr__(self, "wanted_mm", depth)
        else:
            object.__setattr__(self, "wanted_mm", 0.0)


def main(rig_file: str, monitor: str) -> None:
    limit_threads(1)
    rig = load_rig(rig_file)
    found = find_monitor(int(monitor), (rig.display.columns, rig.display.rows))
    camera, hand, stop = rig.camera, Asked("asked", (), 1e9), threading.Event()
    server = FrameServer(0, stream_header(camera.columns, camera.rows, camera.rate_hz, camera.bits))

    def listen() -> None:
        for line in sys.stdin:
            hand.obey(line)
        stop.set()

    def grabber() -> Any:
        return MonitorGrabber(found)

    bench = VirtualBench(rig, Performance(hand), Bender(rig), server, grabber)
    threading.Thread(target=listen, daemon=True).start()
    sys.stdout.write(f"tcp://127.0.0.1:{server.port}\n")
    sys.stdout.flush()
    bench.run(stop, lambda words: None)


if __name__ == "__main__":
    main(*sys.argv[1:])
