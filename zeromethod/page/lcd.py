"""The LCD's picture, drawn again from the command: the display itself is not asked."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from zeromethod.errors import InputError
from zeromethod.gl import create_context
from zeromethod.page.encoding import Encoded, jpeg
from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest


class LcdPictures:
    """Draws in a thread of its own, the newest only; a GL context belongs to one thread."""

    def __init__(self, done: Callable[[dict[str, Any], bytes], None]) -> None:
        """done: called, in that thread, with what is said of a picture, and the picture."""
        self._done = done
        self._wanted: queue.Queue[tuple[tuple[Rig, Rest], Encoded]] = queue.Queue(1)
        self._thread: threading.Thread | None = None

    def draw(self, drawing: tuple[Rig, Rest], content: Encoded) -> None:
        """Draw the picture of a content, unless one is being drawn."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, name="LCD pictures", daemon=True)
            self._thread.start()
        if self._wanted.empty():
            self._wanted.put((drawing, content))

    def _serve(self) -> None:
        made: tuple[Any, Target, PatternRenderer] | None = None
        try:
            context = create_context()
        except InputError:
            return  # the page says that there is no picture
        with context:
            while True:
                drawing, content = self._wanted.get()
                rig, rest = drawing
                contrast = content.content.values.get("contrast", rig.target.contrast)
                spec = rig.target.model_copy(update={"contrast": contrast})
                target = Target.from_spec(spec)
                if made is None or made[0] is not drawing or made[1] != target:
                    lattice = rest.grid, rest.q, rest.display_size
                    response = Response.from_rig(rig.display)
                    made = drawing, target, PatternRenderer(context, *lattice, target, response)
                q = np.asarray(content.content.arrays["lcd"]["q"], np.float64)
                about = content.content.meta["lcd"] | {"size": list(rest.display_size)}
                self._done(about, jpeg(np.ascontiguousarray(made[2].image(q))))
