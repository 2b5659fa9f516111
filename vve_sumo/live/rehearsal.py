"""Puts a real car's rig on simulated wires, so that everything that its file says is driven before the first day.

Vehicle, calibration, mounting, lot, alignment, limits, watchdog test and kind of receiver stay what the file says. Bus
and receiver's wire become emulated ones of this machine; what else the rig opens is left out. Opens nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.lot.fit import fit
from vve_sumo.plant.receiver import MAX_RATE
from vve_sumo.pty_link import PREFIX
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import PTY

LOOPBACK: Final = "127.0.0.1"
#: file, in the rehearsal's folder, that becomes a link to the simulated receiver's line or CAN adapter
RECEIVER_LINK: Final = "receiver.pty"
#: tables that open something beside bus and receiver
LEFT_OUT: Final = ("outputs", "others", "v2x", "people_page", "view")


class Rehearsal(NamedTuple):
    """A rig on simulated wires."""

    rig: Rig
    notes: tuple[str, ...]  #: what differs from the file, a line each


def rehearsed(rig: Rig, file: Path, resolved: ResolvedScenario, folder: Path) -> Rehearsal:
    """Return a real car's rig on simulated wires for a scenario; links to them are made in `folder`.

    The simulated vehicle is the car that the rig declares and calibrates. It stands where the rig's alignment has the
    path's start, or where a search lays the path into the lot. Raises ConfigError, naming `file`, for a rig that is
    simulated already, for one with an external controller, and for a receiver that cannot be simulated.
    """
    if rig.car != "real":
        raise ConfigError(f"--rehearse: car of {file} is simulated already; leave it out")
    if rig.brain.kind != "own":
        raise ConfigError(
            f"--rehearse: brain.kind of {file} is {rig.brain.kind!r}: an external controller is on a wire of its own; "
            "expected 'own'"
        )
    table = rig.model_dump(mode="json", exclude_unset=True)
    table |= {"car": "simulated", "bus": {**table["bus"], "interface": "slcan", "channel": PTY}}
    table["pose"] = _pose(rig, table["pose"], folder)
    table["car_start"] = _car(rig, resolved)
    table["people"] = [_simulated_person(person) for person in table.get("people", [])]
    left_out = [name for name in LEFT_OUT if table.pop(name, None)]
    found = rigs.parse_json(table, file)
    for problem in _real_wires(found):
        raise ConfigError(f"--rehearse: {file}: {problem}")
    wires = f"rehearsal: bus {rig.bus.interface}:{rig.bus.channel} is emulated, {meaning.receiver_of(found).place()} is"
    notes: tuple[str, ...] = (f"{wires} the simulated {found.pose.kind}; no hardware is opened",)
    if rig.pose.rate_hz > MAX_RATE:
        notes += (f"rehearsal: the receiver sends {MAX_RATE:g} fixes a second, the rig says {rig.pose.rate_hz:g}",)
    if left_out:
        notes += (f"rehearsal: left out of the rig: {', '.join(left_out)}",)
    return Rehearsal(found, notes)


def _pose(rig: Rig, table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the receiver's table with its wire on this machine."""
    keys, link = type(rig.pose).model_fields, f"{PREFIX}{folder / RECEIVER_LINK}"
    changed = {key: value for key, value in table.items() if key != "source"}
    if "address" in keys:
        changed["address"] = LOOPBACK
    if "device" in keys:
        changed["device"] = link
    if {"interface", "channel"} <= set(keys):
        changed |= {"interface": "slcan", "channel": link}
    return changed


def _car(rig: Rig, resolved: ResolvedScenario) -> dict[str, Any]:
    """Return the simulated vehicle: it stands at the path's start, and is as the rig's calibration found the car."""
    frame, begin = meaning.frame_of(rig), resolved.path.at(0.0)
    alignment = meaning.alignment_of(rig, resolved.scenario.road.network)
    if alignment is None:
        geofence = meaning.geofence_of(rig, Alignment())
        speed = min(resolved.scenario.ego.speed_mps, rig.limits.speed_mps)
        alignment = fit(resolved.path, geofence, speed, resolved.corridor).alignment
    there = alignment.inverse().apply(pose_at_rest(begin.x, begin.y, begin.heading))
    latitude, longitude, heading = meaning.place_in_degrees(frame, there.x, there.y, there.heading)
    delay = rig.pose.minimum_delay_ms
    return {
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "heading_deg": heading,
        "steering_wheel_bias_deg": rig.calibration.steering_wheel_bias_deg,
        "heading_misalignment_deg": rig.mounting.heading_misalignment_deg,
        **({} if delay is None else {"gnss_delay_s": delay / 1000.0}),
    }


def _simulated_person(person: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in person.items() if key not in ("address", "port", "sender")}
    return kept | {"source": "simulated"}


def _real_wires(rig: Rig) -> Iterator[str]:
    """Yield whatever of a rig is no simulated wire; of a rehearsed one there is none."""
    if rig.car != "simulated" or (rig.bus.interface, rig.bus.channel) != ("slcan", PTY):
        yield f"bus {rig.bus.interface}:{rig.bus.channel} is none of this machine's own"
    if rig.car_start is None or rig.car_start.channel is not None or rig.car_start.brain_channel is not None:
        yield "car_start: names a channel"
    if why := meaning.receiver_of(rig).not_simulated():
        yield f"pose.{why}"
    for key in ("device", "channel"):
        line = getattr(rig.pose, key, None)
        if line is not None and not str(line).startswith(PREFIX):
            yield f"pose.{key}: {line} is no simulated line"
    opened = rig.outputs or rig.others or rig.v2x or rig.brain.kind != "own"
    if opened or any(person.source != "simulated" for person in rig.people):
        yield "something beside bus and receiver would be opened"
