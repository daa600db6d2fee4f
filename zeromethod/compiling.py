"""Compiling on a new machine: all that is being imported, on every core, with progress.

Importing a module compiles its functions (`zeromethod.kernels`), or loads what an earlier start has compiled.
The first that must be compiled brings all others of what is being imported, in a process for each core.
"""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from types import FrameType
from typing import BinaryIO, NamedTuple

from numba.core.event import Event, Listener, register, unregister

from zeromethod.child_process import ignore_signals, start_process, take_output

EVERY_S = 1.5
"""Time between two lines of progress."""
_COMPILED = b"\n"
"""A process's answer when another function is compiled; the module's name follows when all are."""
_PACKAGE = Path(__file__).parent
_IMPORTS = re.compile(r"^from (zeromethod[\w.]*) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)


def _source(module: str) -> str | None:
    """Text of a module of this package, or None."""
    path = _PACKAGE.joinpath(*module.split(".")[1:])
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file.read_text(encoding="utf-8")
    return None


def _imported_by(module: str, source: str) -> set[str]:
    """What a module imports of this package at once: not what it imports when a function is called."""
    parts = module.split(".")
    found = {".".join(parts[:end]) for end in range(1, len(parts))}
    for of, several, one in _IMPORTS.findall(source):
        names = (name.split(" as ")[0].strip() for name in (several or one).split(","))
        found |= {of, *(f"{of}.{name}" for name in names if name.isidentifier())}
    return found


class Module(NamedTuple):
    """A module with compiled functions: how many, and which other such modules it imports."""

    functions: int
    needs: set[str]


def compiled_modules(roots: Iterable[str]) -> dict[str, Module]:
    """Modules with compiled functions that these import; leaves first."""
    imports: dict[str, set[str]] = {}
    found: dict[str, int] = {}

    def visit(module: str) -> set[str]:
        if module in imports:
            return imports[module]
        source = _source(module)
        all_of = imports[module] = set[str]()
        if source is None:
            return all_of
        for each in sorted(_imported_by(module, source)):
            all_of |= {each} | visit(each)
        if functions := len(re.findall(r"^@kernel\(", source, re.MULTILINE)):
            found[module] = functions
        return all_of

    for root in roots:
        visit(root)
    return {
        module: Module(functions, imports[module] & found.keys() - {module})
        for module, functions in found.items()
    }


def all_modules() -> list[str]:
    """Every module of this package."""
    files = (path.relative_to(_PACKAGE.parent) for path in _PACKAGE.rglob("*.py"))
    return [".".join(file.with_suffix("").parts) for file in files]


def compile_ahead(roots: Iterable[str], say: Callable[[str], None]) -> None:
    """Compile what these modules import and what is not compiled yet, in a process for each core.

    say: is given a line now and then: how much is ready, and how long the rest takes at that rate.
    """
    waiting = compiled_modules(roots)
    count, began_s = sum(module.functions for module in waiting.values()), time.monotonic()
    ready: set[str] = set()
    running: set[str] = set()
    changed = threading.Condition()
    done = loaded = 0

    def next_module() -> tuple[str, int] | None:
        """Take one whose imports are ready, so that nothing is compiled twice; None when all are taken."""
        with changed:
            while waiting:
                for name, module in waiting.items():
                    if not running or not module.needs - ready:
                        del waiting[name]
                        running.add(name)
                        return name, module.functions
                changed.wait()
        return None

    def serve(process: subprocess.Popen[bytes]) -> None:
        nonlocal done, loaded
        assert process.stdin is not None
        assert process.stdout is not None
        while (taken := next_module()) is not None:
            # what a process leaves, because it was ended, is compiled when it is imported
            with suppress(OSError):
                process.stdin.write(f"{taken[0]}\n".encode())
                process.stdin.flush()
                while process.stdout.readline() == _COMPILED:
                    done += 1
            with changed:
                running.remove(taken[0])
                ready.add(taken[0])
                loaded += taken[1]
                changed.notify_all()

    with ExitStack() as stack:
        threads = []
        for _ in range(min(len(os.sched_getaffinity(0)), len(waiting))):
            process = start_process(__name__, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            stack.enter_context(process)
            stack.callback(process.kill)
            threads.append(threading.Thread(target=serve, args=(process,), daemon=True))
            threads[-1].start()
        for thread in threads:
            while thread.is_alive():
                thread.join(EVERY_S)
                so_far = max(done, loaded)
                # loading what is compiled already takes seconds, and is nothing to tell
                if done and so_far < count:
                    left_s = (time.monotonic() - began_s) * (count - so_far) / so_far
                    words = f"{so_far} of {count} functions, {left_s:.0f} s left"
                    say(f"compiling, once on a new machine: {words}")


def _being_imported() -> str | None:
    """The module of this package whose import brought all others that are being imported in this thread."""
    frame: FrameType | None = sys._getframe()
    outermost = None
    while frame is not None:
        name = str(frame.f_globals.get("__name__"))
        if frame.f_code.co_name == "<module>" and name.startswith("zeromethod."):
            outermost = name
        frame = frame.f_back
    return outermost


class _Missing(Listener):
    """What must be compiled because it is imported: brings the rest of what is being imported."""

    def __init__(self) -> None:
        self._ahead: set[str] = set()

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Compile the rest ahead, once for all that an import brings."""
        root = _being_imported()
        if root is not None and root not in self._ahead:
            self._ahead.add(root)
            compile_ahead([root], lambda words: sys.stderr.writelines((words, "\n")))

    def on_end(self, event: Event) -> None:
        """Nothing is left to do."""


_missing = _Missing()
register("numba:compile", _missing)  # type: ignore[no-untyped-call]


class _Told(Listener):
    """Answers when a function that is not part of another is compiled."""

    def __init__(self, answers: BinaryIO) -> None:
        self._answers, self._inside = answers, 0

    def on_start(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Begin one, or a part of one."""
        self._inside += 1

    def on_end(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """End it."""
        self._inside -= 1
        if not self._inside:
            self._answers.write(_COMPILED)
            self._answers.flush()


def main() -> None:
    """Names of modules come in, one a line; each goes out again when it is imported, and so compiled."""
    ignore_signals()
    unregister("numba:compile", _missing)  # type: ignore[no-untyped-call]
    with suppress(BrokenPipeError), take_output() as answers:  # who asked may have been killed
        register("numba:compile", _Told(answers))  # type: ignore[no-untyped-call]
        for line in sys.stdin:
            with suppress(ImportError):  # of a library that is not installed
                importlib.import_module(line.strip())
            answers.write(line.encode())
            answers.flush()
