"""Keys of a running loop, typed into a pseudo-terminal."""

import os
import pty
import termios
import time
from collections.abc import Iterator
from dataclasses import dataclass
from io import StringIO
from types import SimpleNamespace
from typing import TextIO
from unittest.mock import Mock, call

import pytest

from zeromethod.cli.keys import Keys
from zeromethod.loop.loop import Loop
from zeromethod.operating.controls import Controls


@dataclass
class Terminal:
    stream: TextIO
    keyboard: int

    def type(self, keys: bytes) -> None:
        os.write(self.keyboard, keys)
        time.sleep(0.01)

    @property
    def modes(self) -> tuple[bool, bool, bool]:
        """Whether it waits for whole lines, echoes, and makes signals of Ctrl-C and the like."""
        local = termios.tcgetattr(self.stream.fileno())[3]
        return bool(local & termios.ICANON), bool(local & termios.ECHO), bool(local & termios.ISIG)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    keyboard, side = pty.openpty()
    # the tests' own process group is not in the foreground of this terminal
    monkeypatch.setattr(os, "tcgetpgrp", lambda _fd: os.getpgrp())
    with open(side) as stream:
        yield Terminal(stream, keyboard)
    os.close(keyboard)


def test_keys_come_at_once_without_echo_and_the_terminal_is_put_back(terminal):
    assert terminal.modes == (True, True, True)
    with Keys(terminal.stream) as keys:
        assert keys.active
        assert terminal.modes == (False, False, True)
        assert keys.pressed() == ""
        terminal.type(b"pZx")
        assert keys.pressed() == "pZx"
        assert keys.pressed() == ""
    assert not keys.active
    assert terminal.modes == (True, True, True)
    assert keys.pressed() == ""


def test_the_terminal_is_put_back_when_a_run_fails_and_what_was_typed_is_forgotten(terminal):
    def fail() -> None:
        terminal.type(b"rm -r\n")
        raise RuntimeError

    with pytest.raises(RuntimeError), Keys(terminal.stream):
        fail()
    assert terminal.modes == (True, True, True)
    os.set_blocking(terminal.stream.fileno(), False)
    with pytest.raises(BlockingIOError):
        os.read(terminal.stream.fileno(), 10)


def test_keys_steer_the_loop_and_unknown_ones_do_nothing(terminal):
    controls = Mock(Controls)
    session = SimpleNamespace(loop=Mock(Loop, paused=False), recording=SimpleNamespace(running=False))
    with Keys(terminal.stream) as keys:
        on_wait = keys.for_session(session, controls)
        terminal.type(b"p")
        on_wait()
        session.loop.paused = session.recording.running = True
        terminal.type(b"P\xc3\xa4?r")
        on_wait()
        session.recording.running = False
        terminal.type(b"zxy\x1b rsmq")
        on_wait()
    called = ["pause", "resume", "stop_recording", "zero", "record", "snapshot", "mark", "stop"]
    asked = [each for each in controls.method_calls if each[0] == "call"]
    assert asked == [call.call(method, source="terminal") for method in called]
    assert controls.attend.call_count == 3


def test_a_program_in_the_background_leaves_the_terminal_alone(terminal, monkeypatch):
    monkeypatch.setattr(os, "tcgetpgrp", lambda _fd: os.getpgrp() + 1)
    with Keys(terminal.stream) as keys:
        assert not keys.active
        assert terminal.modes == (True, True, True)
        terminal.type(b"q")
        assert keys.pressed() == ""


def test_keys_stop_coming_while_the_program_is_in_the_background(terminal, monkeypatch):
    with Keys(terminal.stream) as keys, monkeypatch.context() as patch:
        patch.setattr(os, "tcgetpgrp", lambda _fd: os.getpgrp() + 1)
        terminal.type(b"q")
        assert keys.pressed() == ""
        patch.undo()
        patch.setattr(os, "tcgetpgrp", lambda _fd: os.getpgrp())
        assert keys.pressed() == "q"


@pytest.mark.parametrize("kind", ["no terminal", "file", "closed"])
def test_without_a_terminal_there_are_no_keys(kind):
    with open(os.devnull) as stream:
        if kind == "closed":
            stream.close()
        with Keys(StringIO("q") if kind == "no terminal" else stream) as keys:
            assert not keys.active
            assert keys.pressed() == ""


def test_a_terminal_that_goes_away_has_no_keys_and_does_no_harm():
    keyboard, side = pty.openpty()
    with open(side) as stream, pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "tcgetpgrp", lambda _fd: os.getpgrp())
        with Keys(stream) as keys:
            os.close(keyboard)
            assert keys.pressed() == ""
            assert keys.pressed() == ""
