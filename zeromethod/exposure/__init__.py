"""What was lit on the LCD while a frame was exposed: presentation log, panel timing, strips, mixtures."""
