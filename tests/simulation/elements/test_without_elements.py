"""Benches whose rubber is no prism held at its faces need no finite elements, and no library for them."""

import subprocess
import sys

import pytest

from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig, packaged_rigs
from zeromethod.simulation.elements.prism import prism_kernel
from zeromethod.simulation.scenario import scenario_of


@pytest.mark.parametrize("name", packaged_rigs())
def test_no_packaged_rig_needs_elements(name, monkeypatch, tmp_path):
    for part in ("elasticity", "section"):
        monkeypatch.setitem(sys.modules, f"zeromethod.simulation.elements.{part}", None)
    monkeypatch.setenv("ZEROMETHOD_CACHE", str(tmp_path))
    prism_kernel.cache_clear()
    scenario_of(load_rig(name))


def test_the_library_of_elements_loads_only_where_a_body_is_solved():
    program = (
        "import sys; from zeromethod.rig.load import load_rig;"
        "from zeromethod.simulation.scenario import scenario_of;"
        "scenario_of(load_rig('simulated')).mirror_at(700_000_000); print('skfem' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_without_the_library_a_rig_held_at_its_faces_is_refused_in_one_line(monkeypatch):
    for name in ("elasticity", "section"):
        monkeypatch.setitem(sys.modules, f"zeromethod.simulation.elements.{name}", None)
    rig = load_rig("simulated").replace({"rubber.support": {"camera": "sliding"}})
    with pytest.raises(InputError) as caught:
        scenario_of(rig)
    assert str(caught.value).startswith("rubber.support: per face only with finite elements: pip install")
    assert "\n" not in str(caught.value)
