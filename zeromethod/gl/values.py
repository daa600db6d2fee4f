"""Numbers on their way to shaders: float textures and uniforms."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray


def unfiltered(texture: moderngl.Texture) -> moderngl.Texture:
    """`texture`, set to give single texels, those of its border beyond it."""
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    texture.repeat_x = texture.repeat_y = False
    return texture


def float_texture(context: moderngl.Context, values: NDArray[np.floating]) -> moderngl.Texture:
    """(rows, cols) or (rows, cols, channels) as float32, row 0 at texel row 0, not filtered."""
    size, channels = values.shape[1::-1], values.shape[2] if values.ndim == 3 else 1
    data = np.ascontiguousarray(values, dtype=np.float32)
    return unfiltered(context.texture(size, channels, data.tobytes(), dtype="f4"))


def set_uniforms(program: moderngl.Program, values: Mapping[str, ArrayLike]) -> None:
    """Set those of `values` (name -> number, vector or array of vectors) that the program uses.

    An array may be longer than the program's.
    """
    for name, value in values.items():
        uniform = program.get(name, None)
        if isinstance(uniform, moderngl.Uniform):
            wanted = uniform.dimension * uniform.array_length
            # the last letter of a format such as "2f" is the type of its numbers
            uniform.write(np.ravel(value)[:wanted].astype(uniform.fmt[-1]).tobytes())  # type: ignore[attr-defined]
