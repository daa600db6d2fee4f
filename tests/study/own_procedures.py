"""A procedure of a lab's own, for the tests: it can be made to fail, to wait, to take its process along."""

import os
import signal
import time
from pathlib import Path

from zeromethod.errors import MeasurementError
from zeromethod.study import Procedure, Task


def _square(task: Task) -> dict[str, float]:
    x = task.settings["x"]
    if x == task.settings["fails_at"]:
        raise MeasurementError(f"no {x}")
    if x == task.settings["kills_at"]:
        os.kill(os.getpid(), signal.SIGKILL)
    if x == task.settings["waits_at"]:
        Path(task.settings["mark"]).touch()
        time.sleep(600)
    return {"square": x * x, "gain": task.rig.control.gain, "seed_of_bench": task.rig.simulation.seed}


SQUARE = Procedure(
    _square,
    {"square": "x times x", "gain": "gain of the rig", "seed_of_bench": "seed of the bench"},
    {"x": 0.0, "fails_at": None, "kills_at": None, "waits_at": None, "mark": ""},
)
