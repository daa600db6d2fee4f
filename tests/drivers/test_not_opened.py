"""Why a camera cannot be opened: every way that can be planted here."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

import pytest

from zeromethod.drivers import not_opened
from zeromethod.drivers.not_opened import in_words, reason


def test_a_server_that_speaks_no_pictures_is_distinguished_from_one_that_is_not_there() -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        assert "answers at port" in reason(f"http://127.0.0.1:{mute.getsockname()[1]}/video")


def test_a_server_whose_queue_is_full_times_out() -> None:
    with socket.socket() as full, socket.socket() as one, socket.socket() as two:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        for client in (one, two):
            client.setblocking(False)
            client.connect_ex(full.getsockname())
        assert "does not answer" in reason(f"tcp://127.0.0.1:{full.getsockname()[1]}")


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (63, "/dev/video63: no such file or directory"),
        ("tcp://127.0.0.1", "host or port missing"),
        ("tcp://127.0.0.1:99999", "Port out of range 0-65535"),
    ],
)
def test_what_is_not_there_is_said(source: int | str, words: str) -> None:
    assert reason(source) == words


def test_a_file_that_is_no_film_or_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "notes.avi"
    path.write_text("no film")
    assert reason(str(path)) == f"{path}: not a video file"
    if os.geteuid():
        path.chmod(0)
        assert reason(str(path)) == f"{path}: permission denied"


def test_a_device_that_another_program_has_open_is_in_use_by_it(tmp_path, monkeypatch):
    device = tmp_path / "video7"
    device.touch()
    monkeypatch.setattr(not_opened, "_LOCAL", f"{tmp_path}/video{{}}")
    assert reason(7) == f"{device}: not a camera that gives pictures, or in use"
    with device.open() as ours, subprocess.Popen(["sleep", "60"], stdin=ours) as other:
        words = reason(7)
        other.kill()
    assert words == f"{device}: in use by sleep (process {other.pid}): end that first"


@pytest.mark.parametrize(
    ("message", "taken"),
    [
        ("The device is controlled by another application. Err: (0xE1018006)", True),
        ("GigEVision read_register error (access-denied)", True),
        ("Device or resource busy", True),
        ("Can't connect to device at address '10.0.0.1'", False),
    ],
)
def test_what_libraries_say_of_a_taken_camera_is_said_in_plain_words(message: str, taken: bool) -> None:
    assert ("in use by another program" in in_words(message)) == taken
    assert message in in_words(message)
