"""What a run says when something does not hold."""

from __future__ import annotations


class Violation(AssertionError):  # noqa: N818
    """An invariant that did not hold."""


def hold(number: int, truth: bool, what: object = "") -> None:
    """Raise Violation with the invariant's number unless `truth`."""
    if not truth:
        raise Violation(f"{number}: {what!r}")
