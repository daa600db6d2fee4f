"""The check at the start of a day: whether the bench is still the one that was calibrated."""
