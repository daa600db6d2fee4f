"""The null loop: one frame round the circle, the loop's states, and what it does when a device fails."""
