"""A brain with a planted bug, to test benches with: it swaps the sign of the range rate.

    python bug_swaps_sign.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

All the rest of it is `stop_for_parked.py`'s. It must never drive a car.
"""

from __future__ import annotations

from driving import Brain, Gnss, Target, answer, arguments, listen, waypoints


class SwapsSign(Brain):
    """Takes a range rate for closing positive."""

    def range_rate(self, target: Target) -> float:
        """Return the wrong radial speed: closing positive [m/s]."""
        return -target.range_rate


def main() -> None:
    """Answer until interrupted."""
    given = arguments(__doc__).parse_args()
    brain = SwapsSign(waypoints(given.waypoints), given.speed)
    answer(brain, Gnss(given.gnss), listen(given.radar), given.setpoints, lambda _fix, radar: radar, given.key)


if __name__ == "__main__":
    main()
