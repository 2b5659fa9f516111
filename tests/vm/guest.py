"""The suite that runs inside the virtual machine: SocketCAN of a stock kernel under the gateway and the car.

`WIRE=vcan python -m tests.vm.guest`, or WIRE=cards: as root, in a machine that has vcan and two CAN cards on one bus.
It prints a line for each check.
"""

from __future__ import annotations

import math
import os
import signal
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

from tests.vm.bench import Bench, Brain, LiveCar
from tests.vm.sender import LIFETIME, PERIOD, SPEED
from tests.vm.wires import FRAME, WIRES, Heard, Wire, ip, open_raw, transmitted
from vve_sumo.bus import Bus
from vve_sumo.errors import RigError
from vve_sumo.values import EXTENDED, ArmingState, Frame
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.interface import Gear

LINK_DOWN = 0.5  # [s]
BRAIN_SPEED = 2.0  # from which an external controller is stopped [m/s]
#: Gateway's and kit's stop alike are harder than this, and begin sooner [m/s2], [s].
STOP_DECELERATION, STOP_DELAY = 2.2, 0.45
GAP = 0.040  # longest between two commands of a gateway that is well [s]
COUNTED = {
    codec.BRAKE_COMMAND: codec.BrakeCommand,
    codec.THROTTLE_COMMAND: codec.ThrottleCommand,
    codec.STEERING_COMMAND: codec.SteeringCommand,
}


def check_frames(wire: Wire) -> str:
    """What the bus sends is what the kernel's own socket hears, bit for bit, and the other way round."""
    long = (EXTENDED, EXTENDED | 0x061, EXTENDED | 0x1FFF_FFFF)
    numbers = (0, 0x061, 0x7FF, *long)
    frames = [Frame(identifier, bytes(range(1, size + 1))) for size in range(9) for identifier in numbers]
    assert EXTENDED == socket.CAN_EFF_FLAG
    with Bus("socketcan", wire.gateway) as bus, open_raw(wire.car) as raw:
        raw.settimeout(1.0)
        for identifier, data in frames:
            wanted = FRAME.pack(identifier, len(data), data)
            bus.send(Frame(identifier, data))
            assert FRAME.unpack(raw.recv(FRAME.size)) == FRAME.unpack(wanted)
            # What a `Frame` cannot hold comes first and is passed over.
            raw.send(FRAME.pack(identifier | socket.CAN_RTR_FLAG, 0, b""))
            raw.send(wanted)
            assert bus.receive(1.0)[1] == Frame(identifier, data)
        time.sleep(0.05)
        assert bus.drain() == [], "the bus hears what it sent itself"
    return f"{len(frames)} frames each way"


def check_refusals(wire: Wire) -> str:
    """A bus that is not there or not up is refused in one line when it is opened or used, and is good again later."""
    ip("link", "set", wire.gateway, "down")
    with Bus("socketcan", wire.gateway) as bus:
        line = _refusal(lambda: bus.send(Frame(1, b"")))
        ip("link", "set", wire.gateway, "up")
        bus.send(Frame(1, b""))
    assert "Network is down" in line
    assert "\n" not in line
    assert wire.gateway in line
    assert "No such device" in _refusal(lambda: Bus("socketcan", "can7"))
    return line


def _refusal(doing: Callable[[], object]) -> str:
    try:
        doing()
    except RigError as error:
        return str(error)
    raise AssertionError("was not refused")


def check_nominal(wire: Wire, car: LiveCar) -> str:
    """Engage, go, to speed and back to rest by setpoints, stop, park; the gateway lets go and ends."""
    bench = Bench(wire, car, cruise=False)
    try:
        bench.engage()
        bench.until(lambda: bench.speed > SPEED - 0.1)
        bench.until(lambda: bench.speed < 0.01)
        bench.act(OperatorCommand.STOP)
        bench.finish()
    finally:
        bench.close()
    _ended_well(bench)
    _alive_until_park(bench)
    assert [row.process_faults for row in bench.rows if row.process_faults] == []
    states = [ArmingState.DISARMED, ArmingState.READY, ArmingState.ENGAGED, ArmingState.STOPPING, ArmingState.STOPPED]
    assert bench.states[:5] == states, bench.states
    assert set(bench.rows[-1].reasons.split("+")) == {"stop_asked"}, bench.rows[-1].reasons
    truth = car.truth(bench.begun)
    top = max(speed for _, _, speed in truth)
    assert abs(top - SPEED) < 0.3, top
    # Every command that the gateway says it sent was on the wire, once and in this order; nobody else sent one.
    heard = [heard.frame for heard in bench.witness.heard if heard.frame.id in layout.COMMAND_IDS]
    assert heard == bench.sent
    return f"top {top:.2f} m/s, {truth[-1][1] - truth[0][1]:.1f} m, {len(heard)} command frames"


def check_silence(wire: Wire, car: LiveCar) -> str:
    """A brain on the wire drives the car: every command frame is the brain's, and none is the gateway's."""
    bench, brain, before = Bench(wire, car, cruise=True, silent=True), Brain(wire), transmitted(wire.gateway)

    def until(condition: Callable[[], bool], *command: Any, **enabled: bool) -> None:
        deadline = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < deadline, (bench.states, bench.reasons, bench.speed)
            brain.step(*command, **enabled)
            bench.run(0.005)

    try:
        bench.until(lambda: ArmingState.READY in bench.states, patience=30.0)
        bench.act(OperatorCommand.ENGAGE)
        bench.until(lambda: "waiting_for_go" in bench.reasons)
        bench.act(OperatorCommand.GO)
        until(lambda: bool(_gears(bench)) and _gears(bench)[-1][1] is Gear.DRIVE, 1100.0, 0.0, Gear.DRIVE)
        until(lambda: bench.speed > BRAIN_SPEED, 0.0, 0.4, Gear.NONE)
        bench.act(OperatorCommand.STOP)
        until(lambda: bench.gateway.poll() is not None, 1500.0, 0.0, Gear.NONE)
        until(lambda: _gears(bench)[-1][1] is Gear.PARK, 1500.0, 0.0, Gear.PARK)
        let_go = bench.now + 0.1
        until(lambda: bench.now > let_go, 0.0, 0.0, Gear.NONE, enable=False)
        bench.run(0.1)
    finally:
        bench.close()
        brain.close()
    _ended_well(bench)
    heard = [heard.frame for heard in bench.witness.heard if heard.frame.id in layout.COMMAND_IDS]
    assert heard == brain.sent
    assert {row.frames_sent for row in bench.rows} == {0}
    states = [ArmingState.DISARMED, ArmingState.READY, ArmingState.ENGAGED, ArmingState.STOPPING]
    assert bench.states[:4] == states, bench.states
    sent = transmitted(wire.gateway) - before
    assert wire.gateway == wire.car or sent == 0, f"{wire.gateway} sent {sent} frames"
    return f"{len(heard)} command frames, every one the brain's; {wire.gateway} has sent {sent} in all"


def check_frozen_sender(wire: Wire, car: LiveCar) -> str:
    """The sender is stopped at speed: once its last setpoint is out of date, only the gateway's own stop is sent."""
    bench = Bench(wire, car, cruise=True)
    try:
        bench.engage()
        bench.until(lambda: bench.speed > SPEED - 0.3)
        bench.run(0.5)
        bench.sender.kill(signal.SIGSTOP)
        frozen = bench.now
        bench.until(lambda: ArmingState.STOPPED in bench.states)
        bench.sender.kill(signal.SIGCONT)  # now it asks to drive on, and nobody heeds it
        bench.finish()
    finally:
        bench.close()
    _ended_well(bench)
    _alive_until_park(bench)
    expired = _last_expiry(bench, frozen)
    assert expired < frozen + LIFETIME + 0.001
    after = [heard for heard in bench.commands(codec.THROTTLE_COMMAND) if heard.time > expired + PERIOD * 1.25]
    assert len(after) > 50
    assert all(codec.decode(heard.frame).value == 0.0 for heard in after)
    _brakes_only(bench, expired + PERIOD * 1.25)
    assert bench.rows[-1].reasons.split("+")[0] == "setpoint_expired", bench.rows[-1].reasons
    return _stopped_within(bench, frozen, LIFETIME)


def check_link_down(wire: Wire, car: LiveCar) -> str:
    """The gateway's interface goes down at speed and comes back: it goes on living, finds bus_down, and the car stops.

    Meanwhile no command reaches the car, and its kit's own watchdog brakes.
    """
    bench = Bench(wire, car, cruise=True)
    try:
        bench.engage()
        bench.until(lambda: bench.speed > SPEED - 0.3)
        bench.run(0.5)
        down = bench.now
        ip("link", "set", wire.gateway, "down")
        bench.run(LINK_DOWN)
        ip("link", "set", wire.gateway, "up")
        up = bench.now
        bench.finish()
    finally:
        bench.close()
    _ended_well(bench)
    found = [row.time_s for row in bench.rows if "bus_down" in row.process_faults]
    assert down < found[0] < down + 0.2, (down, found[0])
    assert up - 0.1 < found[-1] < up + 0.2, (up, found[-1])
    assert "bus_down" in bench.rows[-1].reasons.split("+"), bench.rows[-1].reasons
    times = [heard.time for heard in bench.commands(codec.BRAKE_COMMAND)]
    gap = max(later - earlier for earlier, later in pairwise(times))
    assert gap > LINK_DOWN - GAP, gap
    assert [time for time in times if time > up], "nothing was sent after the link was up again"
    _brakes_only(bench, up)
    return _stopped_within(bench, down, 0.0) + f", {gap:.2f} s without commands"


def _ended_well(bench: Bench) -> None:
    assert bench.gateway.returncode == 0, bench.gateway.returncode
    assert bench.car.truth(bench.begun)[-1][2] == 0.0, "the car moves"
    assert _gears(bench)[-1][1] is Gear.PARK


def _gears(bench: Bench) -> list[tuple[float, Gear]]:
    return [(heard.time, codec.decode(heard.frame).gear) for heard in bench.commands(layout.GEAR_REPORT)]


def _alive_until_park(bench: Bench) -> None:
    """From engaging to park reported: enabled, counting by one, 50 times a second, no IGNORE bit."""
    gears = _gears(bench)
    in_drive = [at for at, gear in gears if gear is Gear.DRIVE]
    parked = next(at for at, gear in gears if at > in_drive[-1] and gear is Gear.PARK)
    for kind, command_type in COUNTED.items():
        heard = bench.commands(kind)
        _counts(heard)
        commands = [(at, codec.decode(frame)) for at, frame in heard]
        assert all(isinstance(command, command_type) for _, command in commands)
        engaged = next(at for at, command in commands if command.enable)
        assert all(command.enable for at, command in commands if engaged <= at <= parked)


def _counts(heard: list[Heard]) -> None:
    counters = [codec.decode(frame).counter for _, frame in heard]
    assert all(later == (earlier + 1) & 0xFF for earlier, later in pairwise(counters)), "the counter skips"
    gap = max(later.time - earlier.time for earlier, later in pairwise(heard))
    assert gap < GAP, f"{gap:.3f} s between commands"


def _last_expiry(bench: Bench, before: float) -> float:
    """Drive time at which the last setpoint that came before a drive time was out of date."""
    said = [row.setpoint for row in bench.rows if row.setpoint and row.time_s <= before + PERIOD]
    setpoint = link.decode_setpoint(said[-1])
    return float(setpoint.expires)


def _brakes_only(bench: Bench, since: float) -> None:
    """No throttle, no steering away from straight on, and brakes that stay on: a stop and nothing else."""
    for kind, bound in ((codec.THROTTLE_COMMAND, 0.0), (codec.STEERING_COMMAND, math.radians(1.0))):
        for at, frame in bench.commands(kind):
            command = codec.decode(frame)
            value = command.wheel_angle if kind == codec.STEERING_COMMAND else command.value
            assert at <= since or abs(value) <= bound, (at, command)
    torques = [codec.decode(frame) for at, frame in bench.commands(codec.BRAKE_COMMAND) if at > since + 0.2]
    assert all(command.value > 0.0 for command in torques if command.enable)


def _stopped_within(bench: Bench, moment: float, expiry: float) -> str:
    truth = bench.car.truth(moment)
    speed = truth[0][2]
    way = truth[-1][1] - truth[0][1]
    bound = speed * (expiry + STOP_DELAY) + speed * speed / (2.0 * STOP_DECELERATION)
    assert way < bound, f"{way:.2f} m to rest from {speed:.2f} m/s, expected at most {bound:.2f} m"
    return f"{way:.2f} m to rest from {speed:.2f} m/s (at most {bound:.2f} m)"


def main() -> int:
    """Run every check on the wire that the environment names; 0 where all hold."""
    wire = WIRES[os.environ["WIRE"]]
    ip("link", "set", "lo", "up")
    wire.set_up()
    passed = [_passes(check, wire) for check in (check_frames, check_refusals)]
    with tempfile.TemporaryDirectory() as folder:
        car = LiveCar(wire, Path(folder))
        passed += [
            _passes(check, wire, car) for check in (check_nominal, check_silence, check_frozen_sender, check_link_down)
        ]
        car.close()
    return 0 if all(passed) else 1


def _passes(check: Callable[..., str], wire: Wire, *car: LiveCar) -> bool:
    name = f"{wire.gateway:<6}{check.__name__.removeprefix('check_')}"
    begun = time.monotonic()
    try:
        output = check(wire, *car)
    except Exception:
        print(f"FAILED {name}\n{traceback.format_exc()}", flush=True)
        return False
    print(f"ok     {name}: {output} [{time.monotonic() - begun:.1f} s]", flush=True)
    return True


if __name__ == "__main__":
    sys.exit(main())
