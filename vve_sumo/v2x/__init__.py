"""Codecs of V2X messages (ETSI ITS) and of the headers that carry them: values to bytes and back.

Nothing here does I/O, reads a clock or knows the simulation. When a station sends, and who receives, is said elsewhere.
"""
