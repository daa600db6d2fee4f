"""Short recordings of a small simulated bench."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import pytest
from recorded_run import recorded
from small_rigs import with_tables

from benchmarks.against_peers.open_loop import coarser
from zeromethod import Loop, Peak, Recording, Rig, Step, Surface, load_rig

PRESS = """
[[press]]
shape = "load"
width_mm = 3.5
path = [
    { time_s = 0.15, x_mm = 40.0, y_mm = 0.0, depth_mm = 0.0 },
    { time_s = 0.35, x_mm = 40.0, y_mm = 0.0, depth_mm = 0.1 },
    { time_s = 0.55, x_mm = 40.0, y_mm = 0.0, depth_mm = 0.1 },
    { time_s = 0.85, x_mm = 43.0, y_mm = 0.0, depth_mm = 0.1 },
]
"""
"""Down, held, and away along x at 10 mm/s."""

SECONDS = 0.8


@dataclass
class Session:
    """A recording, and what the run that made it came to before anything was rounded."""

    path: Path
    rig: Rig
    steps: list[Step] = field(default_factory=list)
    readings: dict[int, tuple[Surface, Peak]] = field(default_factory=dict)


def small(**simulation: object) -> Rig:
    """The packaged bench with 8 times larger pixels of camera and LCD."""
    return with_tables(coarser(load_rig("simulated"), 8), simulation=simulation)


@pytest.fixture(scope="session")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A press that comes down, is held and slides; corrections held, and a new zero taken, before it."""
    folder = tmp_path_factory.mktemp("replay")
    press = folder / "press.toml"
    press.write_text(PRESS)
    made = Session(folder / "session.h5", small().model_copy(update={"scenario": str(press)}))

    def on_step(loop: Loop, step: Step) -> None:
        made.steps.append(step)
        loop.freeze(step.number in {30, 31})

    def on_reading(step: Step, surface: Surface, peak: Peak) -> None:
        made.readings[step.number] = surface, peak

    recorded(made.path, SECONDS, rig=made.rig, on_step=on_step, on_reading=on_reading)
    return made


@pytest.fixture
def recording(session: Session) -> Iterator[Recording]:
    with Recording(session.path) as opened:
        yield opened


@pytest.fixture
def damaged(session: Session, tmp_path: Path) -> Callable[..., Path]:
    """Make a copy in which an array of each of these steps (`pictures`: rows) is not what was written."""

    def damage(name: str, *numbers: int) -> Path:
        path = tmp_path / "damaged.h5"
        if not path.exists():
            shutil.copy(session.path, path)
        group = name.rpartition("/")[0]
        with h5py.File(path, "r+", libver="latest") as file:
            known = file[f"{group}/{'row' if group == 'pictures' else 'step'}"][()].tolist()
            for number in numbers:
                item = file[name][known.index(number)]
                item.reshape(-1).view("u1")[100] ^= 1
                file[name][known.index(number)] = item
        return path

    return damage
