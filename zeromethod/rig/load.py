"""Reading rig files: TOML in, a checked `Rig` out, or one line that says what is wrong."""

from __future__ import annotations

import tomllib
from pathlib import Path

from zeromethod.resources import resource
from zeromethod.rig.model import Rig


def load_rig(name: str | Path) -> Rig:
    """Rig from a file, or a packaged one by bare name ("simulated", "paper")."""
    path = Path(name)
    if not path.suffix:
        path = resource("calibration", f"{name}.toml")
    return Rig.model_validate(tomllib.loads(path.read_text()))
