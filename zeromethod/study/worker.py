"""A worker process: tasks come in at standard input, outcomes go out at standard output, one JSON a line.

It ends when standard input does, so that none is left behind by a study that was killed.
"""

from __future__ import annotations

import json
import os
import sys

from zeromethod.study.runs import carry_out
from zeromethod.study.task import Message


def main() -> None:
    """Serve until there is nothing more to do."""
    # what a library prints must not get among the outcomes
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as answers:
        os.dup2(2, 1)

        def answer(message: Message) -> None:
            answers.write(json.dumps(message) + "\n")
            answers.flush()

        answer({"ready": os.getpid()})
        for line in sys.stdin:
            answer(carry_out(json.loads(line)))


if __name__ == "__main__":
    main()
