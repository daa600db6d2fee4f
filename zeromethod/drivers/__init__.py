"""Drivers of real devices: found by the rig file's `driver`, imported only when it names them."""
