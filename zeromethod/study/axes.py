"""What varies from run to run: lists of values for a grid, distributions for a Monte Carlo."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from zeromethod.errors import InputError
from zeromethod.rig.refusal import shown

MOST_VALUES = 100_000

_ALLOWED = {
    "uniform": "[low, high] with low below high",
    "log_uniform": "[low, high] with 0 below low below high",
    "normal": "[mean, sigma] with sigma above 0",
}

RANGE_WORDS = ("from", "to", "steps", "scale")
DRAW_WORDS = (*_ALLOWED, "choice")
"""Words that a table of values may have under [grid], and under [random]."""

_RANGE = 'a list of values, or { from, to, steps, scale = "linear" or "log" }'
_DRAW = (
    "one of { uniform = [low, high] }, { log_uniform = [low, high] }, { normal = [mean, sigma] }, "
    "{ choice = [values] }"
)


def axis_values(where: str, given: Any) -> list[Any]:
    """Values of one axis of a grid, in order.

    given: a list, or a table {from, to, steps, scale}. Raises InputError, one line that begins with `where`.
    """
    if isinstance(given, list):
        if not given:
            raise InputError(f"{where}: []: at least one value")
        return given
    _check_words(where, given, RANGE_WORDS)
    if not isinstance(given, dict) or not {"from", "to", "steps"} <= set(given):
        raise InputError(f"{where}: {shown(given)}: {_RANGE}")
    low, high, steps, scale = given["from"], given["to"], given["steps"], given.get("scale", "linear")
    if not (_number(low) and _number(high)):
        raise InputError(f"{where}: from {shown(low)} to {shown(high)}: two finite numbers")
    if type(steps) is not int or not 2 <= steps <= MOST_VALUES:
        raise InputError(f"{where}: steps: {shown(steps)}: a whole number from 2 to {MOST_VALUES}")
    if scale == "linear":
        values = np.linspace(low, high, steps)
    elif scale == "log" and low > 0 and high > 0:
        values = np.geomspace(low, high, steps)
    else:
        rule = "above 0 at both ends" if scale == "log" else 'scale "linear" or "log"'
        raise InputError(f"{where}: from {shown(low)} to {shown(high)}, scale {shown(scale)}: {rule}")
    # twelve digits: 0.3 and not 0.30000000000000004 in the table and on the axes
    return [float(f"{value:.12g}") for value in values]


def draw(where: str, given: Any, seed: int, key: str, number: int) -> Any:
    """Value number `number` of a distribution.

    It depends on the study's seed, the key and the number alone: neither on the order of runs nor on what
    else is drawn. Raises InputError, one line that begins with `where`.
    """
    _check_words(where, given, DRAW_WORDS)
    if not isinstance(given, dict) or len(given) != 1:
        raise InputError(f"{where}: {shown(given)}: {_DRAW}")
    ((kind, numbers),) = given.items()
    if not isinstance(numbers, list):
        raise InputError(f"{where}: {kind} = {shown(numbers)}: {_DRAW}")
    rng = np.random.default_rng(
        np.random.SeedSequence(seed, spawn_key=(1, zlib.crc32(key.encode("utf-8")), number))
    )
    if kind == "choice":
        if not numbers:
            raise InputError(f"{where}: choice = []: at least one value")
        return numbers[int(rng.integers(len(numbers)))]
    if len(numbers) != 2 or not all(map(_number, numbers)):
        raise InputError(f"{where}: {kind} = {shown(numbers)}: {_ALLOWED[kind]}")
    low, high = map(float, numbers)
    if not {"uniform": low < high, "log_uniform": 0 < low < high, "normal": high > 0}[kind]:
        raise InputError(f"{where}: {kind} = {shown(numbers)}: {_ALLOWED[kind]}")
    if kind == "normal":
        return float(rng.normal(low, high))
    if kind == "uniform":
        return float(rng.uniform(low, high))
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def run_seed(seed: int, run: int) -> int:
    """Seed of one run's simulated bench; of the study's seed and the run's number alone."""
    return int(np.random.SeedSequence(seed, spawn_key=(0, run)).generate_state(1)[0])


def not_a_word(where: str, word: str, words: tuple[str, ...]) -> InputError:
    """Refusal of a word that a table of values cannot have."""
    return InputError(f"{where}: {word}: one of {', '.join(words)}")


def _check_words(where: str, given: Any, words: tuple[str, ...]) -> None:
    for word in given if isinstance(given, dict) else ():
        if word not in words:
            raise not_a_word(where, word, words)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
