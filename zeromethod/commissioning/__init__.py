"""At the bench: focus, orientation, delay, response and the whole calibration, measured on real devices."""
