"""A worker process: tasks come in at standard input, outcomes go out at standard output, one JSON a line.

It ends when standard input does, whatever it is at, so that none is left behind by a study that was killed.
"""

from __future__ import annotations

import json
import os
from queue import SimpleQueue
from threading import Thread

from zeromethod.child_process import take_output
from zeromethod.study.runs import carry_out
from zeromethod.study.task import Message


def main() -> None:
    """Serve until standard input ends."""
    tasks: SimpleQueue[bytes] = SimpleQueue()
    Thread(target=_take_in, args=(tasks,), daemon=True).start()
    with take_output() as answers:

        def answer(message: Message) -> None:
            answers.write(json.dumps(message).encode() + b"\n")
            answers.flush()

        answer({"ready": os.getpid()})
        while True:
            answer(carry_out(json.loads(tasks.get())))


def _take_in(tasks: SimpleQueue[bytes]) -> None:
    """Take tasks in as they come; at the end of input there is nobody left to work for."""
    # not sys.stdin, which an interpreter that ends must be able to lock
    with os.fdopen(os.dup(0), "rb") as given:
        for line in given:
            tasks.put(line)
    os._exit(0)


if __name__ == "__main__":
    main()
