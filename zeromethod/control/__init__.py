"""Controllers: from the measured warp to the commanded one."""
