"""Golden runs: a dozen scenarios, everything that they say compared with a baseline, bit for bit."""
