"""The command line: one file a command. Parses, calls, prints; no other room prints."""

from __future__ import annotations

from vve_sumo.cli.dispatch import main

__all__ = ["main"]
