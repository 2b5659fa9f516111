"""From a receiver's bytes to trusted, smoothed, predicted poses."""
