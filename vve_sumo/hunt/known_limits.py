"""Limits of what a gateway can know by its reports, each with its argument; a hunt counts them, and reports none."""

from __future__ import annotations

from typing import Final, NamedTuple

from vve_sumo.hunt.episode import Episode


class Limit(NamedTuple):
    """A violation that no gateway can prevent by the reports that it has."""

    invariant: str
    kinds: frozenset[str]  #: that the timeline has to hold
    why: str


LIMITS: Final = (
    Limit(
        "told_driving",
        frozenset({"steering_report_frozen", "dbw_dropout"}),
        "on a straight road a steering that is off and whose report is frozen differs from a good one in nothing; "
        "it is found as soon as the steering is told to move",
    ),
    Limit(
        "told_driving",
        frozenset({"brake_report_frozen", "dbw_dropout"}),
        "brakes that are off and whose report is frozen differ from good ones in nothing while they are not told to "
        "brake; they are found as soon as they are",
    ),
    Limit(
        "told_driving",
        frozenset({"throttle_report_frozen", "dbw_dropout"}),
        "a throttle that is off and whose report is frozen differs from a good one in nothing while it is told to stay "
        "closed; it is found as soon as it is told to open",
    ),
)


def known(invariant: str, episode: Episode) -> bool:
    """Whether a listed limit explains the violation."""
    kinds = {action.kind for action in episode.actions}
    return any(limit.invariant == invariant and limit.kinds <= kinds for limit in LIMITS)
