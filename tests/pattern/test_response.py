import numpy as np
import pytest

from zeromethod import InputError, load_rig
from zeromethod.pattern import Response


@pytest.mark.parametrize("response", [Response(), Response(2.2), Response(1, (0.01, 0.1, 0.4, 0.9))])
def test_inverse_undoes_the_response(response):
    codes = np.linspace(0, 255, 511)
    np.testing.assert_allclose(response.inverse(response.light(codes)), codes, atol=1e-9)  # rounding


def test_light_out_of_reach_gives_the_nearest_code():
    response = Response(1, (0.1, 0.5, 0.9))
    assert np.array_equal(response.inverse([0, 0.05, 0.95, 1]), [0, 0, 255, 255])


def test_table_stays_within_a_two_hundredth_code():
    response = Response(2.2)
    light = np.linspace(1e-4, 1, 5000)
    place = np.sqrt(light) * (len(response.table) - 1)
    codes = np.interp(place, np.arange(len(response.table)), response.table)
    assert np.abs(codes - response.inverse(light)).max() < 5e-3


def test_response_of_the_packaged_rig_is_its_power_law():
    response = Response.from_rig(load_rig("simulated").display)
    assert response.light(127.5) == pytest.approx(0.5**2.2)


def test_response_that_does_not_rise_is_refused():
    with pytest.raises(InputError, match="response_light"):
        Response(1, (0.0, 0.5, 0.5, 1.0))


def test_every_place_is_drawn_by_its_own_inverse():
    response = Response(2.2, exponent=((0.9, 1.0, 1.1), (1.0, 1.0, 1.2)))
    light = np.full((5, 9), 0.3)
    codes = response.picture(light)
    for (row, column), exponent in {(0, 0): 0.9, (0, 4): 1.0, (0, 8): 1.1, (4, 8): 1.2, (2, 8): 1.15}.items():
        # half a code is the best that whole codes can do
        assert abs(codes[row, column] - 255 * 0.3 ** (1 / (2.2 * exponent))) <= 0.5 + 1e-9
