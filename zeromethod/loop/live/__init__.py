"""A loop in real time: reopening, watching the clock, garbage collection in the pauses."""
