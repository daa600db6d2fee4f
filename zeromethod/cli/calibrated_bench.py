"""Whether the devices are those that a rig file was calibrated with."""

from __future__ import annotations

from zeromethod.calibration.fingerprint import check
from zeromethod.calibration.folder import Stored
from zeromethod.cli.device_options import other_devices
from zeromethod.devices.opening import Devices
from zeromethod.errors import InputError
from zeromethod.rig.model import SIMULATED, Rig


def check_calibration(
    stored: Stored, rig_name: str, rig: Rig, devices: Devices, *, force: bool | None = None
) -> None:
    """Refuse a rig file that was calibrated on another bench.

    force: take it all the same; None where the command has neither `--force` nor `--simulate` to offer.
    """
    differences = check(stored.fingerprint, rig, devices.camera, devices.display)
    if differences and not force:
        others = other_devices(stored.fingerprint, rig)
        if missing := " and ".join(option for option, spec in others if spec.driver == SIMULATED):
            simulate = "" if force is None else ", or --simulate"
            raise InputError(f"--rig: {rig_name}: calibrated with real devices: give {missing}{simulate}")
        give = "" if force is None else ", or give --force"
        raise InputError(f"--rig: {rig_name}: {'; '.join(differences)}: calibrate again{give}")
