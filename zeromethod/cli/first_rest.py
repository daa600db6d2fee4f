"""What `run` does first on a bench that was never calibrated."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from zeromethod.commissioning.calibration.prompts import Silent
from zeromethod.devices.opening import Devices
from zeromethod.rig.model import Rig
from zeromethod.session.trust import is_known, with_stated_geometry


@contextmanager
def with_first_rest(rig: Rig, rig_name: str, devices: Devices) -> Iterator[Rig]:
    """The rig as it is where its geometry is known; else from the rest as it is now, with what is not known.

    Raises MeasurementError where the rest cannot be measured.
    """
    if is_known(rig, devices.camera):
        yield rig
        return
    click.echo(
        f"! {rig_name}: not calibrated: depth will be relative, until zeromethod calibrate --rig {rig_name}",
        err=True,
    )
    with TemporaryDirectory(prefix="zeromethod-rest-") as folder:
        if rig.camera.rest_map is None:
            from zeromethod.commissioning.first_rest import first_rest  # noqa: PLC0415 - loads slowly

            click.echo("measuring the rest first: do not touch the mirror", err=True)
            file = Path(folder) / "rest.npz"
            first_rest(rig, devices, Silent()).save(file)
            click.echo("the rest is measured", err=True)
            rig = rig.replace({"camera.rest_map": file})
        yield with_stated_geometry(rig, devices.camera)[0]
