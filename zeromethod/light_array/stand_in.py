"""A process that serves simulated arrays by UDP or a pseudo-terminal, with faults, in place of real ones.

    python -m zeromethod.light_array.stand_in udp://127.0.0.1:5010 --scenario step
    python -m zeromethod.light_array.stand_in serial --lose 0.01 --break 0.01

It sends a reading, waits at most `--wait` for the levels that answer it, and sends the next one. Its clock is
simulated time, so that nothing is lost on a slow computer. The first line on standard output is the address
for `run --camera`.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import time
import tty

import click
import numpy as np

from zeromethod.errors import InputError
from zeromethod.light_array.devices import Readings
from zeromethod.light_array.frames import LEVELS, READINGS, Frames, frame
from zeromethod.light_array.rig import load_light_array
from zeromethod.light_array.simulated import SimulatedArrays


class _Line:
    """The stand-in's end of a link. address: what a host opens."""

    def __init__(self, address: str) -> None:
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None
        self._frames = Frames(LEVELS)
        host, _, port = address.removeprefix("udp://").rpartition(":")
        if address.startswith("udp://") and port.isdigit() and int(port) < 65536:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._socket.bind((host, int(port)))
            self._handle = self._socket.fileno()
            self.address = f"udp://{host}:{self._socket.getsockname()[1]}"
        elif address == "serial":
            self._handle, far = os.openpty()
            tty.setraw(far)
            self.address = f"serial://{os.ttyname(far)}"
        else:
            raise InputError(f"{address}: udp://HOST:PORT, or serial")

    def levels(self, wait_s: float) -> list[Readings]:
        """Frames of levels that have come."""
        if not select.select([self._handle], [], [], wait_s)[0]:
            return []
        if self._socket is None:
            return self._frames.add(os.read(self._handle, 1 << 16))
        data, self._peer = self._socket.recvfrom(1 << 16)
        return self._frames.add(data)

    def send(self, data: bytes) -> None:
        """Send a frame to the host that sent levels last."""
        if self._socket is not None and self._peer is not None:
            self._socket.sendto(data, self._peer)
        elif select.select([], [self._handle], [], 0)[1]:
            os.write(self._handle, data)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("address", default="udp://127.0.0.1:5010")
@click.option("--rig", default="leds", help="Rig file of the arrays.")
@click.option("--scenario", default=None, help="What presses.")
@click.option("--lose", type=click.FloatRange(0, 1), default=0.0, help="Share of readings that are lost.")
@click.option(
    "--break", "broken", type=click.FloatRange(0, 1), default=0.0, help="Share that are broken on the way."
)
@click.option(
    "--stall", nargs=2, type=float, default=(0, 0), help="Send nothing from this frame on, for so long, s."
)
@click.option("--end", type=int, default=None, help="End after so many frames.")
@click.option("--wait", "wait_s", type=float, default=0.02, help="Wait so long for an answer, s.")
def stand_in(
    address: str, rig: str, scenario: str | None, lose: float, broken: float, stall: tuple[float, float],
    end: int | None, wait_s: float,
) -> None:  # fmt: skip
    """Serve simulated arrays at ADDRESS: udp://HOST:PORT, or serial."""
    luck, count = np.random.default_rng(0), 0
    try:
        arrays = load_light_array(rig)
        if arrays is None:
            raise InputError(f"--rig: {rig}: a rig of arrays")
        device, line = SimulatedArrays(arrays.changed(scenario)), _Line(address)
        click.echo(line.address)
        sys.stdout.flush()
        while not (asked := line.levels(0.2)):
            pass
        while end is None or count < end:
            for one in asked:
                device.send(one.number, one.counts)
            found = device.receive(0.1)
            count += 1
            if count == int(stall[0]):
                time.sleep(stall[1])
            if found is not None and luck.random() >= lose:
                data = bytearray(frame(READINGS, found))
                if luck.random() < broken:
                    data[100] ^= 0xFF
                line.send(bytes(data))
            asked = line.levels(wait_s)
    except KeyboardInterrupt:
        click.echo("interrupted", err=True)
        sys.exit(130)
    except (InputError, OSError) as error:
        words = f"{address}: {error.strerror}" if isinstance(error, OSError) else str(error)
        click.echo(f"stand_in: {words}", err=True)
        sys.exit(2)


if __name__ == "__main__":
    stand_in()
