"""Draws docs/how-it-measures.png: the loads that explain the slopes of a view, and the constant they give.

Run in the repository: python tools/constant_picture.py docs/how-it-measures.png
"""

import sys
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.linalg import cho_solve

from benchmarks.anchors import View
from benchmarks.loads import Load, Pressed
from benchmarks.rigs import coarser
from zeromethod.mechanics.gaussian_load import HalfSpace
from zeromethod.mechanics.load_variances import spread_variances
from zeromethod.mechanics.possible_loads import possible_loads
from zeromethod.rig.load import load_rig
from zeromethod.surface.possible_dents import PossibleDents
from zeromethod.warp.blocks import Blocks

LOADS = (0.10, 33.0, 0.0, 3.5), (0.06, 79.0, 0.0, 4.0)
"""What presses: depth, place (x, y) and width, mm; the second lies out of view."""
LOUDEST, AROUND_MM = 0.03, 18.0
"""Pressure of the loads drawn, over the largest; how much is drawn around the view."""


def main(path: str) -> None:
    """Read one frame and draw how it got its constant."""
    view = View(coarser(load_rig("simulated"), 4))
    pressed = [Load("gaussian", d * np.sqrt(2 / np.pi) * w, x, y, w) for d, x, y, w in LOADS]
    reader, inner = view.reader, view.grid.inner
    rest = reader.read(view.warp(Pressed((replace(pressed[0], q_mm2=0.0),))))
    surface = reader.read(view.warp(Pressed(tuple(pressed)), np.random.default_rng(0)))
    assert reader.learned is not None
    body, used = reader.learned.likeliest, reader.learned.used
    fit, ring = body.fit, body.fit.ring > 0.0
    x, y, depth = (one[inner] for one in (surface.x_mm, surface.y_mm, surface.depth_mm))
    blocks = Blocks.of(x.shape)
    fields = np.stack([x, y, depth / reader.scale, 1 / reader.scale, *surface.slope[inner].T.swapaxes(1, 2)])
    at_x, at_y, ratio, inverse, *slope = blocks.means(np.moveaxis(fields, 0, -1), surface.valid[inner])[0].T

    # the mean of every possible load, by the covariance of what was seen
    at_rest = rest.x_mm[inner], rest.y_mm[inner]
    low, high = (np.array([edge(one) for one in at_rest]) for edge in (np.min, np.max))
    loads = possible_loads(low, high, float(np.sqrt(np.prod(high - low) / blocks.count)))
    dents = PossibleDents(HalfSpace(), loads, blocks, *at_rest)
    seen, mean = dents.seen(fit.ring, inverse, fit.gradient, used)
    z = np.stack(slope)[:, used] - (fit.ring @ ratio) * fit.gradient[used].T
    weights = fit.white(seen).T @ cho_solve((fit.root, True), fit.white(z.ravel()))
    peak = spread_variances(body.variances, loads) * weights
    ring_mm = float(mean @ peak)

    figure = Figure(figsize=(13, 4.4), layout="constrained")
    top, section = figure.subplots(1, 2, width_ratios=(1.25, 1))
    top.pcolormesh(x, y, 1e3 * depth, cmap="Blues", shading="nearest", vmin=0.0)
    top.plot(at_x[ring], at_y[ring], "s", ms=8, color="#e8a13a", alpha=0.3, label="blocks of the ring")
    top.quiver(at_x[used], at_y[used], *(one[used] for one in slope), angles="xy", width=2e-3)
    pressure = peak / loads.width_mm
    for load in np.flatnonzero(np.abs(pressure) > LOUDEST * pressure.max()):
        place = loads.x_mm[load], loads.y_mm[load]
        top.add_patch(Circle(place, loads.width_mm[load], fill=False, color="#c8374a", lw=1.2))
    top.plot(*np.array(LOADS)[:, 1:3].T, "k+", ms=10, mew=2, label="what presses")
    top.set(xlabel="x, mm", ylabel="y, mm", xlim=(low[0] - AROUND_MM, high[0] + AROUND_MM), aspect="equal",
            title="depth in view, slopes of its blocks, loads found (red)")  # fmt: skip
    top.legend(loc="lower left", fontsize=8)

    along = np.linspace(low[0] - AROUND_MM, high[0] + AROUND_MM, 400)
    found = HalfSpace().at(along, 0 * along)(loads)[0] @ peak
    row = np.abs(y[:, y.shape[1] // 2]).argmin()
    half_block = 0.5 * np.ptp(x) / len(blocks.first_col)
    within = at_x[used & ~ring].min() - half_block, at_x[used & ~ring].max() + half_block
    section.axvspan(low[0], within[0], color="#e8a13a", alpha=0.3, label="ring")
    section.axvspan(within[1], high[0], color="#e8a13a", alpha=0.3)
    as_rest = 1e3 * (depth - ring_mm * reader.scale)[row]
    section.plot(x[row], as_rest, "--", color="0.5", label="slopes, with the ring at rest")
    section.plot(x[row], 1e3 * depth[row], ".", color="#2b5fb3", label="depth read")
    section.plot(along, 1e3 * found, color="#c8374a", lw=1.2, label="dent of the loads found")
    section.axhline(0.0, color="k", lw=0.5)
    section.set(xlabel="x, mm", ylabel="depth, µm", title="a section; depth at the ring by "
                f"the loads: {1e3 * ring_mm:.1f} ± {1e3 * surface.anchor.sigma_mm:.1f} µm")  # fmt: skip
    section.legend(fontsize=8, loc="upper right")
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main(sys.argv[1])
