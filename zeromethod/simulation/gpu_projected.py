"""A projector's picture on the cloth, drawn into the camera's light by bench_projected.frag."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from zeromethod.arrays import Single
from zeromethod.gl import float_texture, program
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu_bench import mirror_middle_mm
from zeromethod.simulation.gpu_target import RenderTarget, ShaderPass
from zeromethod.simulation.projected import true_map


class ProjectedLight:
    """Adds pictures by the ways that a `RayMap` has for them; one is uploaded where it is another array."""

    def __init__(self, context: moderngl.Context, rig: Rig) -> None:
        self._context = context
        x, y, _ = mirror_middle_mm(rig.prism)
        self._to_px = true_map(rig) @ np.array([[1, 0, x], [0, 1, y], [0, 0, 1]])
        self._pass = ShaderPass(context, program(context, "bench_screen.vert", "bench_projected.frag"))
        self._picture: moderngl.Texture | None = None
        self._of: Single | None = None

    def draw(
        self, light: RenderTarget, ways: Sequence[RenderTarget | None], luminance: Single, share: float
    ) -> None:
        """Add a picture's light, luminance (projector rows, cols), times the share of the exposure."""
        if self._picture is None:
            self._picture = float_texture(self._context, luminance)
        elif luminance is not self._of:
            self._picture.write(np.ascontiguousarray(luminance, np.float32).tobytes())
        self._of = luminance
        for way in ways:
            if way is not None:
                textures = {"way": way.texture, "picture": self._picture}
                self._pass.draw(light, textures, {"to_px": self._to_px, "scale": share}, add=True)

    def release(self) -> None:
        """Free everything."""
        self._pass.release()
        if self._picture is not None:
            self._picture.release()
