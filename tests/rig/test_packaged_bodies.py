"""What elements say of the packaged rigs' rubber is shipped: a first start works nothing out."""

import pytest

from zeromethod import load_rig
from zeromethod.mechanics import body
from zeromethod.rig.load import packaged_rigs
from zeromethod.rig.tables import FaceSupports
from zeromethod.simulation.elements import prism

HELD = [name for name in packaged_rigs() if isinstance(load_rig(name).rubber.support, FaceSupports)]


@pytest.mark.parametrize("name", HELD)
def test_the_rubber_of_a_packaged_rig_is_read_from_files_that_are_shipped(name, tmp_path, monkeypatch):
    def worked_out(*_):
        pytest.fail("python -m tools.packaged_bodies makes the files anew")

    monkeypatch.setenv("ZEROMETHOD_CACHE", str(tmp_path))
    monkeypatch.setattr(prism, "mirror_response", worked_out)
    monkeypatch.setattr(body, "mirror_response", worked_out)
    prism.prism_kernel.cache_clear()
    body._kernel.cache_clear()
    rig = load_rig(name)
    held = prism.HeldPrism.of(rig.prism, rig.rubber.support, rig.rubber.poisson)
    assert prism.prism_kernel(held).coefficients.any()
    assert body.body_of(rig) is not None
    assert list(tmp_path.iterdir()) == []


def test_one_of_them_is_held():
    assert "paper" in HELD
