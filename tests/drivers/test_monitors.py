"""Warnings of monitors and outputs, and screens that do not answer."""

import os
import socket
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hanging import takes

from zeromethod.drivers.desktop import output_warnings, ramp_warnings
from zeromethod.drivers.identify import identify_picture, p0_place
from zeromethod.drivers.monitors import Claim, Monitor
from zeromethod.drivers.xserver import Output
from zeromethod.errors import InputError

LEFT = Output("LEFT", 0, 0, 640, 480, 60.0)
RIGHT = Output("RIGHT", 640, 0, 800, 600, 60.0)
MONITOR = Monitor(3, "HDMI-1", 800, 600, 59.94, 640, 0, 1.0, False)


def test_nothing_is_reported_of_outputs_side_by_side():
    assert output_warnings("LEFT", [LEFT, RIGHT]) == output_warnings("RIGHT", [LEFT, RIGHT]) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scaled": True}, "its picture is scaled by the X server: xrandr --output RIGHT --scale 1x1"),
        ({"turned": True}, "its picture is turned or mirrored: xrandr --output RIGHT --rotate normal"),
        ({"panned": True}, "its picture follows the mouse: xrandr --output RIGHT --panning 0x0"),
        ({"x": 639}, "LEFT shows the same part of the desktop (mirrored outputs)"),
    ],
)
def test_changes_of_an_output_to_its_picture_are_reported(change, said):
    assert output_warnings("RIGHT", [LEFT, replace(RIGHT, **change)]) == [f"RIGHT: {said}"]


@pytest.mark.parametrize("top", [255 / 256, 1.0])
def test_a_ramp_that_servers_call_linear_is_linear(top):
    assert ramp_warnings("A", [np.linspace(0, top, 256)] * 3) == []


def test_a_warm_blue_is_reported():
    linear = np.linspace(0, 1, 1024)
    assert "changes greys by up to 30%" in ramp_warnings("A", [linear, linear, 0.7 * linear])[0]


def test_the_identify_picture_shows_the_outermost_pixels_and_single_ones():
    image = identify_picture(MONITOR)
    assert image.shape == (600, 800)
    for edge in (image[0], image[-1], image[:, 0], image[:, -1]):
        assert np.all(edge == 255)
    patch = image[462 - 20 : 462 + 20, 400 - 20 : 400 + 20].astype(int)  # at 0.77 of the height
    assert np.all(np.abs(np.diff(patch, axis=0)) == 255)
    assert np.all(np.abs(np.diff(patch, axis=1)) == 255)


@pytest.mark.parametrize(
    ("turn_deg", "mirrored", "place"),
    [
        (0.0, False, (10, 300)),  # columns grow away from P0: it is at column 0
        (0.0, True, (790, 300)),
        (90.0, False, (400, 590)),  # columns grow with y, so rows grow towards P0
        (-90.0, False, (400, 10)),
        (90.0, True, (400, 10)),
        (180.0, False, (790, 300)),
        (2.0, False, (10, 300)),
    ],
)
def test_p0_is_at_the_edge_that_the_mounting_puts_there(turn_deg, mirrored, place):
    assert p0_place(MONITOR, turn_deg, mirrored, 10) == place


OPENING = """
from zeromethod.drivers import xserver
from zeromethod.drivers.monitors import monitors
from zeromethod.drivers.window import WindowDisplay
from zeromethod.errors import InputError
xserver.PATIENCE_S = 0.3
for opening in (monitors, lambda: WindowDisplay(64, 48, 60.0)):
    try:
        opening()
    except InputError as error:
        print(error)
"""


def said_on(display: str | None) -> tuple[str, str]:
    """What listing monitors and opening a window print, both alike, and on the error stream."""
    variables = {"XDG_SESSION_TYPE": "x11"} | ({} if display is None else {"DISPLAY": display})
    plain = {name: value for name, value in os.environ.items() if name not in ("WAYLAND_DISPLAY", "DISPLAY")}
    command = [sys.executable, "-W", "error", "-c", OPENING]
    run = subprocess.run(
        command, env=plain | variables, capture_output=True, text=True, check=True, timeout=60
    )
    (said,) = set(run.stdout.splitlines())
    return said, run.stderr


@pytest.mark.parametrize(
    ("display", "message"),
    [
        (None, "no screen: DISPLAY is not set"),
        ("", "no screen: DISPLAY is not set"),
        (":99999", "X11: Failed to open display :99999"),
    ],
)
def test_importing_needs_no_screen_and_opening_names_what_is_missing(display, message):
    assert said_on(display) == (f"display window: {message}", "")


def test_a_server_that_never_answers_is_not_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as silent, takes(0.6, 20):
        name = f"127.0.0.1:{silent.getsockname()[1] - 6000}"  # X11 over TCP
        said, _ = said_on(name)
    assert said == f"display window: the X server {name} does not answer within 0.3 s"


def test_a_monitor_is_claimed_once_per_desktop_and_free_after_its_release(monkeypatch):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":4711")
    first, second = Claim(0), Claim(1)
    with pytest.raises(InputError, match="monitor 0 shows another zeromethod"):
        Claim(0)
    monkeypatch.setenv("DISPLAY", ":4712")
    third = Claim(0)
    monkeypatch.setenv("DISPLAY", ":4711")
    first.release()
    first.release()
    for claim in (Claim(0), second, third):
        claim.release()
