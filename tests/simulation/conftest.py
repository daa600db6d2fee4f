"""Small, quick benches for the tests of the simulation."""

from collections.abc import Callable
from typing import Any

import pytest

from zeromethod.rig.binning import binned
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig

MakeRig = Callable[..., Rig]


def _changed(table: Any, **update: Any) -> Any:
    return type(table).model_validate({**table.model_dump(), **update})


@pytest.fixture(scope="session")
def make_rig() -> MakeRig:
    """Rig with a 64 x 80 camera and a 480 x 270 LCD; keyword per table, a dict of its changes."""
    base = binned(load_rig("simulated"), 16)

    def make(press: str = "none", faults: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Rig:
        display = {"columns": 480, "rows": 270, "pitch_mm": 0.252} | tables.get("display", {})
        camera = {"psf_px": 0.0} | tables.get("camera", {})
        simulation = {"renderer": "numpy"} | tables.get("simulation", {})
        if faults:
            simulation["faults"] = faults
        update = {
            "display": _changed(base.display, **display),
            "camera": _changed(base.camera, **camera),
            "simulation": _changed(base.simulation, **simulation),
            "scenario": press,
        }
        return base.model_copy(update=update)

    return make
