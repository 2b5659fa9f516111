"""Maps reason codes to plain words: those of the drive, the virtual road and the live processes, and a lookup for all.

Must not know which part gives a code or what follows from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from vve_sumo.people import person
from vve_sumo.pose import trust
from vve_sumo.vehicle import arming

#: Codes that neither the gateway (`arming.REASONS`), the trust gate (`trust.REASONS`) nor a person (`person.REASONS`)
#: defines.
DRIVE_REASONS: Final[dict[str, str]] = {
    "above_desired_speed": "the car is faster than the scenario's speed and its margin",
    "actors_not_finite": "the virtual road holds an actor whose place or speed is not a number",
    "brain_overdue": "the external controller did not answer within the time that the rig gives it in lockstep",
    "brain_silent": "no setpoint of the external controller is alive",
    "car_moves": "the receiver reports that the car moves",
    "controller_not_finite": "the controller asked for something that is not a number",
    "controller_path_invalid": "the controller commanded a path that no car could drive from where it is",
    "controller_raised": "the controller raised an exception",
    "controller_wrong_type": "the controller returned something that is no setpoint",
    "drive_lost": "the drive's process ended before the drive did",
    "ego_absent": "the car is not on the virtual road yet",
    "ego_lost": "the car vanished from the virtual road",
    "ego_not_placed": "the virtual road was stepped without a pose of the car",
    "ego_sync_heading": "SUMO turned the car away from the heading it was given",
    "ego_sync_position": "SUMO moved the car away from the place it was given",
    "ego_sync_speed": "SUMO gave the car another speed than it was given",
    "end_contact": "the car touched something, and the scenario ends the drive for that",
    "end_deviation": "the car was farther off its path than the scenario goes on with",
    "end_ego_at": "the car has come as far as the scenario lets it",
    "end_story": "the scenario's own trigger ended the drive",
    "end_ttc": "the time to collision fell below what the scenario goes on with",
    "first_car_waits": "the car of [ego] has not been told to go yet, so a simulated ego beside it waits",
    "gateway_gone": "the gateway's process is gone: the DBW controller's watchdog brakes",
    "gateway_silent": "the gateway's process says nothing: nobody could stop the drive",
    "geofence_breach": "the car could not be sure to come to rest inside the lot",
    "internal_error": "a mistake in this program; the traceback lies in the record",
    "latency_budget": "too many ticks within a second took longer than the rig's budget, or than a period",
    "live_drive_over": "the drive of the car of [ego] was over, and with it that of the simulated egos beside it",
    "not_calm": "waiting for a calm second of the computer",
    "off_path": "the car is farther off its path than allowed",
    "other_car_gone": "the gateway of another real car is gone or silent: nobody commands that car",
    "other_car_stopped": "another real car was stopped, or is no longer engaged",
    "outputs_gone": "the process of the outgoing wires is gone: the external controller sees nothing",
    "overrun": "the drive's loop was too late too often: its ticks were skipped",
    "path_leaves_lot": "the path leads to where the car could not stop inside the lot",
    "people_gone": "the process of the people's page is gone: nothing is known of them any more",
    "pose_foreign_sender": "another sender than the rig's pose.source speaks to the receiver's port",
    "pose_not_finite": "the pose handed to SUMO is not a number",
    "pose_not_front_bumper": "the pose handed to SUMO is of another point than the front bumper",
    "pose_out_of_bounds": "the pose lies outside the virtual road, or is faster than any car",
    "pose_two_senders": "two programs or devices speak to the receiver's port from the receiver's address",
    "profile_may_not_arm": "this source of poses is good for looking on, not for driving a car",
    "record_failed": "the record cannot be written any more",
    "record_full": "the recorder does not keep up",
    "record_lost": "the recorder's process is gone",
    "road_failed": "the virtual road or an actor on it met a mistake of the program and stands still",
    "road_not_measured": "the virtual road's steps take too long, or too few of them were measured",
    "sensor_late": "a virtual sensor has had no new reading for longer than it may",
    "sensor_not_finite": "a virtual sensor measured something that is not a number",
    "sensor_raised": "a virtual sensor raised an exception",
    "sensor_wrong_type": "a virtual sensor's reading is not what its kind declares",
    "setpoint_foreign_sender": "another sender than the rig's brain.source speaks to the port of setpoints",
    "setpoint_two_senders": "two programs or devices speak to the port of setpoints from the brain's address",
    "simulation_error": "the simulation broke",
    "start_heading": "the car does not face along its path at the path's start",
    "start_position": "the car does not stand at its path's start",
    "stations_gone": "the process that hears the real on-board unit is gone: nothing is known of its stations any more",
    "sumo_error": "SUMO refused a call or a step",
    "virtual_contact": "the car touches something on the virtual road",
}

ALL: Final[Mapping[str, str]] = {**trust.REASONS, **arming.REASONS, **person.REASONS, **DRIVE_REASONS}


def in_words(code: str) -> str:
    """Return the plain words of a reason code, or the code itself where it is unknown."""
    return ALL.get(code, code)
