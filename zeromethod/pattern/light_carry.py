"""Codes summed as light in time: what rounding left out goes into an LCD pixel's next picture.

A pixel is to give the light w_k in picture k and owes c_(k-1) from those before. It shows the whole code
nearest to the light w_k + c_(k-1) by the panel's measured response, of light l_k, and then owes

    c_k = c_(k-1) + w_k - l_k,

half a code's light at most. Of N pictures the mean light is wrong by c_N / N: a mean of frames gets better as
1 / N, where a picture that stays is wrong for ever. What is owed is forgotten where another picture is shown.
"""

from __future__ import annotations

import moderngl
import numpy as np

from zeromethod.gl import float_texture, program, set_uniforms
from zeromethod.gl.values import unfiltered
from zeromethod.pattern.response import Response

FORGET_ABOVE = 0.6
"""Change of a pixel's light from picture to picture above which it owes nothing: a moving target's is 0.53 at
most, with 8 pictures per period and all of the light."""

MOST_OWED = 0.01
"""Light owed at most: half a code near white is 0.005, and what the panel cannot give is not saved up."""


class LightCarry:
    """Keeps what every LCD pixel owes: code, light wanted and light owed of the last two pictures.

    size: (columns, rows) of the LCD. units: texture units of its own, for what was kept and for the light of
    the codes. All objects live in `ctx`, which must be current in every call.
    """

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], response: Response, units: tuple[int, int]
    ) -> None:
        self._ctx, self._size, self._units = ctx, size, units
        # 11 bits hold whole codes, and what is owed to 2e-6 of the light
        self._kept = [unfiltered(ctx.texture(size, 4, dtype="f2")) for _ in range(2)]
        self._targets = [ctx.framebuffer([one]) for one in self._kept]
        self._light = float_texture(ctx, response.light(np.arange(256.0)).astype(np.float32)[None])
        self._program = program(ctx, "pattern.vert", "pattern_shown.frag")
        set_uniforms(self._program, {"kept": units[0], "bounds": (-1.0, -1.0, 1.0, 1.0)})
        self._rectangle = ctx.vertex_array(self._program, [])
        self._newest = 0
        for target in self._targets:
            target.clear()

    def begin(self, code: float, light: float) -> None:
        """Make ready to draw the next picture, which is `code` of `light` where nothing is drawn."""
        self._kept[self._newest].use(self._units[0])
        self._light.use(self._units[1])
        self._newest = 1 - self._newest
        target = self._targets[self._newest]
        target.use()
        target.viewport = (0, 0, *self._size)
        target.clear(code, light, 0.0, 1.0)

    def show(self) -> None:
        """Draw the picture just drawn into the framebuffer that is bound."""
        self._kept[self._newest].use(self._units[0])
        self._rectangle.render(moderngl.TRIANGLE_STRIP, vertices=4)
