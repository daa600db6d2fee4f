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

from numba.core.event import Event, Listener, register, unregister

from zeromethod.child_process import ignore_signals, start_process, take_output

EVERY_S = 1.5
"""Time between two lines of progress."""
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


def compiled_modules(roots: Iterable[str]) -> dict[str, set[str]]:
    """Modules with compiled functions that these import, and of which others each needs; leaves first."""
    imports: dict[str, set[str]] = {}
    found: dict[str, set[str]] = {}

    def visit(module: str) -> set[str]:
        if module in imports:
            return imports[module]
        source = _source(module)
        all_of = imports[module] = set[str]()
        if source is None:
            return all_of
        for each in sorted(_imported_by(module, source)):
            all_of |= {each} | visit(each)
        if re.search(r"^@kernel\(", source, re.MULTILINE):
            found[module] = all_of
        return all_of

    for root in roots:
        visit(root)
    return {module: needs & found.keys() - {module} for module, needs in found.items()}


def all_modules() -> list[str]:
    """Every module of this package."""
    files = (path.relative_to(_PACKAGE.parent) for path in _PACKAGE.rglob("*.py"))
    return [".".join(file.with_suffix("").parts) for file in files]


def compile_ahead(roots: Iterable[str], say: Callable[[str], None]) -> None:
    """Compile what these modules import and what is not compiled yet, in a process for each core.

    say: is given a line now and then: how much is ready, and how long the rest takes at that rate.
    """
    waiting = compiled_modules(roots)
    count, began_s = len(waiting), time.monotonic()
    ready: set[str] = set()
    running: set[str] = set()
    changed = threading.Condition()

    def next_module() -> str | None:
        """Take one whose imports are ready, so that nothing is compiled twice; None when all are taken."""
        with changed:
            while waiting:
                for module, needs in waiting.items():
                    if not running or not needs - ready:
                        del waiting[module]
                        running.add(module)
                        return module
                changed.wait()
        return None

    def serve(process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None
        assert process.stdout is not None
        while (module := next_module()) is not None:
            # what a process leaves, because it was ended, is compiled when it is imported
            with suppress(OSError):
                process.stdin.write(f"{module}\n".encode())
                process.stdin.flush()
                process.stdout.readline()
            with changed:
                running.remove(module)
                ready.add(module)
                changed.notify_all()

    with ExitStack() as stack:
        threads = []
        for _ in range(min(len(os.sched_getaffinity(0)), count)):
            process = start_process(__name__, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            stack.callback(process.wait)
            stack.callback(process.kill)
            threads.append(threading.Thread(target=serve, args=(process,), daemon=True))
            threads[-1].start()
        for thread in threads:
            while thread.is_alive():
                thread.join(EVERY_S)
                done = len(ready)
                if 0 < done < count:
                    left_s = (time.monotonic() - began_s) * (count - done) / done
                    say(f"compiling, once on a new machine: {done} of {count} modules, {left_s:.0f} s left")


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


def main() -> None:
    """Names of modules come in, one a line; each goes out again when it is imported, and so compiled."""
    ignore_signals()
    unregister("numba:compile", _missing)  # type: ignore[no-untyped-call]
    with suppress(BrokenPipeError), take_output() as answers:  # who asked may have been killed
        for line in sys.stdin:
            with suppress(ImportError):  # of a library that is not installed
                importlib.import_module(line.strip())
            answers.write(line.encode())
            answers.flush()
