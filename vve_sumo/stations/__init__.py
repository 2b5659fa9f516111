"""Real stations by a real on-board unit: what their messages say, which are believed, and their bodies on the road."""
