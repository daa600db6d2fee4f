"""The tables of a recording: rows that are what was written, states and events in this version's order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Image
from zeromethod.recording.columns import CONTACTS, TABLES, row_dtype
from zeromethod.recording.opening import Refusal, RefusedRecording
from zeromethod.recording.peaks import peak_table
from zeromethod.recording.schema import ANCHORS, EVENTS, STATES, AnchorMode
from zeromethod.recording.source import RecordingFile

TURNS = np.dtype([("number", "i8"), ("time_ns", "i8"), ("state", "u1")])
"""Columns of a step that its peak's row has, too."""


class Tables:
    """Sound rows of every table; the file's own words say what its states, events and anchors are."""

    def __init__(self, source: RecordingFile) -> None:
        self._source = source
        self._rows: dict[str, Image] = {}
        self._peaks: Image | None = None
        self._turns: Image | None = None
        self._left_out: set[int] = set()

    def rows(self, name: str) -> Image:
        """Rows of a table but for damaged ones. Raises RefusedRecording for words that are not known."""
        if name not in self._rows:
            rows = self._source.rows(name)
            if "state" in (rows.dtype.names or ()):
                rows = self._in_our_words(name, rows)
            self._rows[name] = rows
        return self._rows[name]

    def turns(self) -> Image:
        """Number, time_ns and state of every step; where its row is damaged, as its peak's has it."""
        if self._turns is None:
            found = [self.rows("steps")]
            if not self._source.sound_rows("steps").all():
                read = self.rows("peaks")
                known = np.isin(read["step"], [*found[0]["number"], *self._left_out])
                found.append(read[~known])
            self._turns = np.empty(sum(map(len, found)), TURNS)
            for name in TURNS.names or ():
                own = [one["step" if name == "number" and one is not found[0] else name] for one in found]
                self._turns[name] = np.concatenate(own)
            self._turns.sort(order="number")
        return self._turns

    def origin_words(self) -> str:
        """From where times count, where that is not the first step because its row is damaged; else ""."""
        sound, turns = self._source.sound_rows("steps"), self.turns()
        if sound[:1].all() or not len(turns):
            return ""
        return f"damaged: the row of the first step: times count from step {turns['number'][0]}"

    def presentation_log(self) -> Image:
        """Rows up to the first damaged one: other tables count them."""
        rows, sound = self.rows("presentation_log"), self._source.sound_rows("presentation_log")
        return rows if sound.all() else rows[: int(np.argmin(sound))]

    def first_unknown_picture(self) -> int | None:
        """Step after which the first damaged one of them may have been shown; None: none is."""
        if self._source.sound_rows("presentation_log").all():
            return None
        known = self.presentation_log()["after_step"]
        return int(known[-1]) if len(known) else 0

    def peaks(self) -> Image:
        """Table of peaks as `peak_table` makes it."""
        if self._peaks is None:
            rows = self.rows("peaks")
            rows = rows[~np.isin(rows["step"], list(self._left_out))]
            start_ns = self.turns()["time_ns"][:1]
            # of a file that grows, the steps may have been read just before its first one
            self._peaks = peak_table(rows if len(start_ns) else rows[:0], start_ns)
        return self._peaks

    def later(self, name: str) -> Image:
        """Rows of one of `LATER`, none where the file has no such table."""
        if f"{name}/table" in self._source.names:
            return self.rows(name)
        return np.zeros(0, row_dtype(TABLES[name][0]))

    def contacts(self) -> Image:
        """Rows of the table of contacts; none where the file has no such table."""
        rows = self.later("contacts")
        whole = np.zeros(len(rows), row_dtype(CONTACTS))
        for name in CONTACTS:
            # files made before there were forces have no such columns
            whole[name] = rows[name] if name in (rows.dtype.names or ()) else np.nan
        return whole

    def contact_images(self) -> Image:
        """Rows of the table of contacts' images; none where the file has no such table."""
        return self.later("contact_images")

    def fine_peaks(self) -> Image:
        """Rows of the table of fine surfaces' peaks; none where the file has no such table."""
        return self.later("fine_peaks")

    def approaches(self) -> Image:
        """Rows of the table of what comes; none where the file has no such table."""
        return self.later("approaches")

    def contact_status(self) -> Image:
        """Rows of the table of how a texture rubs; none where the file has no such table."""
        return self.later("contact_status")

    def pointers(self) -> Image:
        """Rows of the table of pointer events; none where the file has no such table."""
        return self.later("pointers")

    def calls(self) -> Image:
        """Rows of the table of calls; none where the file has no such table."""
        return self.later("calls")

    def damaged_steps(self, name: str) -> set[int]:
        """Steps whose row of "steps" or "peaks" is left out, as far as it still says which step it is of."""
        field = "number" if name == "steps" else "step"
        found = set(self._source.damaged_rows(name)[field].tolist())
        return found | self._left_out if name == "peaks" else found

    def left_out(self) -> dict[str, int]:
        """Number of damaged items by group among those that were asked for by now."""
        found = {group: len(items) for group, items in self._source.left_out.items()}
        peaks = found.get("peaks", 0) + len(self._left_out)
        return found | ({"peaks": peaks} if peaks else {})

    def leave_out(self, steps: set[int]) -> int:
        """Leave the peaks of these steps out, too; number of steps that are left out by now."""
        self._left_out |= steps
        # and read again: what was read in silence is warned of then
        self._rows.clear()
        self._peaks = self._turns = None
        return len(self._left_out)

    def anchor(self, group: str, index: int) -> AnchorMode:
        """How a reading of "surface" or "fine_nodes" was anchored."""
        return ANCHORS[self._places(group, "anchors", ANCHORS)[index]]

    def _in_our_words(self, name: str, rows: Image) -> Image:
        """The same with states and events as indices into STATES and EVENTS."""
        states = self._places(name, "states", STATES)
        events = self._places(name, "events", EVENTS) if "events" in (rows.dtype.names or ()) else []
        if states == list(range(len(states))) and events == list(range(len(events))):
            return rows
        rows = rows.copy()
        rows["state"] = np.array(states, np.uint8)[rows["state"]]
        if events:
            theirs = rows["events"].copy()
            rows["events"] = 0
            for bit, place in enumerate(events):
                rows["events"] |= (theirs >> np.uint64(bit) & np.uint64(1)) << np.uint64(place)
        return rows

    def _places(self, name: str, attribute: str, ours: Sequence[str]) -> list[int]:
        """Index among our words of each of the file's."""
        words, known = self._source.words(f"{name}/table", attribute), [str(word) for word in ours]
        if len(set(words)) < len(words) or not set(words) <= set(known):
            unknown = next((word for word in words if word not in known), words[0])
            raise RefusedRecording(
                self._source.path, Refusal.WORDS, part=f"{name}/table: {attribute}", word=unknown
            )
        return [known.index(word) for word in words]
