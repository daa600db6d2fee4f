"""Readings for other programs while a run goes on: one versioned message per step, the newest only."""

from zeromethod.publishing.events import ContactEvent, ContactWatch
from zeromethod.publishing.publisher import Publisher

__all__ = ["ContactEvent", "ContactWatch", "Publisher"]
