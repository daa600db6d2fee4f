"""Write `zeromethod/kernels.txt`: what must be compiled for which command, the longest modules first.

python tools/kernels.py    some minutes; after a function that numba compiles has changed
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

COMMANDS = {
    "run": ("run", "run --strips --seconds 0.6 --scenario ball", "run --passive --seconds 0.6"),
    "fine": ("run --fine --seconds 0.9 --scenario none",),
    "leds": ("run --rig leds --seconds 0.8",),
    "calibrate": (
        "calibrate fringes --panel 320 200 --periods 16,20,22,25 --shifts 6 --output fringes",
        "calibrate decode fringes/*.png --panel 320 200 --periods 16,20,22,25 --shifts 6 --output rest.npz",
    ),
    "measure": ("measure ROOT/examples/rest.png ROOT/examples/pressed.png --rig ROOT/examples/still.toml",),
}
"""What is run, with nothing compiled before, to find what a command compiles."""

ROOT = Path(__file__).parent.parent


def run_all(command: str) -> None:
    """Run a command's examples here, then print what they compiled: [seconds of its module, module, ...]."""
    from numba.core.event import Event, Listener, register  # noqa: PLC0415

    class Timer(Listener):
        """Processor time of each module's functions, without that of those they call."""

        def __init__(self) -> None:
            self.inside: list[list[float]] = []
            self.seconds: dict[str, float] = {}

        def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
            """Begin one."""
            self.inside.append([time.process_time(), 0.0])

        def on_end(self, event: Event) -> None:
            """End it."""
            began, others = self.inside.pop()
            whole = time.process_time() - began
            if self.inside:
                self.inside[-1][1] += whole
            module = event.data["dispatcher"].py_func.__module__
            self.seconds[module] = self.seconds.get(module, 0.0) + whole - others

    timer = Timer()
    register("numba:compile", timer)  # type: ignore[no-untyped-call]
    from zeromethod.cli.main import main as zeromethod  # noqa: PLC0415
    from zeromethod.compiling import compiled  # noqa: PLC0415

    for line in COMMANDS[command]:
        words = [word.replace("ROOT", str(ROOT)) for word in shlex.split(line)]
        words = [str(one) for word in words for one in (sorted(Path().glob(word)) if "*" in word else [word])]
        try:
            zeromethod(words)
        except SystemExit as end:
            if end.code:
                raise
    print(json.dumps([(timer.seconds.get(one[0], 0.0), *one) for one in compiled()]))


def found(command: str) -> list[Any]:
    """What `run_all` prints, in a process and with a cache of its own."""
    with tempfile.TemporaryDirectory() as folder:
        setting = {**os.environ, "NUMBA_CACHE_DIR": folder}
        program = [sys.executable, __file__, command]
        out = subprocess.run(program, cwd=folder, env=setting, stdout=subprocess.PIPE, check=True).stdout
    lines: list[Any] = json.loads(out.splitlines()[-1])
    return sorted(lines, key=lambda line: (-line[0], *line[1:]))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        run_all(sys.argv[1])
    else:
        of = {command: found(command) for command in COMMANDS}
        known = {tuple(one[1:]) for one in of["run"]}
        for command in ("fine", "leds"):
            of[command] = [one for one in of[command] if tuple(one[1:]) not in known]
        rows = [f"{command} {' '.join(one[1:])}\n" for command in COMMANDS for one in of[command]]
        (ROOT / "zeromethod" / "kernels.txt").write_text("".join(rows), encoding="utf-8")
