"""Compiled functions that Python calls, each for one list of types, compiled when its module is imported.

A function is compiled where a profile shows that numpy takes over 0.3 ms a frame longer (`python -m
benchmarks.kernels`). What only other compiled functions call is a `piece`, whose types are its callers'.

    @kernel(read(numba.float64, 1), numba.float64[::1])
    def _double(values, doubled):
        for i in range(len(values)):
            doubled[i] = 2.0 * values[i]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba import types
from numba.np.numpy_support import as_dtype

import zeromethod.compiling  # noqa: F401 - tells of what must be compiled, and does it on every core

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}


def piece(function: Any = None, **options: Any) -> Any:
    """Compile what only other compiled functions call: `@piece`, or `@piece(...)` with numba's options."""
    return numba.njit(function, **(_OPTIONS | options))


def read(kind: Any, dimensions: int) -> types.Array:
    """Type of an array that is only read: one that is strided or of another type is copied on its way in."""
    return types.Array(kind, dimensions, "C", readonly=True)


class Kernel:
    """A compiled function that Python calls."""

    def __init__(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]
    ) -> None:
        self.compiled = numba.njit(arguments, **(_OPTIONS | options))(function)
        self.__doc__, self.__name__, self.__module__ = (
            function.__doc__,
            function.__name__,
            function.__module__,
        )
        self.py_func = function
        self._reads = tuple(
            (place, as_dtype(one.dtype))
            for place, one in enumerate(arguments)
            if isinstance(one, types.Array) and not one.mutable
        )

    def __call__(self, *arguments: Any) -> Any:
        """Run it. Raises TypeError where an array that it writes to has another type or is not contiguous."""
        given = list(arguments)
        for place, dtype in self._reads:
            given[place] = np.ascontiguousarray(given[place], dtype)
        return self.compiled(*given)


def kernel(*arguments: Any, **options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Compile a function for these types: numba's scalars, `read(kind, dimensions)`, `kind[:, ::1]` to write.

    options: as `numba.njit` has them; division by zero gives inf or NaN, as in numpy, and no error.
    """
    return lambda function: Kernel(function, arguments, options)
