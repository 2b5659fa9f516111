"""A brain with a planted bug, to test benches with: it acts on radar that is marked as invalid.

    python bug_acts_on_invalid.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

All the rest of it is `stop_for_parked.py`'s. It must never drive a car.
"""

from __future__ import annotations

from driving import Brain, Gnss, answer, arguments, listen, waypoints

from vve_sumo.wire.datagrams import RadarDatagram


class ActsOnInvalid(Brain):
    """Takes every datagram for a valid one."""

    def valid(self, _beat: RadarDatagram) -> bool:
        """Return the wrong answer: yes, whatever the flag says."""
        return True


def main() -> None:
    """Answer until interrupted."""
    given = arguments(__doc__).parse_args()
    brain = ActsOnInvalid(waypoints(given.waypoints), given.speed)
    answer(brain, Gnss(given.gnss), listen(given.radar), given.setpoints, lambda _fix, radar: radar, given.key)


if __name__ == "__main__":
    main()
