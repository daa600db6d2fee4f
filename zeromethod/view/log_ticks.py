"""Ticks of logarithmic axes as plain numbers, also where an axis spans less than a decade."""

from __future__ import annotations

import math

from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

_FEW_DECADES = 3.0


def plain_log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis by numbers such as 0.05; call it when all is drawn.

    Below a decade the ticks are round numbers at equal distances, of which there are always some; up to a
    few decades 1, 2 and 5 of each; beyond, the decades.
    """
    low, high = sorted(axis.get_view_interval())
    decades = math.log10(high / low) if low > 0.0 else math.inf
    if decades < 1.0:
        axis.set_major_locator(MaxNLocator(5))
        axis.set_minor_locator(NullLocator())
    else:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < _FEW_DECADES else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
    axis.set_minor_formatter(NullFormatter())
