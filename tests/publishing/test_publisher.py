"""The publisher's promises, kept against subscribers in this process and in one that is stopped."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from zeromethod import InputError, NodeGrid, State
from zeromethod.clock import HostClock, SimulatedClock
from zeromethod.publishing import Publisher

from .readings import TOPIC, a_step, decoded, dent

zmq = pytest.importorskip("zmq")

ANY_PORT = "tcp://127.0.0.1:*"
PATIENCE_MS = 10_000

SUBSCRIBER = """
import json, sys, zmq
socket = zmq.Context().socket(zmq.SUB)
socket.setsockopt(zmq.CONFLATE, 1)
socket.subscribe(b"zeromethod.v2\\n")
socket.connect(sys.argv[1])
while True:
    print(json.loads(socket.recv().split(b"\\n", 2)[1])["step"], flush=True)
"""


@contextmanager
def subscriber(publisher: Publisher) -> Iterator[zmq.Socket]:
    """A connected subscriber that has already got one message."""
    with zmq.Context() as context, context.socket(zmq.SUB) as listening:
        listening.setsockopt(zmq.LINGER, 0)
        listening.setsockopt(zmq.CONFLATE, 1)
        listening.subscribe(TOPIC)
        listening.connect(publisher.address)
        until = time.monotonic() + 1e-3 * PATIENCE_MS
        while not listening.poll(20):
            assert time.monotonic() < until
            publisher.publish(a_step(0))
        listening.recv()
        yield listening


def received(listening: zmq.Socket) -> dict:
    assert listening.poll(PATIENCE_MS)
    return decoded(listening.recv())[0]


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


def test_a_stopped_subscriber_costs_neither_time_nor_memory_and_then_gets_the_newest():
    shape = NodeGrid((1024, 1280)).shape
    reading, count = dent(0.1, shape=shape), 200
    with Publisher(ANY_PORT, HostClock()) as publisher:
        command = [sys.executable, "-c", SUBSCRIBER, publisher.address]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            try:
                while not _line_within(process, 0.05):
                    publisher.publish(a_step(0, reading))
                process.send_signal(signal.SIGSTOP)
                for _ in range(10):
                    publisher.publish(a_step(1, reading))
                before, took_s = resident_bytes(), []
                for number in range(2, count + 2):
                    start = time.perf_counter()
                    publisher.publish(a_step(number, reading))
                    took_s.append(time.perf_counter() - start)
                # Queued messages would be 120 MB; a few buffers of the allocator's are not.
                assert resident_bytes() - before < 20e6
                # 0.4 ms on an idle machine, more where others compute; one that waited would wait for ever
                assert np.median(took_s) < 0.1
                process.send_signal(signal.SIGCONT)
                # Behind the few that were already on the line comes the newest, with nothing sent since.
                while int(process.stdout.readline()) != count + 1:
                    pass
            finally:
                process.kill()


def _line_within(process: subprocess.Popen[str], seconds: float) -> bool:
    assert process.poll() is None
    poller = zmq.Poller()
    poller.register(process.stdout, zmq.POLLIN)
    return bool(poller.poll(1e3 * seconds))


def test_unix_time_is_that_of_the_frame_whatever_the_runs_clock_says():
    clock = SimulatedClock(start_ns=5_000_000_000)
    with Publisher(ANY_PORT, clock) as publisher, subscriber(publisher) as listening:
        before_ns = time.time_ns()
        publisher.publish(a_step(1, time_ns=4_970_000_000))  # 30 ms old
        header = received(listening)
        assert before_ns - 30_000_000 <= header["unix_time_ns"] <= time.time_ns() - 30_000_000
        assert header["time_ns"] == 4_970_000_000


def test_contact_events_are_repeated_for_those_who_skip_messages():
    with Publisher(ANY_PORT, HostClock()) as publisher, subscriber(publisher) as listening:
        for number in range(1, 21 * 6 + 1):  # ten touches and as many ends, then a touch
            depth_mm = 0.1 if (number - 1) // 3 % 2 == 0 else 0.0
            publisher.publish(a_step(number, dent(depth_mm, shape=(16, 16))))
        publisher.publish(a_step(1000, state=State.HOLDING))
        while (header := received(listening))["step"] != 1000:
            pass
        numbers = [contact["number"] for contact in header["contacts"]]
        assert numbers == list(range(27, 43))
        assert not header["touching"]


def test_the_last_message_still_leaves(monkeypatch):
    # half a second is enough where processors are not shared with the other tests
    monkeypatch.setattr("zeromethod.publishing.publisher._LEAVING_S", 2.0)
    with Publisher(ANY_PORT, HostClock()) as publisher, subscriber(publisher) as listening:
        publisher.publish(a_step(8, dent(0.1, shape=NodeGrid((1024, 1280)).shape)))
        publisher.publish(a_step(9, state=State.STOPPED))
        publisher.close()
        while (header := received(listening))["step"] != 9:
            pass
        assert header["state"] == "stopped"


def test_every_publisher_is_a_session_of_its_own_and_closing_frees_the_address():
    sessions = set()
    address = ANY_PORT
    for _ in range(2):
        with Publisher(address, HostClock()) as publisher:
            address = publisher.address
            with subscriber(publisher) as listening:
                publisher.publish(a_step(1))
                sessions.add(received(listening)["session"])
    assert len(sessions) == 2


@pytest.mark.parametrize(
    "address",
    [
        "5556",
        "127.0.0.1:5556",
        "tcp://127.0.0.1",
        "tcp://:5556",
        "tcp://127.0.0.1:0",
        "tcp://127.0.0.1:65536",
        "tcp://192.0.2.1:5556",  # set aside for examples: nobody's
        "ipc:///tmp/socket",  # would replace a file of that name
        "udp://127.0.0.1:5556",
        "",
    ],
)
def test_an_address_that_cannot_be_bound_is_refused_in_one_line(address):
    with pytest.raises(InputError, match=r"^--publish: '.*': .+: tcp://HOST:PORT .*$") as refusal:
        Publisher(address, HostClock())
    assert "\n" not in str(refusal.value)
    assert address in str(refusal.value)


def test_a_port_in_use_is_refused_in_one_line():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(InputError, match="in use"):
            Publisher(address, HostClock())


def test_without_pyzmq_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "zmq", None)
    with pytest.raises(InputError, match=r"pip install 'zeromethod\[publish\]'"):
        Publisher(ANY_PORT, HostClock())
