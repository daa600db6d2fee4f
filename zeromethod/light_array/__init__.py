"""Arrays of LEDs and photodetectors in place of LCD and camera: the zero method in light levels."""
