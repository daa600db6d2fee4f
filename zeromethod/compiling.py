"""Compiled functions: those of a command made ahead, on every core, and words about it.

On a new machine this is most of the first start. `kernels.txt` lists what each command needs, as
`tools/kernels.py` found it; functions that it lacks are compiled when they are first called.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.event import Event, Listener, register

from zeromethod.child_process import ignore_signals, start_process, take_output
from zeromethod.still_busy import EVERY_S, StillBusy

LIST = Path(__file__).parent / "kernels.txt"
_DONE = b"\n"


class Kernel(NamedTuple):
    """A function for certain types of arguments, and the command that needs it."""

    command: str
    module: str
    name: str
    arguments: str


@cache
def kernels() -> tuple[Kernel, ...]:
    """All that are listed; the modules that take longest come first."""
    lines = LIST.read_text(encoding="utf-8").splitlines()
    return tuple(Kernel(*line.split(maxsplit=3)) for line in lines)


def words_of(kind: Any) -> str:
    """A type of numba's as `_kind_of` takes it."""
    if isinstance(kind, types.Literal):
        return f"literal({kind.literal_value!r})"
    if isinstance(kind, types.Omitted):
        return f"Omitted({kind.value!r})"
    if isinstance(kind, types.Array):
        end = "" if kind.mutable else ", readonly=True"
        return f"Array({words_of(kind.dtype)}, {kind.ndim}, {kind.layout!r}{end})"
    if isinstance(kind, types.SliceType):
        return "slice3_type" if kind.has_step else "slice2_type"
    if isinstance(kind, types.BaseTuple):
        parts = "".join(f"{words_of(one)}, " for one in iter(kind))  # type: ignore[call-overload]
        made = getattr(kind, "instance_class", tuple)
        return f"parts(({parts}), {made.__module__!r}, {made.__qualname__!r})"
    return "boolean" if kind == types.boolean else str(kind)


def _parts(kinds: tuple[Any, ...], module: str, name: str) -> Any:
    made = getattr(importlib.import_module(module), name)
    return types.BaseTuple.from_types(kinds, None if made is tuple else made)  # type: ignore[no-untyped-call]


def _kinds_of(arguments: str) -> tuple[Any, ...]:
    kinds: tuple[Any, ...] = eval(arguments, {**vars(types), "parts": _parts})
    return kinds


def compiled() -> list[tuple[str, str, str]]:
    """(module, name, types of arguments) of all that is compiled or loaded in this process."""
    found = []
    for module in [one for name, one in sys.modules.items() if name.startswith("zeromethod.")]:
        for name, value in vars(module).items():
            if isinstance(value, Dispatcher) and value.py_func.__module__ == module.__name__:
                found += [
                    (module.__name__, name, f"({''.join(f'{words_of(kind)}, ' for kind in kinds)})")
                    for kinds in value.overloads
                ]
    return found


def kernels_of(*commands: str) -> list[Kernel]:
    """What these commands need; of all where none is named."""
    return [one for one in kernels() if not commands or one.command in commands]


def load(room: str) -> None:
    """Compile, or load as they were compiled, all of a room's functions: else the first call waits for it."""
    for one in dict.fromkeys(each[1:] for each in kernels() if each.module.split(".")[1] == room):
        _compile(*one)


def compile_ahead(wanted: Sequence[Kernel], say: Callable[[str], None]) -> None:
    """Compile what is not yet compiled, module by module in a process for each core.

    say: is given a line now and then: how many of how many are ready.
    """
    modules: dict[str, list[tuple[str, ...]]] = {}
    for one in dict.fromkeys(each[1:] for each in wanted):
        modules.setdefault(one[0], []).append(one)
    waiting = deque(modules.values())
    count = sum(map(len, waiting))
    ready: set[bytes] = set()

    def serve(given: BinaryIO, answers: BinaryIO) -> None:
        # what a process leaves, because it was ended, is compiled when it is first called
        with suppress(OSError, IndexError), given, answers:
            while True:
                given.write(json.dumps(waiting.popleft()).encode() + b"\n")
                given.flush()
                for line in iter(answers.readline, _DONE):
                    if not line:
                        return
                    ready.add(line)

    with ExitStack() as stack:
        threads = []
        for _ in range(min(len(os.sched_getaffinity(0)), len(waiting))):
            process = start_process(__name__, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            stack.callback(process.wait)
            stack.callback(process.kill)
            threads.append(threading.Thread(target=serve, args=(process.stdin, process.stdout), daemon=True))
            threads[-1].start()
        said = ""
        for thread in threads:
            while thread.is_alive():
                words = f"compiling, once on a new machine: {len(ready)} of {count} functions"
                if words != said:
                    say(words)
                said = words
                thread.join(EVERY_S)


class _Reported(Listener):
    """What is compiled because it is called."""

    def __init__(self, say: Callable[[str], None], ahead: bool) -> None:
        self._say = say
        self._ahead = {one.command for one in kernels()} if ahead else set()
        self._said_s = float("-inf")
        self._busy, self._begun = StillBusy(say), 0

    def on_start(self, event: Event) -> None:
        """Where it is one of a command's, compile all of that first; else say what is compiled."""
        self._begun += 1
        function = event.data["dispatcher"].py_func
        module = str(function.__module__)
        if not module.startswith("zeromethod."):
            return
        called = (one.command for one in kernels() if (one.module, one.name) == (module, function.__name__))
        command = next(called, "")
        if command in self._ahead:
            self._ahead.remove(command)
            compile_ahead(kernels_of(command), self._say)
            return
        words = f"compiling, once on a new machine: {module.split('.')[1].replace('_', ' ')}"
        self._busy.doing(words)
        if time.monotonic() - self._said_s >= EVERY_S:
            self._say(words)
            self._said_s = time.monotonic()

    def on_end(self, event: Event) -> None:  # noqa: ARG002 - numba's signature
        """Say no more once all is compiled that others called."""
        self._begun -= 1
        if self._begun == 0:
            self._busy.doing("")


_reported: list[_Reported] = []


def report_compiling(say: Callable[[str], None], ahead: bool = False) -> None:
    """Pass on a line now and then whenever something is compiled in this process; the first call counts.

    ahead: the first of a command that must be compiled brings all others of that, on every core.
    """
    if not _reported:
        _reported.append(_Reported(say, ahead))
        register("numba:compile", _reported[0])  # type: ignore[no-untyped-call]


def main() -> None:
    """Lists of [module, name, arguments] come in; each goes out when compiled, an empty line after a list."""
    ignore_signals()
    with suppress(BrokenPipeError), take_output() as answers:  # who asked may have been killed
        for line in sys.stdin:
            for one in json.loads(line):
                _compile(*one)
                answers.write(json.dumps(one).encode() + b"\n")
                answers.flush()
            answers.write(_DONE)
            answers.flush()


def _compile(module: str, name: str, arguments: str) -> None:
    """Compile one of the list; one that is gone is left out."""
    dispatcher = getattr(importlib.import_module(module), name, None)
    if isinstance(dispatcher, Dispatcher):
        dispatcher.compile(_kinds_of(arguments))
