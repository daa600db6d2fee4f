"""Values of a grid and draws of a Monte Carlo."""

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.study.axes import axis_values, draw, run_seed


def test_a_range_ends_where_it_says():
    assert axis_values("a", {"from": 0, "to": 0.5, "steps": 6}) == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert axis_values("a", {"from": 1, "to": 100, "steps": 3, "scale": "log"}) == [1.0, 10.0, 100.0]


@pytest.mark.parametrize(
    "given",
    [
        [],
        3,
        {"from": 0, "to": 1},
        {"from": 0, "to": 1, "steps": 1},
        {"from": 0, "to": 1, "steps": 3, "scale": "log"},
        {"from": "a", "to": 1, "steps": 3},
        {},
    ],
)
def test_axes_that_are_none_are_refused_by_their_key(given):
    with pytest.raises(InputError, match=r"^grid\.x: "):
        axis_values("grid.x", given)


def test_a_draw_depends_on_seed_key_and_number_alone():
    given = {"normal": [2.0, 0.5]}
    assert draw("r", given, 1, "a", 5) == draw("r", given, 1, "a", 5)
    others = {draw("r", given, *other) for other in ((2, "a", 5), (1, "b", 5), (1, "a", 6))}
    assert draw("r", given, 1, "a", 5) not in others
    assert len(others) == 3


def test_draws_have_the_distribution_asked_for():
    normal = np.array([draw("r", {"normal": [2.0, 0.5]}, 1, "a", n) for n in range(400)])
    # four standard errors of mean (0.025) and of standard deviation (0.018)
    assert abs(normal.mean() - 2.0) < 0.1
    assert abs(normal.std() - 0.5) < 0.072
    log = np.array([draw("r", {"log_uniform": [1.0, 100.0]}, 1, "a", n) for n in range(400)])
    # half of it lies below the geometric mean; four standard errors of a share
    assert abs(np.mean(log < 10.0) - 0.5) < 0.1
    assert log.min() >= 1.0
    assert log.max() <= 100.0
    assert {draw("r", {"choice": ["a", "b"]}, 1, "k", n) for n in range(20)} == {"a", "b"}


@pytest.mark.parametrize(
    "given", [1.0, {"normal": [1.0, 0.0]}, {"uniform": [2, 1]}, {"choice": []}, {"beta": [1, 2]}, {}]
)
def test_distributions_that_are_none_are_refused(given):
    with pytest.raises(InputError, match=r"^random\.x: "):
        draw("random.x", given, 1, "x", 0)


def test_seeds_of_runs_differ():
    assert len({run_seed(7, run) for run in range(1000)}) == 1000
    assert run_seed(7, 3) != run_seed(8, 3)
