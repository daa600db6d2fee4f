"""The two ways a run can end badly; the command line turns them into exit codes."""

from __future__ import annotations

from types import UnionType


class InputError(ValueError):
    """What the user gave cannot be used (exit code 2).

    The message is one line: where (file, key or argument), the value, what is allowed.
    """


def check_type(name: str, value: object, kind: type | UnionType, words: str) -> None:
    """Raise InputError for an argument of another type. name: of function and argument; words: what it is."""
    if not isinstance(value, kind):
        raise InputError(f"{name}: {type(value).__name__}: {words}")


class MeasurementError(RuntimeError):
    """The input was sound but the measurement failed (exit code 1); the message is the reason."""
