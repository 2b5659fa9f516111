"""Tests how an external control computer reacts to faults of its sensor data."""
