"""A simulated bench behind the device protocols: press, mirror, panel, camera, clocks and faults."""
