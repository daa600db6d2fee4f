"""The virtual bench: prism and camera played by a process of their own."""
