"""Calibrating a bench: record it step by step, evaluate what was recorded, store both.

recorded, rest = record(rig, devices, Plan(press_depths_mm=(0.2, 0.15)))
calibration = evaluate(recorded, rest)
stored = store_calibration(calibration, "my.toml")
"""

from zeromethod.commissioning.calibration.evaluation import (
    Calibration,
    evaluate,
    evaluate_or_keep,
    rest_alone,
)
from zeromethod.commissioning.calibration.plan import Plan, Recorded
from zeromethod.commissioning.calibration.procedure import record
from zeromethod.commissioning.calibration.prompts import Prompts, Silent
from zeromethod.commissioning.calibration.storing import recall, store_calibration

__all__ = [
    "Calibration",
    "Plan",
    "Prompts",
    "Recorded",
    "Silent",
    "evaluate",
    "evaluate_or_keep",
    "recall",
    "record",
    "rest_alone",
    "store_calibration",
]
