"""Random scenes: standing ones while a method is tuned, others, drawn from a salt, to accept it by."""

from __future__ import annotations

import hashlib
import os
from typing import Any

import click
import numpy as np

_VARIABLE = "ZEROMETHOD_HELD_OUT"
"""Of the environment: processes that a benchmark starts draw the same scenes."""


def held_out() -> str:
    """The salt, "" for the standing scenes."""
    return os.environ.get(_VARIABLE, "")


def generator(*numbers: int) -> np.random.Generator:
    """Random numbers of the scene that these numbers name, by the salt where there is one."""
    return np.random.default_rng([_hashed(*numbers)] if held_out() else numbers)


def seed(number: int) -> int:
    """A simulated bench's seed, by the salt where there is one."""
    return _hashed(number) % 2**31 if held_out() else number


def _hashed(*numbers: int) -> int:
    return int(hashlib.sha256(f"{held_out()} {numbers}".encode()).hexdigest(), 16)


def _hold_out(_context: click.Context, _option: click.Parameter, salt: str | None) -> None:
    os.environ[_VARIABLE] = salt or ""


def salt_option(command: Any) -> Any:
    """Add the option --held-out; `benchmarks.report` then prints totals alone."""
    words = "Draw the scenes from this in place of the standing ones; only totals are given."
    option = click.option(
        "--held-out", metavar="SALT", callback=_hold_out, expose_value=False, is_eager=True, help=words
    )
    return option(command)
