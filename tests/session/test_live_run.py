"""A run in real time: read alongside the loop, published to the end, ended in order."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from typing import Any

import numpy as np
import pytest
from hanging import PATIENCE_S, SOON_S, eventually
from live_devices import Eye, small_rig
from rich.console import Console

from zeromethod import MeasurementError, Session, open_devices, summarise
from zeromethod.devices.protocols import CameraLost, DisplayLost
from zeromethod.loop.state import NULLED, State
from zeromethod.loop.step import StepFigures
from zeromethod.session import surfaces as process
from zeromethod.session.reading import WAITING_STEPS, StepReader
from zeromethod.view.live import LiveStatus


class Turn:
    """As much of a step as reading looks at."""

    def __init__(self, number: int, measured: bool = True) -> None:
        self.number = number
        self.measured = object() if measured else None
        self.surface: str | None = None


class Reader:
    """Reads once `go` is set."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.begun: list[int] = []

    def __call__(self, step: Any) -> Any:
        self.begun.append(step.number)
        self.go.wait(PATIENCE_S)
        found = Turn(step.number)
        found.surface = f"surface {step.number}"
        return found


class Published:
    def __init__(self) -> None:
        self.steps: list[Any] = []

    def publish(self, step: Any) -> None:
        self.steps.append(step)

    @property
    def numbers(self) -> list[int]:
        return [step.number for step in self.steps]


def running(*names: str) -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name in names]


def test_a_slow_reading_loses_no_step_until_as_many_wait_as_may():
    reader, published = Reader(), Published()
    begun: list[int] = []
    reading = StepReader(reader, published, live=True, begin=lambda step: begun.append(step.number))
    reading.post(Turn(0))  # type: ignore[arg-type]
    eventually(lambda: reader.begun == [0])
    last = WAITING_STEPS + 3
    for number in range(1, last):
        reading.post(Turn(number, measured=number != 2))  # type: ignore[arg-type]
    for number in (last, last + 1):
        reading.post(Turn(number, measured=False))  # type: ignore[arg-type]
    reader.go.set()
    reading.close()
    # in the last place the newest measured one, then the newest without: what has gone wrong since
    assert published.numbers == [*range(WAITING_STEPS), last - 1, last + 1]
    assert reader.begun == begun == [number for number in published.numbers[:-1] if number != 2]
    assert published.steps[-1].surface is None
    eventually(lambda: not running("read surface"))


def test_reading_in_turn_reads_all():
    reader, published = Reader(), Published()
    reader.go.set()
    reading = StepReader(reader, published, live=False)
    for number in range(3):
        reading.post(Turn(number, measured=number != 1))  # type: ignore[arg-type]
    assert [one.number for one in reading.collect()] == [0, 2]
    assert published.numbers == [0, 1, 2]
    reading.close()


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "PATIENCE_S", PATIENCE_S)


@contextmanager
def session(real: bool = True, window: bool = False) -> Iterator[tuple[Session, Published]]:
    camera, display = ("RealEye", "Window" if window else "RealScreen") if real else ("Eye", "Screen")
    published = Published()
    rig = small_rig(f"live_devices:{camera}", f"live_devices:{display}")
    with open_devices(rig) as devices, Session(rig, devices=devices, publisher=published) as run:
        run.devices = devices  # type: ignore[attr-defined]
        yield run, published


def read(run: Session) -> list[StepFigures]:
    return [record for record in run.result.records if np.isfinite(record.depth_peak_mm)]


@pytest.mark.parametrize("real", [False, True], ids=["simulated", "real"])
def test_a_run_reads_depth_and_publishes_to_the_end(real, monkeypatch):
    monkeypatch.setattr(
        "zeromethod.session.reading.CLOSING_S", PATIENCE_S
    )  # a busy machine reads for seconds
    with session(real) as (run, published):
        eye: Eye = run.devices.camera  # type: ignore[attr-defined]
        rows, columns = eye.shape
        y, x = np.mgrid[:rows, :columns].astype(float)
        away = np.stack([x - columns / 2, y - rows / 2], axis=-1) / 20
        dent = 2.0 * away * np.exp(-0.5 * np.sum(away**2, axis=-1, keepdims=True))

        newest, pressed = [], 0
        for count, record in enumerate(run.run(seconds=2 * PATIENCE_S)):
            newest.append(record.depth_peak_mm)
            # as many frames as it takes, on a busy machine, until a few of the pressed mirror were read
            if count >= 15 and not pressed and read(run):
                eye.away_px, pressed = dent, record.number
            if pressed and record.state in NULLED and read(run)[-1].number > pressed + 8:
                run.loop.stop()
        result = run.result
    assert len(read(run)) >= (2 if real else 20)
    assert abs(read(run)[-1].depth_peak_mm) > 5 * abs(read(run)[0].depth_peak_mm)
    assert np.isfinite(newest).any()
    numbers = published.numbers
    assert numbers == sorted(set(numbers))
    # the last word is how it ended, and the last but one that was read is not after it
    step = published.steps[-1]
    assert (step.state, step.surface) == (State.STOPPED, None)
    assert step.number == result.records[-1].number + 1
    assert sum(one.surface is not None for one in published.steps) == len(read(run))
    eventually(lambda: not running("read surface", "drawing"))


@pytest.mark.usefixtures("no_process")
def test_an_interrupted_run_keeps_what_it_has_and_ends_though_the_camera_hangs():
    with session() as (run, published):
        eye: Eye = run.devices.camera  # type: ignore[attr-defined]
        hung, hangs = threading.Event(), threading.Event()

        def hang(reads: int) -> None:
            if reads > 15:
                hangs.set()
                hung.wait(PATIENCE_S)

        eye.before_read = hang
        asked: list[float] = []

        def ask() -> None:
            hangs.wait(PATIENCE_S)
            time.sleep(0.05)
            asked.append(time.monotonic())
            run.interrupt()

        threading.Thread(target=ask).start()
        records = list(run.run())
        assert time.monotonic() - asked[0] < SOON_S
        hung.set()
    assert run.result.interrupted
    assert len(records) >= 10
    assert records[-1].state is State.STOPPED
    assert published.steps[-1].state is State.STOPPED
    assert summarise(run.result)["nulled_frames"] > 0


@pytest.mark.usefixtures("no_process")
def test_a_window_that_is_closed_ends_the_run_with_its_reason_and_the_session():
    with session(window=True) as (run, published):
        window = run.devices.display  # type: ignore[attr-defined]

        def close() -> None:
            raise DisplayLost("its window was closed")

        for count, _ in enumerate(run.run()):
            if count == 10:
                window.on_poll = close
        with pytest.raises(MeasurementError, match=r"^session: it cannot go on: the display is lost: its"):
            run.run(frames=1)
    assert run.result.state is State.FAULT
    assert run.result.records[-1].reason == "the display is lost: its window was closed"
    assert published.steps[-1].state is State.FAULT
    assert published.steps[-1].reason == "the display is lost: its window was closed"


@pytest.mark.usefixtures("no_process")
def test_a_run_left_half_way_ends_its_threads():
    with session() as (run, published):
        steps = run.run()
        for _ in range(8):
            next(steps)
        steps.close()  # type: ignore[attr-defined]
        assert run.loop.status.state is State.STOPPED
        eventually(lambda: not running("read surface"))
        assert published.steps[-1].state is State.STOPPED
    eventually(lambda: not running("drawing"))


def test_a_run_whose_reading_process_is_killed_reports_it_and_reads_on():
    with session() as (run, _):
        killed, before = False, 0
        for record in run.run(seconds=60):
            reader = run._surfaces._process
            if not killed and reader is not None and record.peak is not None:
                os.kill(reader.process_id, signal.SIGKILL)
                killed, before = True, len(read(run))
            elif killed and len(read(run)) > before + 5:
                break
    notes = [note for note in run.result.notes if "reads surfaces" in note]
    assert notes == [
        "the process that reads surfaces is lost (signal 9): the run's own process reads now, slower"
    ]


@pytest.mark.usefixtures("no_process")
def test_a_run_reads_though_no_process_can_be_started_for_it():
    with session() as (run, _):
        records = run.run(seconds=60)
        while len(read(run)) < 3:
            next(records)
        records.close()  # type: ignore[attr-defined]
    [notes] = [note for note in run.result.notes if "reads surfaces" in note]
    assert "lost (it does not start: Resource temporarily unavailable)" in notes


def lose(_reads: int) -> None:
    raise CameraLost("cable [1/2] is out")


def test_the_operator_sees_the_state_and_why_and_every_note():
    with session(real=False) as (run, _):
        eye: Eye = run.devices.camera  # type: ignore[attr-defined]
        out = StringIO()
        console = Console(file=out, width=160, force_terminal=True, color_system=None)
        with LiveStatus(console, None, "seconds", "p pause  q stop") as live:
            for count, record in enumerate(run.run(frames=12)):
                live.update(record, count)
                live._progress.refresh()
                if count == 6:
                    eye.before_read = lose
    shown = out.getvalue()
    for words in ("resting", "fault", "the camera is lost: cable [1/2] is out", "p pause  q stop"):
        assert words in shown
    assert "note: the camera is lost: cable [1/2] is out\n" in shown
    assert "note: the camera was opened again\n" in shown
    assert run.result.notes == ["the camera is lost: cable [1/2] is out", "the camera was opened again"]
