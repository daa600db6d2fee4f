"""What a run gives its page: steps as they come, and the surfaces read from them."""

from __future__ import annotations

from zeromethod.clock import Clock
from zeromethod.loop.step import Step
from zeromethod.operating.readings import Readings
from zeromethod.page.fine_maps import FineMaps
from zeromethod.page.message import Content, Said, unix_ms
from zeromethod.page.process import PageProcess
from zeromethod.page.run_content import RunContent, lattice_of
from zeromethod.session.session import Session


def starting(words: str) -> Content:
    """Content while a run starts: what it is doing."""
    values = {"state": "starting", "reason": words, "advice": "", "fresh": False}
    return Content(values)


class RunFeed:
    """Hands the newest step of a session, and the newest that was read, to its page."""

    def __init__(self, page: PageProcess, session: Session, readings: Readings, clock: Clock) -> None:
        self._page, self._session, self._readings, self._clock = page, session, readings, clock
        self._live, self._bits = session.loop.live, session.rig.camera.bits
        self._lattice = lattice_of(session.loop.grid)
        self._read: Step | None = None
        self._fine: FineMaps | None = None
        page.draw_by((session.rig, session.loop.rest))

    def see(self, step: Step, said: tuple[str, ...]) -> None:
        """Show a step, and what happened in it."""
        self._page.time_s = step.time_s
        if step.surface is not None:
            self._read = step
        if step.fine is not None:
            at_s = self._readings.values["fine_time_s"]
            self._fine = FineMaps(step.fine, at_s, step.number, self._lattice["image"])
        for words in said:
            self._page.say(Said("state" if words.startswith(f"{step.state}") else "note", words, step.time_s))
        stages = {}
        if self._live:
            now_ms = unix_ms()
            age_ms = 1e-6 * (self._clock.now_ns() - step.time_ns)
            stages = {"exposed": now_ms - age_ms, "stepped": now_ms}
        maps = self._lattice, self._fine, self._session.interaction.picture
        newest = RunContent(self._readings, step, self._read, stages, self._bits, *maps)
        self._page.offer(newest.compose)
