"""Mutation testing of the modules that decide whether a car is braked: `python -m tests.mutation`."""
