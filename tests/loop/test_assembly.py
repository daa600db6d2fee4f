"""What a circle keeps is what its controller says of itself, whatever it is called."""

import pytest
from small_rigs import BENCH_160

from zeromethod import load_rig
from zeromethod.control.composition import Composition
from zeromethod.control.integrator import Integrator
from zeromethod.control.passive import Passive
from zeromethod.loop import assembly
from zeromethod.optics import Optics


@pytest.mark.parametrize(("kind", "keeps"), [(Composition, True), (Integrator, False), (Passive, False)])
def test_order_check_and_coded_pictures_go_with_what_keeps_its_pictures(monkeypatch, kind, keeps):
    rig = load_rig("simulated").replace(BENCH_160, control={"controller": "integrator"})
    monkeypatch.setattr(assembly, "controller_of", lambda _, rest: kind(rest))
    circle = assembly.make_circle(rig, Optics(rig)).circle
    assert [circle._order_check is not None, circle.burst is not None] == [keeps, keeps]
