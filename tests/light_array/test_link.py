"""Arrays behind a link: a process of its own serves them, loses frames, breaks them, stalls, dies."""

import io
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
from hanging import PATIENCE_S
from rich.console import Console

from zeromethod.errors import InputError
from zeromethod.light_array.devices import ArraysLost, LightArrays
from zeromethod.light_array.exchange import Exchange, no_record
from zeromethod.light_array.link import LinkedArrays
from zeromethod.light_array.rig import load_light_array
from zeromethod.light_array.session import LightSession
from zeromethod.loop.state import State
from zeromethod.view.light_array import light_table


@contextmanager
def stand_in(*options, stderr=None):
    command = [sys.executable, "-m", "zeromethod.light_array.stand_in", *map(str, options)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def at(address, reopen_s=2.0):
    return load_light_array("leds").changed(arrays={"address": address, "reopen_s": reopen_s})


@pytest.mark.parametrize("link", ["udp://127.0.0.1:0", "serial"])
def test_lost_and_broken_frames_are_counted_and_readings_go_on(link):
    options = ("--scenario", "none", "--lose", 0.01, "--break", 0.01, "--wait", 0.05)
    with stand_in(link, *options) as (_, address), LightSession(at(address)) as session:
        states = [step.state for step in session.run(600, None)]
        figures = session.figures
    # a busy machine makes the other process wait now and then: then the run holds
    assert states.count(State.RESTING) + states.count(State.LOCKED) > 300
    assert set(states[-300:]) <= {State.RESTING, State.LOCKED, State.HOLDING}
    # of some 3000 readings 30 are lost and 30 broken: fewer than 10 of either comes once in 100,000 runs
    assert figures["events"]["frames broken on the way"] > 10
    assert figures["events"]["readings lost"] > 10
    assert figures["readings_of_depth"] > 50


def test_a_stall_is_held_and_ends():
    options = ("--scenario", "none", "--stall", 2600, 0.6)
    with stand_in("udp://127.0.0.1:0", *options) as (_, address), LightSession(at(address)) as session:
        steps = [(step.state, step.reason) for step in session.run(400, None)]
    states = [state for state, _ in steps]
    first = states.index(State.HOLDING)
    assert steps[first][1].startswith("no readings for 0.1 s")
    assert {State.RESTING, State.LOCKED} & set(states[first:])


def test_arrays_that_start_again_and_count_from_0_are_followed_and_the_operator_told():
    ended = ("--scenario", "none", "--end", 2800)
    with stand_in("udp://127.0.0.1:0", *ended) as (first, address), LightSession(at(address, 20)) as session:
        steps = session.run(600, None)
        notes, states = [], []
        while first.poll() is None:
            next(steps)
        with stand_in(address, "--scenario", "none"):
            for step in steps:
                notes += step.notes
                states.append(step.state)
        figures = session.figures
    assert notes == ["the arrays started again: readings go on by what was measured before"]
    assert states[-1] in {State.RESTING, State.LOCKED}
    assert figures["events"]["arrays started again"] == 1
    assert figures["events"]["readings lost"] >= 19  # those by which it was seen
    assert "readings out of order" not in figures["events"]
    assert 0 < session.last.time_s < 1  # the run's time goes on where it was


@pytest.mark.parametrize("link", ["udp://127.0.0.1:0", "serial"])
def test_arrays_that_die_end_the_run_with_a_reason(link):
    began = time.monotonic()
    options = ("--scenario", "none", "--end", 2700)
    with stand_in(link, *options) as (_, address), LightSession(at(address, reopen_s=0.5)) as session:
        *_, last = session.run(None, None)
    assert last.state is State.FAULT
    assert last.reason.startswith(("the arrays sent nothing", "the arrays are lost"))
    assert time.monotonic() - began < 60  # by itself, however busy the machine


def test_the_stand_in_ends_and_refuses_in_one_line():
    with stand_in("udp://127.0.0.1:0", stderr=subprocess.PIPE) as (process, _address):
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
        assert process.stderr.read() == "interrupted\n"
    with stand_in("udp://127.0.0.1:0") as (_, taken):
        for given, words in (
            (taken, f"{taken}: Address already in use"),
            ("x", "x: udp://HOST:PORT, or serial"),
        ):
            with stand_in(given, stderr=subprocess.PIPE) as (process, _):
                assert process.wait(PATIENCE_S) == 2
                assert process.stderr.read() == f"stand_in: {words}\n"


def test_a_link_that_breaks_while_nothing_comes_is_opened_again():
    class Unplugged(LightArrays):
        def send(self, number, levels):
            if number == 1 and link.counts["times without readings"]:
                raise ArraysLost("Network is unreachable")

        def receive(self, timeout_s):
            return None

    link = Exchange(Unplugged(), 5.0, no_record)
    link.send(np.zeros(256, np.uint16))
    assert link.next() is None
    assert link.counts["arrays lost"] == 1
    assert link.trouble == (
        State.HOLDING,
        "the arrays were lost and are open again: Network is unreachable",
    )


def test_arrays_that_never_come_leave_no_figures(tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        with LightSession(at(f"udp://127.0.0.1:{nobody.getsockname()[1]}", reopen_s=0.3)) as session:
            *_, last = session.run(None, None)
    assert last.state is State.FAULT
    assert session.figures["light_residual"] is None
    assert session.figures["loop_ms"] is None
    table = Console(file=(text := io.StringIO()))
    table.print(light_table(session.figures))
    assert "nan" not in text.getvalue()


def test_addresses_that_are_none_are_refused():
    for address in (
        "tcp://1.2.3.4:5",
        "udp://127.0.0.1:0",
        "udp://x",
        "serial://dev/x",
        "udp://127.0.0.1:99999",
    ):
        with pytest.raises(InputError, match='allowed: "simulated", udp://HOST:PORT'):
            LinkedArrays(address)
    with pytest.raises(InputError, match="cannot be opened"):
        LinkedArrays("serial:///dev/no-such-line")
    with pytest.raises(InputError, match="no serial line"):
        LinkedArrays("serial:///dev/null")
