"""A loop in real time: threads for camera and display, reopening, and garbage collection in the pauses."""
