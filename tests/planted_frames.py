"""Frames under a target that steps, by exact rays of planted dents and the interpolant that is drawn."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zeromethod.fine.frames import FineFrame
from zeromethod.fine.reader import FineReader
from zeromethod.optics import Dented, Optics
from zeromethod.rig.model import Rig
from zeromethod.sensing.window import triangle
from zeromethod.warp.compose import compose
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.interpolant import sample, window_matched
from zeromethod.warp.jacobian import jacobian
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

GREY, AMPLITUDE = 127.0, 57.15
EIGHT = [(2 * np.pi * t / 8, 6 * np.pi * t / 8) for t in range(8)]
"""Phases of eight frames that determine all unknowns equally well."""


def to_and_fro(frames: int) -> np.ndarray:
    """(N, 2) phases, rad, of a target that steps by a 16th of a period along u and an 8th along v."""
    places = np.stack([np.arange(frames), np.arange(frames) + 8], axis=-1) % 32
    return 2 * np.pi / 16 * np.minimum(places, 32 - places) * (1, 2)


@dataclass(frozen=True)
class PlantedFrames:
    """A rig, and what its camera would see of a mirror without any error but noise."""

    rig: Rig

    @cached_property
    def optics(self) -> Optics:
        return Optics(self.rig)

    @cached_property
    def grid(self) -> NodeGrid:
        return NodeGrid.of_rig(self.rig)

    @property
    def reader(self) -> FineReader:
        """One that has read nothing yet: what it learned of a press it keeps for some frames of the next."""
        return FineReader(self.rig, self.optics, self.grid, divide=False)

    @cached_property
    def pixels(self):
        rows, cols = self.grid.image_shape
        return np.meshgrid(np.arange(cols, dtype=float), np.arange(rows, dtype=float))

    def seen(self, mirror) -> np.ndarray:
        """(rows, cols, 2) LCD px where every pixel looks."""
        return self.optics.trace(*self.pixels, Dented(self.optics.rest, mirror)).q

    def nulled(self, mirror) -> np.ndarray:
        """(node rows, node cols, 2) the warp that nulls a mirror."""
        return self.optics.trace(*self.grid.mesh(), Dented(self.optics.rest, mirror)).q

    def displacement(self, shown, q) -> np.ndarray:
        """(rows, cols, 2) camera px: where on the target pixels look that look at `q` of the LCD."""
        grid, at = self.grid, np.stack(self.pixels, axis=-1)
        drawn = np.empty(shown.shape, np.float32)
        window_matched(shown, drawn)
        bending = jacobian(shown, grid.spacing_px).reshape(*grid.shape, 4)
        for _ in range(5):
            place = (
                (at[..., 0] - grid.u_px[0]) / grid.spacing_px,
                (at[..., 1] - grid.v_px[0]) / grid.spacing_px,
            )
            off = q - sample(drawn, *place)
            matrix = np.nan_to_num(sample(bending, *place)).reshape(*off.shape, 2) + 1e-12 * np.eye(2)
            at = at + np.clip(np.nan_to_num(np.linalg.solve(matrix, off[..., None])[..., 0]), -1.0, 1.0)
        return at - np.stack(self.pixels, axis=-1)

    def frame(self, number, d, shown, turns, noise, rng) -> FineFrame:
        grid, period = self.grid, self.grid.period_px
        k, window = 2 * np.pi / period, triangle(period)
        phases = [k * (one + d[..., c]) + turns[c] for c, one in enumerate(self.pixels)]
        light = GREY + AMPLITUDE * (np.cos(phases[0]) + np.cos(phases[1]))
        image = light + noise * rng.standard_normal(light.shape)
        if noise:
            image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        for axis in (0, 1):
            d = np.apply_along_axis(np.convolve, axis, d, window, "same")
        inner = np.ix_(*(axis[PADDING:-PADDING].astype(int) for axis in (grid.v_px, grid.u_px)))
        sigma_px = max(noise, 1e-3) * np.sqrt(2) * (window**2).sum() / (AMPLITUDE * k)
        nodes = grid.padded(d[inner] + (noise > 0) * sigma_px * rng.standard_normal(d[inner].shape), 0.0)
        sigma = sigma_px * np.sqrt((jacobian(shown, grid.spacing_px) ** 2).sum(axis=-1))
        flags = np.where(grid.measurable, 0, Flag.OUTSIDE).astype(np.uint16)
        measured = Warp(compose(shown, nodes, grid.spacing_px), sigma, flags, number)
        phase = np.broadcast_to(np.array(turns), (*grid.shape, 2))
        return FineFrame(image, phase, np.ones_like(phase), np.zeros_like(phase), shown, measured, nodes)

    def frames(
        self, mirrors, turns=EIGHT, *, shown=None, noise=0.0, shown_off_px=0.0, rough=0.0, seed=0
    ) -> list[FineFrame]:
        """Frames of a mirror, or of one each, nulled (or `shown`), but for LCD px of scatter per frame.

        rough: (node rows, node cols, 2) LCD px added to what is shown in all of them.
        """
        rng = np.random.default_rng(seed)
        mirrors = mirrors if isinstance(mirrors, list) else [mirrors] * len(turns)
        out = []
        d, last = np.zeros(0), None
        for number, (mirror, pair) in enumerate(zip(mirrors, turns, strict=True)):
            if shown_off_px or mirror is not last:
                warp, last = self.nulled(shown or mirror) + shown_off_px * rng.standard_normal(2), mirror
                warp = warp + rough
                d = self.displacement(warp, self.seen(mirror))
            out.append(self.frame(number, d, warp, pair, noise, rng))
        return out
