"""A brain that knows only the wires: NCOM and the radar datagram in, setpoints out.

    python stop_for_parked.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

It follows recorded waypoints (latitude_deg, longitude_deg) by pure pursuit, keeps a speed, and stops before what the
radar sees in its way. It never drives by what is invalid: it answers such a datagram with nothing, and the gateway on
the other side stops the car.
"""

from __future__ import annotations

from driving import Brain, answer_by_radar, waypoints

if __name__ == "__main__":
    answer_by_radar(lambda given: Brain(waypoints(given.waypoints), given.speed), __doc__)
