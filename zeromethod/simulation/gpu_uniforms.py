"""Handing numbers to shader programs."""

from __future__ import annotations

from collections.abc import Mapping

import moderngl
import numpy as np
from numpy.typing import ArrayLike

from zeromethod.arrays import Float

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
