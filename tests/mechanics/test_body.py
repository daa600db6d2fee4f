"""The reader's own way to what a prism adds to a half-space: against elements, and by reciprocity."""

import numpy as np
import pytest

from zeromethod.mechanics.body import body_of
from zeromethod.rig.load import load_rig
from zeromethod.simulation.elements.correction import mirror_response
from zeromethod.simulation.elements.prism import HeldPrism

RIG = load_rig("simulated")
PLACES = np.array([[20.0, 30.0, 42.0, 55.0, 60.0], [-14.0, 3.0, 18.0, -6.0, 10.0]])
LOADS = np.array([[25.0, 42.0, 58.0], [6.0, -10.0, 1.0]])


@pytest.mark.parametrize(
    "support",
    [
        {"pattern": "bonded", "camera": "bonded", "ends": "free"},
        {"pattern": "sliding", "camera": "bonded", "ends": "sliding"},
    ],
    ids=["bonded", "sliding"],
)
def test_it_is_that_of_the_body_in_elements(support):
    rig = RIG.replace({"rubber.support": support})
    kernel = body_of(rig)
    assert kernel is not None
    poisson = rig.rubber.poisson
    # elements half as fine as the simulated bench's: a few per mille off themselves
    body = HeldPrism.of(rig.prism, rig.rubber.support, poisson)
    coarse = HeldPrism(
        *(getattr(body, key) for key in body.__dataclass_fields__ if key != "refined"), 0.5
    ).body
    exact = mirror_response(coarse, LOADS, PLACES) * np.pi / (1 - poisson**2)
    # products below 1e-3 of the first are left out, and each of several may add as much
    np.testing.assert_allclose(kernel.added(PLACES, LOADS), exact, atol=0.01 * np.abs(exact).max())


def test_a_load_does_at_another_place_what_that_place_would_do_to_it():
    """Betti's reciprocity, which no step of the way assumes."""
    kernel = body_of(RIG.replace({"rubber.support": {"pattern": "bonded", "ends": "bonded"}}))
    there = kernel.added(PLACES, LOADS)
    np.testing.assert_allclose(there, kernel.added(LOADS, PLACES).T, atol=0.01 * np.abs(there).max())


def test_slopes_are_those_of_the_depths():
    kernel = body_of(RIG.replace({"rubber.support": {}}))
    x, y = PLACES
    products, step = kernel.products(x, y), 1e-4
    for k, (dx, dy) in enumerate(((step, 0.0), (0.0, step)), start=1):
        by = (kernel.products(x + dx, y + dy)[0] - kernel.products(x - dx, y - dy)[0]) / (2 * step)
        np.testing.assert_allclose(products[k], by, atol=1e-6 * np.abs(products[k]).max())


def test_a_rig_that_does_not_say_what_holds_its_rubber_has_none():
    assert body_of(RIG) is None
