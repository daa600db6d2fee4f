"""Numbers of the command line: finite, and refused with the range that is allowed."""

from __future__ import annotations

import math
from typing import Any

import click


def _range(kind: click.FloatRange | click.IntRange, noun: str) -> str:
    """The range in words: "a number above 0, at most 1"."""
    if kind.min is not None and kind.max is not None and not (kind.min_open or kind.max_open):
        return f"{noun} from {kind.min:g} to {kind.max:g}"
    bounds = []
    if kind.min is not None:
        bounds.append(f" {'above' if kind.min_open else 'from'} {kind.min:g}")
    if kind.max is not None:
        bounds.append(f" {'below' if kind.max_open else 'at most'} {kind.max:g}")
    return noun + ",".join(bounds)


class Real(click.FloatRange):
    """A finite number, between bounds where there are any."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Number of a text; fails with what is allowed."""
        try:
            number = float(value)
            if math.isfinite(number):
                return float(super().convert(number, param, ctx))
        except (ValueError, click.BadParameter):
            pass
        raise click.BadParameter(f"{value}: {_range(self, 'a number')}", ctx, param)

    def _describe_range(self) -> str:
        """For --help; click writes "x<=None" where there are no bounds."""
        return "" if self.min is None and self.max is None else super()._describe_range()


class Whole(click.IntRange):
    """A whole number, between bounds where there are any."""

    name = "integer"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Number of a text; fails with what is allowed."""
        try:
            return int(super().convert(int(str(value)), param, ctx))
        except (ValueError, click.BadParameter):
            pass
        raise click.BadParameter(f"{value}: {_range(self, 'a whole number')}", ctx, param)
