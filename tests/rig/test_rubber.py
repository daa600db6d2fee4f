"""`[rubber]`: what holds it, that this may be unknown, and what is no elastic body."""

import pytest

from zeromethod import InputError, load_rig
from zeromethod.mechanics.yielding import Yielding
from zeromethod.rig.model import Rig
from zeromethod.rig.tables import FaceSupports, Rubber


def rig(**rubber: object) -> Rig:
    return load_rig("simulated").replace({"rubber": rubber})


def test_a_support_that_is_not_given_is_not_known():
    assert rig().rubber.support is None
    assert Rubber().support is None
    assert load_rig("simulated").replace({"rubber.support": None}).rubber.support is None
    assert rig(support="free").rubber.support == "free"
    assert rig(support={}).rubber.support == FaceSupports()


@pytest.mark.parametrize("rubber", [Rubber(), Rubber(support=None)], ids=["missing", "None"])
def test_forces_on_rubber_held_by_who_knows_what_allow_for_a_base(rubber):
    bench = load_rig("simulated").model_copy(update={"rubber": rubber})
    read = Yielding.of(bench)
    assert (read.layer, read.body) == (None, None)
    assert read.other is not None
    # the prism's apex is where its two faces of 50 degrees meet under the mirror's middle
    assert read.other.thickness_mm == pytest.approx(60 * 0.7660444, rel=1e-3)
    assert Yielding.of(bench.replace({"rubber": {"support": "free"}})).other is None


def test_what_is_no_elastic_body_has_nothing_that_holds_it():
    assert rig(body="none").rubber.body == "none"
    assert rig().rubber.body == "elastic"


@pytest.mark.parametrize(
    ("rubber", "said"),
    [
        ({"body": "gel"}, 'rubber.body: "gel": one of "elastic", "none"'),
        ({"body": "none", "support": "free"}, "rubber.support: \"free\": not given with rubber.body 'none'"),
        ({"body": "none", "support": {}}, "rubber.support: a table: not given with rubber.body 'none'"),
        ({"body": "none", "thickness_mm": 7.0}, "rubber.thickness_mm: 7.0: not given with rubber.body"),
        ({"body": "none", "youngs_modulus_mpa": 1.0}, "rubber.youngs_modulus_mpa: 1.0: not given with"),
        ({"thickness_mm": 7.0}, "rubber.thickness_mm: 7.0: only with support 'bonded' or 'sliding'"),
        ({"support": {}, "thickness_mm": 7.0}, "rubber.thickness_mm: 7.0: only with support 'bonded'"),
        ({"support": "bonded"}, "rubber.thickness_mm: missing: a number above 0 for support 'bonded'"),
    ],
)
def test_what_does_not_go_together_is_refused_in_one_line(rubber, said):
    with pytest.raises(InputError) as refusal:
        rig(**rubber)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
