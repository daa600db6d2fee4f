"""Pictures of what happens to the mirror from outside: what comes before it touches, what fingers do."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes

from zeromethod.approach import Approach
from zeromethod.arrays import Float
from zeromethod.interactive.pointers import PointerEvent, PointerType
from zeromethod.view.axes import centred, labelled

COLUMN = 3
"""Panels that each of them draws."""


def draw_approaches(axes: Sequence[Axes], seen: Iterable[Approach], start_ns: int) -> None:
    """Height of what comes, when it is expected to touch, and where; all with two sigma, over the run's time.

    seen: of every frame of the watch camera, also again and again. start_ns: time of the first step.
    """
    known = {one.time_ns: one for one in seen if np.isfinite(one.height_mm)}
    labelled(axes[0], "what comes: height over the mirror", "time, s", "mm")
    labelled(axes[1], "when a touch is expected", "time, s", "touch at, s")
    labelled(axes[2], "where (bright: latest)", "x, mm", "y, mm")
    if not known:
        centred(axes[0], "nothing came")
    names = (
        *("height_mm", "sigma_height_mm", "contact_s", "sigma_contact_s"),
        *("x_mm", "y_mm", "sigma_x_mm", "sigma_y_mm", "armed"),
    )
    values = [[getattr(one, name) for name in names] for one in known.values()]
    height, sigma, contact, off, x, y, sigma_x, sigma_y, armed = np.reshape(values, (-1, len(names))).T
    at_s = 1e-9 * (np.array(list(known), np.float64) - start_ns)
    _band(axes[0], at_s, height, sigma)
    on = armed > 0
    if not on.any():
        for axis in axes[1:COLUMN]:
            centred(axis, "never armed")
        return
    _band(axes[1], at_s[on], (at_s + contact)[on], off[on])
    axes[2].errorbar(x[on], y[on], 2 * sigma_y[on], 2 * sigma_x[on], fmt="none", ecolor="0.7", linewidth=0.6)
    axes[2].scatter(x[on], y[on], c=at_s[on], s=8, zorder=3)
    # the first may be known so little that the others would be one point
    around = 1.0 + 2 * float(np.median(np.hypot(sigma_x[on], sigma_y[on])))
    axes[2].set_xlim(x[on].min() - around, x[on].max() + around)
    axes[2].set_ylim(y[on].min() - around, y[on].max() + around)
    axes[2].set_aspect("equal")


def _band(axis: Axes, x: Float, y: Float, sigma: Float) -> None:
    axis.fill_between(x, y - 2 * sigma, y + 2 * sigma, alpha=0.3, linewidth=0)
    axis.plot(x, y, ".-", markersize=3, linewidth=0.8)


def draw_pointers(axes: Sequence[Axes], events: Iterable[PointerEvent], start_ns: int, end_ns: int) -> None:
    """Tracks of fingers over the mirror, and their pressure and place along x over the run's time.

    end_ns: until when what was said last of a finger that is still down holds.
    """
    labelled(axes[0], "pointers (o: down, x: up or cancelled)", "x, mm", "y, mm")
    labelled(axes[1], "pressure of pointers", "time, s", "of full force")
    labelled(axes[2], "place of pointers along x", "time, s", "x, mm")
    fingers: dict[int, list[PointerEvent]] = {}
    for event in events:
        fingers.setdefault(event.pointer_id, []).append(event)
    if not fingers:
        for axis in axes[:COLUMN]:
            centred(axis, "no pointer event")
    for number, said in fingers.items():
        ended = said[-1].type in (PointerType.UP, PointerType.CANCEL)
        at_s = [1e-9 * (one.time_ns - start_ns) for one in said]
        if not ended:
            at_s.append(1e-9 * (end_ns - start_ns))
            said.append(said[-1])
        x, y = [one.x_mm for one in said], [one.y_mm for one in said]
        (line,) = axes[0].plot(x, y, "-", linewidth=0.8)
        colour = line.get_color()
        axes[0].plot(x[0], y[0], "o", color=colour, fillstyle="none")
        if ended:
            axes[0].plot(x[-1], y[-1], "x", color=colour)
        axes[0].annotate(str(number), (x[0], y[0]), (4, 4), textcoords="offset points")
        # what was said last holds until something else is said
        axes[1].step(at_s, [one.pressure for one in said], where="post", color=colour, linewidth=0.8)
        axes[2].step(at_s, x, where="post", color=colour, linewidth=0.8)
    axes[0].margins(0.1)
    axes[0].set_aspect("equal", "datalim")
