"""The command `zeromethod`."""
