"""Render targets and full-screen passes into them."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float, Single
from zeromethod.gl import set_uniforms, unfiltered

Box = tuple[int, int, int, int]
Uniforms = Mapping[str, ArrayLike]


class RenderTarget:
    """A texture of `channels` that can be drawn to; texel row 0 = array row 0.

    dtype: float32 as moderngl names it, or "u4" for unsigned integers, which can only be drawn.
    """

    def __init__(
        self, context: moderngl.Context, size: tuple[int, int], channels: int, dtype: str = "f4"
    ) -> None:
        self.texture = unfiltered(context.texture(size, channels, dtype=dtype))
        self.framebuffer = context.framebuffer(color_attachments=[self.texture])
        self.whole: Box = (0, 0, *size)
        self._channels = channels
        shape = (size[1], size[0]) if channels == 1 else (size[1], size[0], channels)
        self._pixels: Single = np.empty(shape, dtype=np.float32)

    def clear(self, value: float = 0.0) -> None:
        """Set every pixel's first channel."""
        self.framebuffer.scissor = self.whole
        self.framebuffer.clear(red=value)

    def read(self) -> Single:
        """(rows, cols) or (rows, cols, channels); the array is used again by the next call."""
        self.framebuffer.read_into(self._pixels, components=self._channels, dtype="f4")
        return self._pixels

    def release(self) -> None:
        """Free texture and framebuffer."""
        self.framebuffer.release()
        self.texture.release()


class ShaderPass:
    """A program whose fragment shader fills a target; takes over the program."""

    def __init__(
        self, context: moderngl.Context, program: moderngl.Program, values: Uniforms | None = None
    ) -> None:
        self._context = context
        self._program = program
        self._triangle = context.vertex_array(program, [])
        set_uniforms(program, values or {})

    def draw(
        self,
        target: RenderTarget,
        textures: Mapping[str, moderngl.Texture | None],
        values: Uniforms | None = None,
        *,
        add: bool = False,
        box: Box | None = None,
    ) -> None:
        """Fill `target`, or `box` of it (left, bottom, width, height), or add to what is there.

        textures: sampler name -> texture; those that the program lacks and None are passed over.
        """
        context = self._context
        target.framebuffer.use()
        target.framebuffer.scissor = box or target.whole
        context.enable_only(moderngl.BLEND if add else moderngl.NOTHING)
        if add:
            context.blend_func = moderngl.ONE, moderngl.ONE
        units = {}
        for unit, (name, texture) in enumerate(textures.items()):
            if texture is not None:
                texture.use(unit)
                units[name] = unit
        set_uniforms(self._program, {**units, **(values or {})})
        self._triangle.render(moderngl.TRIANGLES, vertices=3)
        context.enable_only(moderngl.NOTHING)

    def release(self) -> None:
        """Free the program."""
        self._triangle.release()
        self._program.release()


def constants(values: Uniforms) -> str:
    """GLSL of float constants, on one line: name -> number, vector (2 to 4) or vectors (n, 2 to 4)."""
    return " ".join(_constant(name, np.asarray(value, dtype=np.float64)) for name, value in values.items())


def _constant(name: str, value: Float) -> str:
    kind = f"vec{value.shape[-1]}" if value.ndim else "float"
    if value.ndim < 2:
        return f"const {kind} {name} = {kind}({_listed(value)});"
    vectors = ", ".join(f"{kind}({_listed(vector)})" for vector in value)
    return f"const {kind} {name}[{len(value)}] = {kind}[]({vectors});"


def _listed(numbers: Float) -> str:
    return ", ".join(f"{number:.9e}" for number in numbers.ravel())
