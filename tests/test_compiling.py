"""What is compiled on a new machine, and what a person reads meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from zeromethod import compiling
from zeromethod.compiling import Module, all_modules, compile_ahead, compiled_modules

IMPORT = """
import sys
from numba.core.event import Listener, register

class Counted(Listener):
    count = 0
    def on_start(self, event):
        if event.data["dispatcher"].py_func.__module__.startswith("zeromethod."):
            Counted.count += 1
    def on_end(self, event):
        pass

register("numba:compile", Counted())
import {}
print(Counted.count)
"""


def compiled_by(module: str, cache: Path) -> int:
    """Functions of the package that are compiled in a process that imports a module."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORT.format(module)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        check=True,
        capture_output=True,
        text=True,
    )
    return int(done.stdout)


def test_the_first_that_is_missing_brings_all_others_of_what_is_imported(tmp_path: Path) -> None:
    assert compiled_by("zeromethod.exposure.pairing", tmp_path) == 1
    assert compiled_by("zeromethod.exposure.pairing", tmp_path) == 0


def test_what_was_compiled_ahead_is_not_when_it_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiling, "EVERY_S", 0.01)
    said: list[str] = []
    compile_ahead(["zeromethod.warp.continuation"], said.append)
    count = sum(module.functions for module in compiled_modules(["zeromethod.warp.continuation"]).values())
    words = "compiling, once on a new machine: "
    assert said[0].startswith(f"{words}1 of {count} functions, ")
    assert all(line.startswith(words) and line.endswith(" s left") for line in said)
    assert compiled_by("zeromethod.warp.continuation", tmp_path) == 0


def test_a_run_compiles_what_it_needs_and_nothing_else() -> None:
    needed = compiled_modules(["zeromethod.cli.run"])
    assert "zeromethod.sensing.demodulate" in needed
    others = ("fine", "light_array", "passive", "rubbing", "interactive")
    assert not [module for module in needed if module.split(".")[1] in others]
    assert needed.keys() < compiled_modules(all_modules()).keys()


def test_a_module_comes_after_those_that_it_imports() -> None:
    needed = compiled_modules(all_modules())
    before: set[str] = set()
    for name, module in needed.items():
        assert module.needs <= before, name
        before.add(name)


def test_a_module_of_a_library_that_is_not_installed_does_not_stop_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        compiling,
        "compiled_modules",
        lambda _: {"zeromethod.none": Module(1, set()), "zeromethod.errors": Module(1, set())},
    )
    compile_ahead(["zeromethod"], lambda _: None)
