"""Small, quick benches for the tests of the simulation."""

from collections.abc import Callable
from typing import Any

import pytest

from zeromethod import InputError, Rig, binned, load_rig
from zeromethod.simulation.scenario import load_scenario

MakeRig = Callable[..., Rig]


@pytest.fixture(scope="session")
def make_rig() -> MakeRig:
    """Rig with a 64 x 80 camera and a 480 x 270 LCD; keyword per table, a dict of its changes."""
    lcd = {"display.columns": 480, "display.rows": 270, "display.pitch_mm": 0.252}
    base = binned(load_rig("simulated"), 16).replace(
        lcd | {"camera.psf_px": 0.0, "simulation.renderer": "numpy"}
    )

    def make(press: str = "none", faults: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Rig:
        changes = {f"{table}.{key}": value for table, keys in tables.items() for key, value in keys.items()}
        return base.replace(changes | {"scenario": press, "simulation.faults": faults or None})

    return make


@pytest.fixture
def refusal(tmp_path) -> Callable[[str], str]:
    """The line by which a press file of a text is refused, behind the file's name."""

    def line(text: str) -> str:
        file = tmp_path / "mine.toml"
        file.write_text(text)
        with pytest.raises(InputError) as caught:
            load_scenario(file)
        start, message = str(caught.value).split(": ", 1)
        assert start == str(file)
        assert "\n" not in message
        return message

    return line
