"""Objects sent between two processes: their arrays by way of shared memory, the rest by pipes.

The arrays of a surface take 2 MB: through a pipe they cost either side twice the time.
"""

from __future__ import annotations

import mmap
import os
import pickle
from typing import IO, Any

_ALIGNED = 64
"""Arrays begin at multiples of so many bytes."""

NONE = -1
"""In place of a file descriptor: there is no memory."""


def shared_memory(name: str, size: int) -> int:
    """File descriptor of `size` bytes that a child process can share; `NONE` where there are none."""
    handle = os.memfd_create(name)
    try:
        os.ftruncate(handle, size)
    except OSError:  # a limit of files' sizes holds for memory, too
        os.close(handle)
        return NONE
    return handle


class ArrayExchange:
    """One side of the exchange, with memory for the arrays of one message in each of its parts.

    Arrays that find no room go through the pipe.
    """

    def __init__(self, handle: int, parts: int = 1) -> None:
        """handle: from `shared_memory`, closed by whoever made it. parts: of the memory, all equal."""
        self._memory = mmap.mmap(-1, 1) if handle == NONE else mmap.mmap(handle, 0)
        self._part = len(self._memory) // parts // _ALIGNED * _ALIGNED or len(self._memory)

    def send(self, value: object, stream: IO[bytes], part: int = 0) -> None:
        """Send an object by a part of the memory that no message under way takes.

        Raises OSError, or ValueError for a closed stream, where nobody receives.
        """
        places: list[slice] = []
        free, end = part * self._part, min((part + 1) * self._part, len(self._memory))

        def finds_no_room(buffer: pickle.PickleBuffer) -> bool:
            nonlocal free
            raw = buffer.raw()
            place = slice(free, free + raw.nbytes)
            if place.stop > end:
                return True
            self._memory[place] = raw
            places.append(place)
            free = -(-place.stop // _ALIGNED) * _ALIGNED
            return False

        pickled = pickle.dumps(value, pickle.HIGHEST_PROTOCOL, buffer_callback=finds_no_room)
        pickle.dump((pickled, places), stream, pickle.HIGHEST_PROTOCOL)
        stream.flush()

    def receive(self, stream: IO[bytes], copied: bool = True) -> Any:
        """Receive an object. Raises EOFError where nobody sends any more, and what `pickle.load` does.

        copied: else its arrays lie in the memory, where the next message by the same part replaces them.
        """
        pickled, places = pickle.load(stream)
        memory = memoryview(self._memory)
        parts = (memory[place] for place in places)
        return pickle.loads(pickled, buffers=[bytearray(part) if copied else part for part in parts])
