import numpy as np
import pytest

from zeromethod.surface.differences import derivative_table, integral_table


def test_centred_rules_are_the_published_ones():
    table = integral_table()
    np.testing.assert_allclose(table[2, 0, :2], [1 / 2, 1 / 2], atol=1e-14)
    np.testing.assert_allclose(24 * table[4, 1, :4], [-1, 13, 13, -1], atol=1e-11)
    np.testing.assert_allclose(1440 * table[6, 2, :6], [11, -93, 802, 802, -93, 11], atol=1e-9)
    derivative = derivative_table()
    np.testing.assert_allclose(60 * derivative[7, 3], [-1, 9, -45, 0, 45, -9, 1], atol=1e-10)


@pytest.mark.parametrize("points", [2, 3, 4, 5, 6])
def test_rules_are_exact_for_polynomials_up_to_their_points(points):
    nodes = np.arange(points)
    for power in range(points):
        for at in range(points - 1):
            exact = ((at + 1.0) ** (power + 1) - float(at) ** (power + 1)) / (power + 1)
            # rounding of powers up to 5^5
            assert integral_table()[points, at, :points] @ nodes**power == pytest.approx(exact, abs=1e-9)
        for at in range(points):
            exact = power * float(at) ** max(power - 1, 0)
            assert derivative_table()[points, at, :points] @ nodes**power == pytest.approx(exact, abs=1e-8)
