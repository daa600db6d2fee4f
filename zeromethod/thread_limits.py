"""A limit on the threads of the libraries that a run uses."""

from __future__ import annotations

import cv2
import numba
from threadpoolctl import threadpool_limits

from zeromethod.errors import InputError


def limit_threads(count: int = 1) -> None:
    """Let BLAS, OpenMP, OpenCV and numba use `count` threads each, from now on.

    A later call may raise the count again; numba's ends at the number of threads it was started with.
    The loop is one thread, and its steps are too short to be divided: pools that each take every core
    slow it by contention.

    Parameters
    ----------
    count : int
        Threads for each library.

    Raises
    ------
    InputError
        The environment asks numba for a threading layer that is not there.
    """
    threadpool_limits(limits=count)
    cv2.setNumThreads(count)
    try:
        numba.set_num_threads(min(count, vars(numba.config)["NUMBA_NUM_THREADS"]))
    except ValueError as error:  # which it reads here
        raise InputError(f"NUMBA_THREADING_LAYER (in the environment): {error}") from None
