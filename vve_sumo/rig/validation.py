"""Refuses rigs that are unsafe or contradictory from one table of the rig file to another.

Checks the contents of the file only; opens no bus and no socket.
"""

from __future__ import annotations

import datetime
import ipaddress
import math
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.frames import local_frame
from vve_sumo.lot.swept_area import Body, as_pairs, fan
from vve_sumo.people.separation import distance_to_fence
from vve_sumo.physical_constants import EARTH_RADIUS
from vve_sumo.pose import oxts_can
from vve_sumo.pose.receivers.udp import UdpReceiver
from vve_sumo.pty_link import PREFIX
from vve_sumo.rig import stop_figures
from vve_sumo.rig.dates import day_to_come, expired_day
from vve_sumo.rig.resolve import (
    alignment_of,
    calibration_of,
    distance_between_lots,
    faults_of,
    frame_of,
    interface_of,
    limits_of,
    lot_of,
    outline_in,
    receiver_of,
    vehicle_of,
    with_alignment_for,
)
from vve_sumo.rig.schema import Corner, Rig
from vve_sumo.sensors.port import STANDARD
from vve_sumo.values import identifier_text
from vve_sumo.vehicle.interface import VehicleInterface, load
from vve_sumo.wire.outputs import KINDS

#: interfaces of python-can that anyone on the network can send into
OPEN_INTERFACES: Final = ("udp_multicast", "socketcand", "can_remote")
PTY: Final = "pty"  #: channel that the simulated vehicle's process makes
VIRTUAL_CAN: Final = "vcan"  #: with what the names of virtual SocketCAN interfaces begin
LEAST_LOT_DISTANCE: Final = 10.0  #: between the lots of two cars that drive at the same time [m]
MAX_LOT_EXTENT: Final = 20_000.0  #: from the first corner of a lot to any other place in it [m]

#: Identifiers on a CAN bus, by who sends or hears them: OXTS's default map (RT3000 manual: messages and one 0x500 + n
#: for each status channel n); Delphi ESR (opendbc, ESR.dbc); Continental ARS408 as sensor 0.
IDENTIFIERS: Final[dict[str, frozenset[int]]] = {
    "oxts_can": oxts_can.IDENTIFIERS,
    "esr": frozenset({*range(0x4E0, 0x4E4), 0x4F0, 0x4F1, *range(0x500, 0x541)}),
    "ars408": frozenset({0x200, 0x201, 0x300, 0x301, *range(0x600, 0x603), *range(0x60A, 0x60F), 0x700, 0x701, 0x702}),
}


class _OnBus(NamedTuple):
    key: str  #: in the rig file
    who: str
    bus: tuple[str, str]  #: interface and channel
    identifiers: frozenset[int]


def refuse(rig: Rig) -> None:
    """Raise ConfigError, naming the key, for the first thing that is wrong with a rig."""
    for complaint in _complaints(rig):
        raise ConfigError(complaint)


def arming_obstacle(rig: Rig, today: datetime.date) -> str | None:
    """Return why this rig may not command a car today (shadow mode stays possible); None where it may."""
    test = rig.watchdog_test
    if not receiver_of(rig).profile.may_arm:
        return "pose.kind: a recording says nothing about where a car is now"
    if rig.car == "simulated":
        return None
    if test is None:
        return (
            "watchdog_test is missing: stop the frames on this car, measure what the watchdog of its drive-by-wire "
            "controller does, write it down"
        )
    return day_to_come(rig, today) or expired_day(rig, today)


def common_ground(files: Mapping[Path, Rig]) -> str | None:
    """Return why these rigs' cars may not drive at the same time; None where each has a lot of its own.

    On the virtual road the cars may be far apart while they meet in the lot. A simulated car is in no lot.
    """
    real = [(file, rig) for file, rig in files.items() if rig.car == "real"]
    for (file, rig), (other_file, other) in combinations(real, 2):
        apart = distance_between_lots(rig, other)
        if apart < LEAST_LOT_DISTANCE:
            return (
                f"{other_file}: lot.outline: it comes within {apart:.1f} m of that of {file}, expected "
                f"{LEAST_LOT_DISTANCE:g} m or more between the lots of two cars that drive at the same time"
            )
    return None


def _complaints(rig: Rig) -> Iterator[str]:
    yield from _of_a_real_car(rig) if rig.car == "real" else _of_a_simulated_vehicle(rig)
    yield from _of_the_brain(rig)
    yield from _of_outputs(rig)
    yield from _collisions(rig)
    yield from _far_corners(rig)
    for resolve in (vehicle_of, calibration_of, limits_of, faults_of, lot_of):
        resolve(rig)
    yield from stop_figures.complaints(rig, _interface(rig).facts)
    alignment_of(rig, rig.alignment.network or "")
    if rig.car_start is not None:
        yield from _outside(rig)
    yield from _of_named_alignments(rig)
    yield from _of_the_watchdog(rig)
    yield from _of_people(rig)


def _of_named_alignments(rig: Rig) -> Iterator[str]:
    """Alignments of scenarios about another origin than the lot's map, which would lay the lot elsewhere."""
    origin = rig.alignment.origin or rig.lot.outline[0]
    for name, wanted in rig.alignments.items():
        if wanted.origin is not None and wanted.origin != origin:
            yield (
                f"alignments.{name}.origin: expected {list(origin)}, that of [alignment] or else the outline's first "
                "corner: the lot was surveyed anew, or [alignment] made elsewhere; align this scenario again"
            )
            return
        chosen = with_alignment_for(rig, name)
        try:
            alignment_of(chosen, wanted.network or "")
        except ConfigError as error:
            raise ConfigError(f"alignments.{name}: {error}") from None
        if wanted.start is not None and rig.car_start is not None:
            yield from (f"alignments.{name}.start: {complaint}" for complaint in _outside(chosen))


def _of_people(rig: Rig) -> Iterator[str]:
    ids = [person.id for person in rig.people]
    for number, person in enumerate(rig.people):
        if ids.count(person.id) > 1:
            yield f"people: id {person.id!r} stands twice, expected each once"
        if rig.car == "real" and person.source == "simulated":
            yield f"people.{number}.source: nobody simulated walks beside a real car, expected 'phone' or 'nmea_udp'"
        anchor = local_frame(math.radians(person.latitude_deg), math.radians(person.longitude_deg))
        distance = distance_to_fence(0.0, 0.0, outline_in(rig, anchor))
        if not distance >= person.least_distance_m:
            yield (
                f"people.{number}: the field's anchor is {distance:.1f} m from the lot's outline, expected at least "
                f"least_distance_m, {person.least_distance_m:g} m"
            )


def _of_a_real_car(rig: Rig) -> Iterator[str]:
    bus = rig.bus
    if bus.interface in OPEN_INTERFACES:
        yield f"bus.interface: anyone on the network could command a real car over {bus.interface!r}, use a CAN card"
    if bus.interface == "virtual" or bus.channel == PTY or bus.channel.startswith(VIRTUAL_CAN):
        yield f"bus: no real car is on {bus.interface}:{bus.channel}"
    if rig.operator.automatic:
        yield "operator.automatic: a real car is engaged by a person"
    for key, line in _pose_lines(rig).items():
        if line.startswith(PREFIX):
            yield f"pose.{key}: {line} is a simulated vehicle's line, expected the receiver's own"
    if rig.car_start is not None:
        yield "car_start: a real car stands where it stands, this is for car = 'simulated'"
    if rig.faults:
        yield "faults: none is injected into a real car, this is for car = 'simulated'"


def _of_a_simulated_vehicle(rig: Rig) -> Iterator[str]:
    start, bus, pose = rig.car_start, rig.bus, rig.pose
    if start is None:
        yield "key 'car_start' is missing: where the simulated vehicle stands"
        return
    if start.fidelity == "measured" and rig.measured is None:
        yield f"car_start.fidelity: expected 'ideal', for {rig.vehicle.model} has no table [measured], got 'measured'"
    if why := pose.not_simulated():
        yield f"pose.{why}"
    if (bus.interface, bus.channel) == ("slcan", PTY):
        if start.channel is not None:
            yield "car_start.channel: the car makes its own end of a pty"
    elif start.brain_channel is not None:
        yield f"car_start.brain_channel: only a pty needs it; a brain opens {bus.interface}:{bus.channel} itself"
    elif bus.interface != "socketcan":
        yield (
            f"bus: a simulated vehicle is on interface 'slcan', channel '{PTY}', or on 'socketcan', "
            f"got {bus.interface}:{bus.channel}"
        )
    elif not bus.channel.startswith(VIRTUAL_CAN) and start.channel in (None, bus.channel):
        yield f"car_start.channel: {bus.channel!r} is no vcan; name the card at the simulated vehicle's end of the bus"
    if rig.operator.automatic and not _emulated(rig):
        yield (
            f"operator.automatic: a wrong cable on {bus.interface}:{bus.channel} would make it engage a real car; only "
            f"on 'slcan', channel '{PTY}', or with both ends of the bus on a vcan does the program engage by itself"
        )


def _emulated(rig: Rig) -> bool:
    """Whether both ends of the car's bus are inside this computer by their names: a pty, or virtual SocketCAN."""
    bus, far_end = rig.bus, rig.car_start.channel if rig.car_start is not None else None
    if bus.interface == "slcan":
        return bus.channel == PTY
    return all(channel.startswith(VIRTUAL_CAN) for channel in (bus.channel, far_end or bus.channel))


def _of_the_watchdog(rig: Rig) -> Iterator[str]:
    """A watchdog that would have acted before the interface misses a command."""
    test, facts = rig.watchdog_test, _interface(rig).facts
    if test is not None and test.delay_s < facts.command_timeout:
        yield (
            f"watchdog_test.delay_s: {test.delay_s:g} s, but {rig.drive_by_wire.interface} waits "
            f"{facts.command_timeout:g} s for a command before anything happens; expected that at least"
        )


def _of_the_brain(rig: Rig) -> Iterator[str]:
    """An external controller that is without the outputs that it needs."""
    kind, output_kinds = rig.brain.kind, {output.kind for output in rig.outputs}
    if kind != "own" and not output_kinds:
        yield f"outputs: a brain of kind {kind!r} needs one at least, or it sees nothing"
    elif kind == "setpoints" and "radar" not in output_kinds:
        yield "outputs: expected one of kind 'radar': a setpoint of the brain names the radar datagram that it answers"
    for number, output in enumerate(rig.outputs):
        if output.sensor is not None and not KINDS[output.kind].contents:
            yield f"outputs.{number}.sensor: kind {output.kind!r} carries nothing of a sensor"
        elif output.sensor not in (None, STANDARD) and kind == "setpoints" and output.kind == "radar":
            yield f"outputs.{number}.sensor: a setpoint answers the datagrams of {STANDARD!r}, expected no other sensor"


def _of_outputs(rig: Rig) -> Iterator[str]:
    """Outputs on what the car is commanded by, on what this program itself listens on, or on one another."""
    for number, output in enumerate(rig.outputs):
        if (output.interface, output.channel) == (rig.bus.interface, rig.bus.channel):
            yield f"outputs.{number}: {output.interface}:{output.channel} commands the car; give the radar its own bus"
        if (output.channel or "").startswith("pty:") and output.interface != "slcan":
            yield f"outputs.{number}.interface: a pty is opened as 'slcan', got {output.interface!r}"
        if output.udp is not None and (listener := _listener(rig, output.udp)):
            yield f"outputs.{number}.udp: {output.udp} is where {listener} listens, expected the brain's address"
    devices = {rig.bus.channel: "bus"} if rig.bus.interface == "slcan" else {}
    devices |= {device: "pose"} if (device := getattr(rig.pose, "device", None)) is not None else {}
    for number, output in enumerate(rig.outputs):
        if output.device is not None and devices.setdefault(output.device, here := f"outputs.{number}") != here:
            yield f"{here}.device: {output.device} is the line of {devices[output.device]}, expected one of its own"
    links = [output.channel for output in rig.outputs if (output.channel or "").startswith("pty:")]
    links += [rig.car_start.brain_channel] if rig.car_start is not None and rig.car_start.brain_channel else []
    links += [line for line in _pose_lines(rig).values() if line.startswith(PREFIX)]
    for link in dict.fromkeys(link for link in links if links.count(link) > 1):
        yield f"outputs: {link} is named twice; a pty has one port, give each a file of its own"


def _pose_lines(rig: Rig) -> dict[str, str]:
    """Return the lines and channels that the receiver's table names, by key; a lab's own may hold what is no text."""
    named = {key: getattr(rig.pose, key, None) for key in ("device", "channel")}
    return {key: line for key, line in named.items() if isinstance(line, str)}


def _listener(rig: Rig, place: str) -> str:
    """Return the table of the rig that listens on a UDP place of this machine; empty for none."""
    host, _, port = place.rpartition(":")
    listening = {"pose": rig.pose} if isinstance(rig.pose, UdpReceiver) else {}
    tables = listening | ({"brain": rig.brain} if rig.brain.kind == "setpoints" else {})
    for name, table in tables.items():
        here = ipaddress.ip_address(table.address)
        heard = ipaddress.ip_address(host).is_loopback and (here.is_loopback or here.is_unspecified)
        if int(port) == table.port and (host == table.address or heard):
            return name
    if rig.v2x is not None:
        address, _, number = rig.v2x.listen.rpartition(":")
        loopback = ipaddress.ip_address(host).is_loopback and ipaddress.ip_address(address).is_loopback
        if port == number and (host == address or loopback):
            return "v2x"
    return ""


def _collisions(rig: Rig) -> Iterator[str]:
    """Two senders of the same identifiers on one bus; the shorter range is the one that is named."""
    car, receiver, stop = (rig.bus.interface, rig.bus.channel), receiver_of(rig).on_can(), rig.operator.stop_can_id
    on_bus = [_OnBus("bus", "the drive-by-wire controller", car, _interface(rig).facts.occupied)]
    if receiver is not None:
        on_bus.append(_OnBus("pose", rig.pose.kind, (receiver.interface, receiver.channel), receiver.identifiers))
    for number, other in enumerate(rig.others):
        bus = (other.interface, other.channel)
        on_bus.append(_OnBus(f"others.{number}", other.kind, bus, IDENTIFIERS[other.kind]))
    for number, output in enumerate(rig.outputs):
        if output.interface is not None and output.channel is not None:
            bus = (output.interface, output.channel)
            emulated = IDENTIFIERS.get(output.kind, frozenset({output.can_id or 0}))
            on_bus.append(_OnBus(f"outputs.{number}", f"emulated {output.kind}", bus, emulated))
    if stop is not None:
        on_bus.append(_OnBus("operator.stop_can_id", "the stop", car, frozenset({stop})))
    for one, two in combinations(on_bus, 2):
        shared = one.identifiers & two.identifiers
        if one.bus == two.bus and shared:
            yield (
                f"{two.key}: {two.who} and {one.who} ({one.key}) share identifiers {identifier_text(min(shared))} to "
                f"{identifier_text(max(shared))} on {':'.join(one.bus)}, give each a bus of its own"
            )


def _interface(rig: Rig) -> VehicleInterface:
    try:
        return load(interface_of(rig))
    except ConfigError as error:
        raise ConfigError(f"drive_by_wire: {error}") from None


def _far_corners(rig: Rig) -> Iterator[str]:
    """Corners and points that cannot belong to one lot."""
    first = rig.lot.outline[0]
    places = [("lot.outline", rig.lot.outline), ("alignment.lot_points", rig.alignment.lot_points or ())]
    places += [(f"lot.holes.{number}", hole) for number, hole in enumerate(rig.lot.holes)]
    places += [("alignment.origin", (rig.alignment.origin,))] if rig.alignment.origin else []
    for key, corners in places:
        for number, corner in enumerate(corners):
            if not _distance(corner, first) <= MAX_LOT_EXTENT:
                where = f"{_distance(corner, first) / 1000.0:.0f} km from the lot's first corner"
                yield f"{key}.{number}: lies {where}{_swapped(corner, first)}"


def _outside(rig: Rig) -> Iterator[str]:
    """A simulated vehicle that does not stand in its lot."""
    start = rig.car_start
    assert start is not None
    place, first = (start.latitude_deg, start.longitude_deg), rig.lot.outline[0]
    if not _distance(place, first) <= MAX_LOT_EXTENT:
        where = f"{_distance(place, first) / 1000.0:.0f} km from the lot"
        yield f"car_start: lies {where}{_swapped(place, first)}"
        return
    frame = frame_of(rig)
    latitude, longitude = math.radians(start.latitude_deg), math.radians(start.longitude_deg)
    heading = math.radians(90.0 - start.heading_deg) + frame.convergence(latitude, longitude)
    standing = as_pairs(fan(Body.of(vehicle_of(rig)), 0.0, 0.0, 0.0), *frame.to_map(latitude, longitude), heading)
    if not lot_of(rig).holds(standing):
        yield "car_start: the car does not stand inside the lot and clear of its margin"


def _swapped(place: Corner, near: Corner) -> str:
    latitude, longitude = place
    return " (latitude and longitude are swapped)" if _distance((longitude, latitude), near) <= MAX_LOT_EXTENT else ""


def _distance(one: Corner, other: Corner) -> float:
    """Great circle [m], haversine."""
    (latitude, longitude), (there, east) = ((math.radians(a), math.radians(b)) for a, b in (one, other))
    half = math.sin(0.5 * (there - latitude)) ** 2
    half += math.cos(latitude) * math.cos(there) * math.sin(0.5 * (east - longitude)) ** 2
    return 2.0 * EARTH_RADIUS * math.asin(min(1.0, math.sqrt(max(half, 0.0))))
