"""The operator's page: a server process of its own, fed with the newest of a run, and what browsers load."""
