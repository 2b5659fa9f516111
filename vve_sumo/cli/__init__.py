"""The command line: one file a command. Parses, calls, prints; no other room prints."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; an interrupt from the keyboard is 130, also while modules load."""
    try:
        from vve_sumo.cli import dispatch
    except KeyboardInterrupt:
        return 130
    return dispatch.main(arguments)
