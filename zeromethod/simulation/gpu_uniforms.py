"""Handing numbers to shader programs."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np
from numpy.typing import ArrayLike

Uniforms = Mapping[str, ArrayLike]


def set_uniforms(program: moderngl.Program, values: Uniforms) -> None:
    """Set those of `values` (name -> number, vector or array of vectors) that the program uses.

    An array may be longer than the program's; integers go to int uniforms and sampler units, all else as
    float32.
    """
    for name, value in values.items():
        uniform = program.get(name, None)
        if not isinstance(uniform, moderngl.Uniform):
            continue
        numbers = np.asarray(value)
        kind = np.int32 if np.issubdtype(numbers.dtype, np.integer) else np.float32
        wanted = uniform.dimension * uniform.array_length
        uniform.write(np.ascontiguousarray(numbers.ravel()[:wanted], dtype=kind).tobytes())
