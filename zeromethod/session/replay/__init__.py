"""Replay of a recorded session: from its warps, from its frames, or in closed loop on a simulated bench."""
