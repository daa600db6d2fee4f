from .evaluation import (
    Calibration,
    evaluate,
    evaluate_or_keep,
    rest_alone,
)
from .plan import Plan, Recorded
from .procedure import record
from .prompts import Prompts, Silent
from .storing import recall, store_calibration

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
