"""Compiled functions get what they were compiled for, whatever arrays they are given."""

import numba
import numpy as np
import pytest

from zeromethod.kernels import kernel, read


@kernel(read(numba.float64, 2), numba.float64, numba.float64[::1])
def _add_rows(values, more, sums):
    for i in range(len(values)):
        sums[i] = more
        for j in range(values.shape[1]):
            sums[i] += values[i, j]


def read_only(values):
    values = values.copy()
    values.flags.writeable = False
    return values


GIVEN = np.arange(6.0).reshape(2, 3)


@pytest.mark.parametrize(
    "values",
    [GIVEN, read_only(GIVEN), GIVEN.T.copy().T, np.repeat(GIVEN, 2, axis=1)[:, ::2], GIVEN.astype(np.uint8)],
    ids=["as it is", "read-only", "columns first", "strided", "bytes"],
)
def test_what_is_only_read_may_lie_anyhow(values):
    sums = np.empty(2)
    _add_rows(values, 1, sums)
    np.testing.assert_array_equal(sums, [4.0, 13.0])


@pytest.mark.parametrize(
    "sums",
    [np.empty(4)[::2], read_only(np.empty(2)), np.empty(2, np.float32)],
    ids=["strided", "read-only", "float32"],
)
def test_what_is_written_must_be_as_declared(sums):
    with pytest.raises(TypeError):
        _add_rows(GIVEN, 1.0, sums)


def test_division_by_zero_is_as_in_numpy():
    @kernel(numba.float64, numba.float64)
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == np.inf
