"""`zeromethod replay FILE --view`: a recording on the operator's page."""

from __future__ import annotations

import time
from functools import partial

from zeromethod.cli.keys import Keys
from zeromethod.cli.page_options import opened_page
from zeromethod.errors import InputError
from zeromethod.operating.player import Player
from zeromethod.operating.readings import HISTORY
from zeromethod.operating.replay_table import REPLAY
from zeromethod.page.replay_content import ReplayContent
from zeromethod.recording.recording import Recording

LOOK_S = 1 / 60


def watch_recording(recording: Recording, view: str | None, control: str | None, speed: float | None) -> None:
    """Play a recording until it is closed, by its page, q or Ctrl-C. Raises InputError where it is empty."""
    if not len(recording.steps):
        raise InputError(f"{recording.path}: there is no step in it: nothing to show")
    with opened_page(view, control, REPLAY, HISTORY) as page, Keys() as keys:
        assert page is not None
        player = Player(recording.seconds, speed or 1.0)
        content = ReplayContent(recording, player)
        page.draw_by((recording.rig, recording.rest))
        page.attach(player.controls)
        for said in content.said():
            page.say(said)
        shown: tuple[object, ...] | None = None
        while not player.closed:
            for key in keys.pressed().lower():
                if key == "p":
                    player.controls.call("pause" if player.playing else "play", source="terminal")
                elif key == "q":
                    player.controls.call("close", source="terminal")
            player.controls.attend()
            index = content.index_at(player.at_s())
            now = index, player.playing, player.speed, player.from_s, player.to_s, int(2 * time.monotonic())
            if now != shown:
                shown = now
                page.offer(partial(content.compose, index))
            time.sleep(LOOK_S)
