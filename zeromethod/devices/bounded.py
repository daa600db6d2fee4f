"""A call with a time limit, in a daemon thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable


def call_within(timeout_s: float, call: Callable[[], object], what: str) -> None:
    """Call in a daemon thread; raise what it raises, or TimeoutError when it takes longer than `timeout_s`.

    A call that hangs is left to its thread, which does not keep the program from ending.
    """
    errors: list[BaseException] = []

    def run() -> None:
        try:
            call()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, name=what, daemon=True)
    thread.start()
    thread.join(timeout_s)
    if thread.is_alive():
        raise TimeoutError(f"not within {timeout_s:g} s")
    if errors:
        raise errors[0]
