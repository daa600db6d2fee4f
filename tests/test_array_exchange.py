"""Objects sent between processes with their arrays in shared memory."""

import io
import os

import numpy as np
import pytest

from zeromethod.array_exchange import NONE, ArrayExchange, shared_memory

VALUE = {"whole": np.arange(12.0).reshape(3, 4), "cut": np.arange(40)[::3], "words": "a depth", "none": None}


@pytest.fixture(params=(1 << 16, 100, None), ids=("room for all", "room for one array", "no memory"))
def sides(request):
    """Both sides, with little memory or none."""
    handle = NONE if request.param is None else shared_memory("test", request.param)
    sender, receiver = ArrayExchange(handle), ArrayExchange(handle)
    if handle != NONE:
        os.close(handle)
    return sender, receiver


def test_what_is_received_is_what_was_sent_and_stays_so_after_the_next_message(sides):
    sender, receiver = sides
    received = []
    for factor in (1, -1):
        stream = io.BytesIO()
        sender.send({**VALUE, "whole": factor * VALUE["whole"]}, stream)
        stream.seek(0)
        received.append(receiver.receive(stream))
    for factor, value in zip((1, -1), received, strict=True):
        np.testing.assert_array_equal(value["whole"], factor * VALUE["whole"])
        np.testing.assert_array_equal(value["cut"], VALUE["cut"])
        assert (value["words"], value["none"]) == ("a depth", None)
        value["whole"][0, 0] = 7.0  # whoever receives may change it


def test_arrays_with_room_do_not_go_through_the_pipe():
    handle = shared_memory("test", 1 << 20)
    sender = ArrayExchange(handle)
    os.close(handle)
    stream = io.BytesIO()
    sender.send(np.zeros(100_000), stream)
    # the head of the message alone
    assert len(stream.getvalue()) < 1000


def test_nobody_sends_any_more():
    with pytest.raises(EOFError):
        ArrayExchange(NONE).receive(io.BytesIO())


def test_no_memory_under_a_limit_of_file_sizes(monkeypatch):
    def limited(*_):
        raise OSError("File too large")

    monkeypatch.setattr(os, "ftruncate", limited)
    assert shared_memory("test", 100) == NONE
