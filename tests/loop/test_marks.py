"""Marks on the prism's frame: a camera that turned is distinguished from a press while the press lasts."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_rigs import SMALL_LCD, quarter, with_tables

from zeromethod import Event, InputError, Loop, State, open_devices
from zeromethod.devices.protocols import Frame
from zeromethod.rig.model import Faults, Rig
from zeromethod.simulation.bump import moved_share

BUMP = 28
LOCKED = 24
"""Frame by which scenario "step", which presses from the twelfth on, is nulled."""

MARKS = ((30.4, 60.2), (30.0, 128.0), (31.3, 190.7))
GOOD = {State.LOCKED, State.RESTING}


def wide(press: str, pan_px: float = 0.0, **surface: Any) -> Rig:
    """The small bench with a camera whose left 96 columns see no LCD, turned sideways at frame `BUMP`."""
    bench = quarter(display=SMALL_LCD, camera={"columns": 440, "centre_px": (279.5, 127.5)}, scenario=press)
    turn_deg = float(np.degrees(np.arctan(pan_px / bench.camera.focal_px[0])))
    faults = Faults(moved_at_frame=BUMP if pan_px else None, camera_turned_deg=(turn_deg, 0.0, 0.0))
    return with_tables(bench, surface={"marks_px": MARKS, **surface}, simulation={"faults": faults})


class Marked:
    """A simulated camera before which discs are printed, that go as a pinhole sees them when it turns."""

    covered_from: int | None = None
    """Frame from which something hides the first mark."""

    def __init__(self, camera: Any, rig: Rig, discs: tuple[tuple[float, float], ...]) -> None:
        self._camera, self._rig, self._discs = camera, rig, discs
        self._noise = np.random.default_rng(6)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._camera, name)

    def read(self, timeout_s: float) -> Frame:
        frame: Frame = self._camera.read(timeout_s)
        camera, image = self._rig.camera, frame.image.copy()
        turn = np.radians(self._rig.simulation.faults.camera_turned_deg[0])
        by_px = -camera.focal_px[0] * np.tan(turn) * moved_share(self._rig, frame.number)
        v, u = np.mgrid[: image.shape[0], :64]
        grey = np.full(u.shape, 30.0)
        for u_px, v_px in self._discs:
            beyond_px = np.hypot(u - u_px - by_px, v - v_px) - 6.0
            grey += 90.0 / (1.0 + np.exp(2.4 * beyond_px / camera.psf_px))
        if self.covered_from is not None and frame.number >= self.covered_from:
            # a hand that comes in from the left, 3 px a frame
            u_px, v_px = self._discs[0]
            hand_px = u_px - 30.0 + 3.0 * (frame.number - self.covered_from)
            grey[(np.abs(v - v_px) < 25.0) & (u < hand_px)] = 100.0
        grey += 2.0 * self._noise.standard_normal(grey.shape)
        image[:, :64] = np.rint(np.clip(grey, 0.0, 255.0))
        return replace(frame, image=image)


@contextmanager
def loop_of(rig: Rig, discs: tuple[tuple[float, float], ...] = MARKS) -> Iterator[tuple[Loop, Marked]]:
    with open_devices(rig) as devices:
        marked = Marked(devices.camera, rig, discs)
        with Loop(rig, marked, devices.display, devices.clock) as loop:
            yield loop, marked


# a quarter of a pixel of this camera is one of the whole one: 23 um of false depth
@pytest.mark.parametrize("pan_px", [0.25, 1.0])
def test_a_camera_that_turns_under_a_press_is_named_and_never_locked_again(pan_px):
    with loop_of(wide("step", pan_px)) as (loop, _):
        steps = list(loop.run(frames=BUMP + 16))
    frames = [step for step in steps if step.frame_number is not None]
    before = [step for step in frames if LOCKED <= step.frame_number < BUMP]
    assert {step.state for step in before} == {State.LOCKED}
    named = next(step for step in frames if step.state is State.MOVED)
    said_px = named.reason.removeprefix("camera against prism moved by ").removesuffix(" px (marks)")
    # to the noise of a few frames and of the figure's rounding
    assert float(said_px) == pytest.approx(pan_px, abs=0.02)
    assert BUMP <= named.frame_number <= BUMP + 10
    after = [step for step in frames if step.number >= named.number]
    assert {step.state for step in after} == {State.MOVED}
    assert sum(Event.BENCH_MOVED in step.events for step in steps) == 1


def test_presses_and_a_hand_before_a_mark_are_no_motion():
    with loop_of(wide("step")) as (loop, marked):
        marked.covered_from = BUMP
        steps = list(loop.run(frames=BUMP + 30))
    assert State.MOVED not in {step.state for step in steps}
    assert steps[-1].state in GOOD


def test_re_zeroed_the_marks_are_where_they_belong():
    with loop_of(wide("none", 0.25)) as (loop, _):
        moved = list(loop.run(frames=BUMP + 10))
        assert moved[-1].state is State.MOVED
        loop.rezero()
        again = list(loop.run(frames=24))
    assert again[-1].state is State.RESTING


def test_a_place_without_a_mark_is_said_once():
    with loop_of(wide("none"), MARKS[1:]) as (loop, _):
        steps = list(loop.run(frames=24))
    notes = [note for step in steps for note in step.notes if "contrast" in note]
    assert notes == ["not watched, too little contrast: the mark at (30, 60) px"]
    assert steps[-1].state is State.RESTING


def test_a_mark_in_the_mirror_or_beyond_the_image_is_refused():
    in_the_mirror = wide("none", marks_px=((200.0, 128.0),))
    with (
        pytest.raises(InputError, match=r"surface.marks_px: \[200.0, 128.0\]: 48 px or more from all"),
        loop_of(in_the_mirror),
    ):
        pass
    with pytest.raises(
        InputError, match=r"surface.marks_px\[0\]: \[10.0, 60.0\]: 16 px or more inside the image"
    ):
        quarter().replace({"surface.marks_px": [[10.0, 60.0]]})
