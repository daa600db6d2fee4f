"""A recorded session once more: read again, sensed again, or lived through again by a simulated bench."""
