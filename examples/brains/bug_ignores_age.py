"""A brain with a planted bug, to test benches with: it never checks how old the radar is.

    python bug_ignores_age.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

All the rest of it is `stop_for_parked.py`'s. It must never drive a car.
"""

from __future__ import annotations

from driving import Brain, Gnss, Seen, answer, arguments, listen, waypoints


class IgnoresAge(Brain):
    """Takes every scan for a new one."""

    def age(self, _seen: Seen) -> float:
        """Return the wrong age: none, however old the scan is [s]."""
        return 0.0


def main() -> None:
    """Answer until interrupted."""
    given = arguments(__doc__).parse_args()
    brain = IgnoresAge(waypoints(given.waypoints), given.speed)
    answer(brain, Gnss(given.gnss), listen(given.radar), given.setpoints, lambda _fix, radar: radar, given.key)


if __name__ == "__main__":
    main()
