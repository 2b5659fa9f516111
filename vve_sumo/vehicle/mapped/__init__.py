"""Interfaces made of a DBC file and a mapping, which says what its signals mean; names no brand."""
