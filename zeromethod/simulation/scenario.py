"""Scenario of a simulated run: the true mirror at every instant."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from zeromethod.resources import resource
from zeromethod.rig.model import Rig
from zeromethod.rig.prism_tables import Prism, RestSurface
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.cloth import Cloth, cloth_of
from zeromethod.simulation.contact.bow import on_rest
from zeromethod.simulation.contact.compliance import Compliance
from zeromethod.simulation.contact.path import ObjectPath
from zeromethod.simulation.contact.scene import scene_of
from zeromethod.simulation.load_path import LoadPath, dents_of
from zeromethod.simulation.path import Press
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.press_file import Phase, read_press_file

RUBBER, FLAT = Rubber(), RestSurface()
"""What loads and objects press on where no rig says."""


@dataclass(frozen=True)
class Scenario:
    """Presses as they move, and the names of the run's parts.

    duration_s: how long a run of it lasts. phases: marks for a report ("hold", "slide"); they change
    nothing in the physics. presses: dents by formula or map, whatever the rubber. loads: what presses the
    rubber. objects: hard ones, solved in contact with it. prism: that of the rubber, with its mirror at rest;
    None for a flat mirror. cloth: what lies on it.
    """

    name: str
    presses: tuple[Press, ...]
    duration_s: float
    phases: tuple[Phase, ...] = ()
    objects: tuple[ObjectPath, ...] = ()
    rubber: Rubber = RUBBER
    prism: Prism | None = None
    cloth: Cloth | None = None
    loads: tuple[LoadPath, ...] = ()

    def mirror_at(self, time_ns: int) -> Mirror:
        """Return the mirror at `time_ns`; mirrors that are alike compare equal."""
        dents = [press.dent_at(time_ns) for press in self.presses]
        pressed = [load.pressed_at(time_ns) for load in self.loads]
        dents += dents_of([each for each in pressed if each is not None], self.rubber, self.prism)
        held = (each.held_at(time_ns) for each in self.objects)
        rest = FLAT if self.prism is None else self.prism.rest
        objects = [on_rest(each, rest) for each in held if each is not None]
        scene = scene_of(objects, self.rubber, self.prism)
        return Mirror(
            (*(dent for dent in dents if dent is not None), *scene.dents), scene.touches, self.cloth
        )

    def bends_ns(self, from_ns: int, to_ns: int) -> tuple[int, ...]:
        """Times inside (from, to) at which any press jumps or changes its velocity, rising."""
        return tuple(sorted({time for press in self._moved for time in press.bends_ns(from_ns, to_ns)}))

    def moving(self, from_ns: int, to_ns: int) -> bool:
        """Whether the mirror changes continuously anywhere inside (from, to); jumps do not count."""
        return any(press.moving(from_ns, to_ns) for press in self._moved)

    @property
    def _moved(self) -> tuple[Press | LoadPath | ObjectPath, ...]:
        return (*self.presses, *self.loads, *self.objects)

    def phase_at(self, time_ns: int) -> str | None:
        """Name of the part of the run that `time_ns` lies in."""
        for phase in self.phases:
            if phase.from_s <= time_ns * 1e-9 < phase.to_s:
                return phase.name
        return None


def load_scenario(name: str | Path, rubber: Rubber = RUBBER, prism: Prism | None = None) -> Scenario:
    """Scenario from a press file, or a packaged one by bare name ("default", "step", "none", ...).

    rubber, prism: what loads and hard objects press on, a rig's.
    Raises InputError with one line: file, key, value, what is allowed.
    """
    path = Path(name)
    if not path.suffix and path.name == str(name):
        path = resource("calibration", "presses", f"{name}.toml")
    file = read_press_file(path, asked=str(name))
    return Scenario(
        path.stem, file.presses, file.duration_s, file.phases, file.objects, rubber, prism, loads=file.loads
    )


def scenario_of(rig: Rig) -> Scenario:
    """Scenario that a rig names, on its rubber.

    What its prism adds to a half-space is worked out here, not under the first press. Raises InputError as
    `load_scenario`, and where that needs a library that is not installed.
    """
    scenario = replace(load_scenario(rig.scenario, rig.rubber, rig.prism), cloth=cloth_of(rig))
    if scenario.loads or scenario.objects:
        Compliance(rig.rubber, rig.prism).body  # noqa: B018 - kept
    return scenario
