"""ZeroMQ publisher of a run: it never waits for a subscriber (extra `publish`)."""

from __future__ import annotations

import importlib
import re
import time
import uuid
from collections import deque
from contextlib import AbstractContextManager
from typing import Any

from zeromethod.clock import Clock
from zeromethod.errors import InputError
from zeromethod.interactive.pointers import KEPT, PointerEvent
from zeromethod.loop.step import Step
from zeromethod.publishing.events import ContactEvent, ContactWatch
from zeromethod.publishing.message import encode

_ADDRESS = re.compile(r"tcp://(\[[^\]]+\]|[^:/\[\]]+):(\d{1,5}|\*)")
_LAST_PORT = 65535
_ALLOWED = "tcp://HOST:PORT with a free port, such as tcp://127.0.0.1:5556 (tcp://*:5556: from anywhere)"
_CONTACTS = 16
"""Contact events that every message repeats, so that a subscriber that skips messages misses none."""
_SEND_BUFFER_BYTES = 1 << 19
"""Kernel buffer per subscriber: about one message, or a slow line would always be late."""
_LEAVING_S = 0.5
"""Time that `close` gives the last message to leave: newest-only sockets do not linger."""


def check_address(address: str) -> None:
    """Raise InputError for an address that nobody can be."""
    parts = _ADDRESS.fullmatch(address)
    if parts is None or (parts[2] != "*" and not 0 < int(parts[2]) <= _LAST_PORT):
        raise InputError(f"--publish: {address!r}: not an address: {_ALLOWED}")


class Publisher(AbstractContextManager["Publisher"]):
    """Publishes every step of a run; a subscriber gets the newest message only.

    Each subscriber has room for one message, which the next one replaces: a slow one neither delays a run nor
    makes it grow. Use it from one thread at a time.
    """

    def __init__(self, address: str, clock: Clock) -> None:
        """Bind `address` (tcp://HOST:PORT); `clock` is the run's.

        Raises InputError, one line, without pyzmq and for an address that is malformed, in use or not of this
        machine.
        """
        check_address(address)
        zmq = _import_zmq()
        self._clock = clock
        self._session = uuid.uuid4().hex
        self._watch = ContactWatch()
        self._contacts: deque[ContactEvent] = deque(maxlen=_CONTACTS)
        self._pointers: deque[PointerEvent] = deque(maxlen=KEPT)
        self._context: Any = zmq.Context()
        self._socket: Any = self._context.socket(zmq.PUB)
        self._published = False
        self._socket.setsockopt(zmq.CONFLATE, 1)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.SNDBUF, _SEND_BUFFER_BYTES)
        self._socket.setsockopt(zmq.IPV6, int(address.startswith("tcp://[")))
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            raise InputError(f"--publish: {address!r}: {error.strerror}: {_ALLOWED}") from error
        self._address: str = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)

    @property
    def address(self) -> str:
        """Bound address, with the port that was chosen for "*"."""
        return self._address

    def publish(self, step: Step) -> None:
        """Send one step of the loop, with its surface and peak where it was read. Never waits."""
        if step.surface is not None and step.peak is not None:
            event = self._watch.update(step.surface, step.peak, step.contacts)
            if event is not None:
                self._contacts.append(event)
        self._pointers.extend(step.pointers)
        # The run's clock need not be the host's, nor run as fast: only a frame's age is taken from it.
        age_ns = self._clock.now_ns() - step.time_ns
        message = encode(
            step,
            session=self._session,
            unix_time_ns=time.time_ns() - age_ns,
            touching=self._watch.touching,
            contacts=self._contacts,
            pointers=self._pointers,
        )
        self._socket.send(message)
        self._published = True

    def close(self) -> None:
        """Give the last message half a second to leave, then free the address. May be called again."""
        if self._published:
            time.sleep(_LEAVING_S)
            self._published = False
        self._socket.close()
        self._context.term()

    def __exit__(self, *_: object) -> None:
        self.close()


def _import_zmq() -> Any:
    """Module `zmq` of pyzmq; InputError (one line) where it is not installed."""
    try:
        return importlib.import_module("zmq")
    except ImportError as error:
        raise InputError("--publish: needs pyzmq: pip install 'zeromethod[publish]'") from error
