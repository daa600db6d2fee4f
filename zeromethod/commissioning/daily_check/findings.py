"""What a daily check found, and how much of it depth can bear."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime


class Fitness(enum.StrEnum):
    """What may be done with a bench, the best first."""

    GOOD = "good"
    DRIFTED = "drifted"  # usable after what the finding says
    UNFIT = "not fit to measure"  # light, focus, devices: see to them first
    RECALIBRATE = "calibrate again"

    @property
    def severity(self) -> int:
        """0 for good; larger is worse."""
        return list(Fitness).index(self)


class Subject(enum.StrEnum):
    """What is looked at, in this order."""

    CALIBRATION = "calibration"
    LIGHT = "light and focus"
    DELAY = "delay"
    REST = "place of the rest"
    FRAMES = "frames"
    PRESS = "known press"


@dataclass(frozen=True)
class Finding:
    """One subject's result: what was measured, what it means for depth, what to do. figures: by name."""

    subject: Subject
    fitness: Fitness
    words: str
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class DailyCheck:
    """The findings of one check of a rig.

    Attributes
    ----------
    rig : str
        Name of the rig.
    findings : tuple of Finding
        One for every subject that could be looked at, in their order.
    time : datetime
        When, in UTC.
    """

    rig: str
    findings: tuple[Finding, ...]
    time: datetime = field(default_factory=lambda: datetime.now(UTC))

    @property
    def worst(self) -> Finding:
        """The finding that decides."""
        return max(self.findings, key=lambda finding: finding.fitness.severity)

    @property
    def fitness(self) -> Fitness:
        """What may be done with the bench."""
        return self.worst.fitness

    @property
    def verdict(self) -> str:
        """One line."""
        if self.fitness is Fitness.GOOD:
            return f"{self.fitness}: the bench is as it was calibrated"
        return f"{self.fitness}: {self.worst.subject}: {self.worst.words}"

    @property
    def figures(self) -> dict[str, float]:
        """All figures by name."""
        return {name: value for finding in self.findings for name, value in finding.figures.items()}
