"""Calibrating a bench: record it step by step, evaluate what was recorded, store both.

recorded, rest = record(rig, devices, Plan(press_depths_mm=(0.2, 0.15)))
calibration = evaluate(recorded, rest)
stored = store_calibration(calibration, "my.toml")
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
