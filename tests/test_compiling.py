"""What is compiled ahead on a new machine, and what a person reads meanwhile."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from numba.core.event import Event, EventStatus

from zeromethod import compiling, still_busy
from zeromethod.compiling import Kernel, compile_ahead, kernels, kernels_of
from zeromethod.surface.integrate import fill_in

ROOT = Path(__file__).parent.parent
CALL = """
from zeromethod.compiling import report_compiling
report_compiling(print)
import numpy as np
from zeromethod.warp.compose import compose
q = np.zeros((8, 8, 2))
compose(q, q, 8.0)
"""
RUN = """
import json, sys
from zeromethod.session.session import Session
from benchmarks.rigs import small_rig
from zeromethod.compiling import compiled
with Session(small_rig().replace({"control.strips": "edges"})) as session:
    for step in session.run(seconds=0.7):
        pass
print(json.dumps(compiled()))
"""


def output(program: str, cache: Path | None = None) -> str:
    setting = os.environ | ({} if cache is None else {"NUMBA_CACHE_DIR": str(cache)})
    return subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=setting, check=True, capture_output=True, text=True
    ).stdout


def test_what_is_compiled_when_it_is_called_is_said_once(tmp_path: Path) -> None:
    assert output(CALL, tmp_path).startswith("compiling, once on a new machine: warp\n")
    assert output(CALL, tmp_path) == ""


def test_a_function_that_takes_long_is_said_again_and_again(monkeypatch):
    monkeypatch.setattr(still_busy, "EVERY_S", 0.02)
    said: list[str] = []
    reported = compiling._Reported(said.append, ahead=False)
    event = Event("compile", EventStatus.START, {"dispatcher": fill_in})
    reported.on_start(event)
    time.sleep(0.2)
    reported.on_end(event)
    count = len(said)
    assert {line.partition(" (")[0] for line in said} == {"compiling, once on a new machine: surface"}
    assert count > 2
    time.sleep(0.1)
    assert len(said) <= count + 1


def test_what_is_compiled_ahead_need_not_be_when_it_is_called(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    modules = ("zeromethod.warp.compose", "zeromethod.warp.interpolant")
    wanted = [one for one in kernels_of("run") if one.module in modules]
    gone = Kernel("run", "zeromethod.warp.compose", "no_more", "(float64, )")
    said: list[str] = []
    compile_ahead([*wanted, gone], said.append)
    count = len(wanted) + 1
    assert said[0] == f"compiling, once on a new machine: 0 of {count} functions"
    assert still_busy.EVERY_S < 2.0
    assert output(CALL, tmp_path) == ""


def test_the_first_that_is_missing_brings_all_of_its_command_and_no_other(tmp_path, monkeypatch):
    program = CALL.replace("report_compiling(print)", "report_compiling(print, ahead=True)").replace(
        "import report_compiling", "import report_compiling, kernels_of; import zeromethod.compiling as c"
    )
    program = program.replace(
        "import numpy", "c.compile_ahead = lambda all, say: say(len(all))\nimport numpy"
    )
    lines = output(program, tmp_path).splitlines()
    assert lines[0] == str(len(kernels_of("run")))
    # in the same process no second time; what else is missing is named
    assert all(line.startswith("compiling, once on a new machine: ") for line in lines[1:])
    assert 0 < len(kernels_of("run")) < len(kernels())


def test_all_that_a_run_compiles_is_listed() -> None:
    listed = {one[1:] for one in kernels_of("run")}

    def missing() -> set[tuple[str, ...]]:
        return {tuple(one) for one in json.loads(output(RUN).splitlines()[-1])} - listed

    # parts of other functions count only when called themselves: from the cache no part is loaded
    assert not missing() or not missing(), "python tools/kernels.py writes the list again"


def test_what_is_listed_is_read_as_it_was_written() -> None:
    for one in kernels():
        kinds = compiling._kinds_of(one.arguments)
        assert f"({''.join(f'{compiling.words_of(kind)}, ' for kind in kinds)})" == one.arguments
