"""The ten lines in docs/live-output.md read what is published."""

import re
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zeromethod.clock import HostClock
from zeromethod.contact import ContactFigures
from zeromethod.publishing import Publisher

from .readings import a_step, decoded, dent

pytest.importorskip("zmq")

DOCUMENT = Path(__file__).parents[2] / "docs" / "live-output.md"
ADDRESS = "tcp://127.0.0.1:5556"


class _Enough(Exception):
    """Ends the documented reader's endless loop."""


def test_the_documented_reader_has_ten_lines_and_reads_state_peak_and_maps():
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), flags=re.DOTALL)
    assert len([line for line in code.splitlines() if line]) == 10
    surface, deepest = dent(0.2)
    printed: list[Any] = []

    def printing(*values: Any) -> None:
        printed.extend(values)
        raise _Enough

    names: dict[str, Any] = {"print": printing}
    done = threading.Event()
    with Publisher("tcp://127.0.0.1:*", HostClock()) as publisher:
        # Any free port, as the documented one may be taken; all else as it stands.
        assert ADDRESS in code
        code = code.replace(ADDRESS, publisher.address)

        def publish() -> None:
            number = 0
            while not done.wait(0.01):
                number += 1
                publisher.publish(a_step(number, (surface, deepest)))

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            with pytest.raises(_Enough):
                exec(compile(code, str(DOCUMENT), "exec"), names)
        finally:
            done.set()
            thread.join()
            names["socket"].context.destroy(linger=0)
    state, peak, touching = printed
    assert state == "locked"
    assert peak["depth_mm"] == deepest.depth_mm
    assert touching in {False, True}
    # Half a unit in the last place of a 32-bit float.
    np.testing.assert_allclose(names["maps"]["depth_mm"], surface.depth_mm, rtol=2**-24)
    np.testing.assert_allclose(names["maps"]["slope"], surface.slope, rtol=2**-24, atol=1e-30)


def test_every_key_and_map_is_documented_and_no_other():
    from zeromethod.publishing import ContactEvent
    from zeromethod.publishing.message import encode

    contact = ContactEvent(1, "began", 0, 0.0, 0.0, 0.0)
    message = encode(a_step(1, dent()), session="", unix_time_ns=0, touching=False, contacts=[contact])
    header, maps = decoded(message)
    whole, borders = DOCUMENT.read_text().split("**Borders.**")
    assert sorted(_keys(whole)) == sorted([*header, *maps, *header["contacts"][0]])
    # sigmas stand next to what they are of
    assert set(_keys(borders)) <= {*ContactFigures.__dataclass_fields__, "outline_mm"}


def _keys(text: str) -> list[str]:
    """Names in the first column of the tables."""
    rows = re.findall(r"^\| (`.*?) \|", text, flags=re.MULTILINE)
    return [name for row in rows for name in re.findall(r"`(\w+)`", row)]
