"""Says whether a control computer of somebody else's copes when its sensors lie."""
