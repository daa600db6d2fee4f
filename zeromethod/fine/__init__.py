"""The fine surface: slope and depth on every camera pixel."""
