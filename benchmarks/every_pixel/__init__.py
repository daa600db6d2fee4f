"""Every pixel: small shapes and small changes, read by windows in time and by open loops."""
