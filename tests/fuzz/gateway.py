"""Random drives against the gateway, judged by what its frames say, not by what it believes.

A drive is 600 steps of a car that answers as a car does, with some amount of disorder between none and all: setpoints
that come late, twice, out of order, huge or as NaN, reports that are missing, damaged, stale or contradict each other,
acts at any moment, codes found by the caller, time that stands still, runs backwards, leaps or is NaN. Invariants, at
every step:

 1. No exception, whatever comes in.
 2. Four frames, brake, throttle, steering, gear, of 8, 8, 8 and 1 bytes; unused bits are zero; torque and percent mode.
 3. The IGNORE bit, which takes the driver's override away, is never set.
 4. The three enable bits agree; they are set in ENGAGED, STOPPING and STOPPED alone, and in shadow mode never.
 5. The watchdog counters of all three count by one.
 6. CLEAR is sent in the step that engages, and in no other.
 7. Torque is at most the car's limit; no throttle unless ENGAGED after a GO that counted; never throttle and brake.
 8. Every number of the verdict is finite; the steering stays within the car's limit; acceleration within -9 to 2 m/s2.
 9. ENGAGED begins with the act of engaging only, from DISARMED or READY. STOPPING leads to STOPPED or FAULT, STOPPED to
    DISARMED in park or FAULT, FAULT to DISARMED by the act alone.
10. ENGAGED lasts no step without a setpoint that is sound and not expired, and none in which the caller found a fault,
    a new setpoint brings one, or the gateway was not run in time.
11. PARK is asked for only in STOPPED, DRIVE only in ENGAGED before GO, and both only while the last wheel speeds, not
    older than 100 ms, say of every wheel that it stands.
12. While ENGAGED the steering moves at most at the car's rate and with the comfort lateral jerk at the reported speed,
    and the acceleration with the comfort jerk, or the emergency's where the setpoint asks for one, by the time that has
    passed. On the fallback path it falls at most with the emergency's jerk; the steering holds or moves at its rate.
13. A driver who takes over, and is seen on the pedal, has the car in that step: FAULT, nothing enabled. An override
    that nothing confirms leads to rest, with the throttle closed.
14. `done` is never said of a car that is commanded.
"""

from __future__ import annotations

import math
import random
import struct
from typing import Final

from tests import vehicles
from tests.fuzz.invariant import Violation, hold
from vve_sumo.values import ArmingState, FallbackPath, Frame, Setpoint
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.gateway import Gateway

STEPS: Final = 600  # of a drive
PERIOD: Final = 0.02  # [s]
VEHICLE, CALIBRATION = vehicles.FUSION.vehicle, vehicles.FUSION.calibration
STATE: Final = ArmingState
DISORDER: Final = (0.0, 0.0, 0.0005, 0.002, 0.01, 0.05, 0.3, 1.0)  # how likely each input is disturbed in a step
ODD: Final = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -1.0, 1e-300, 1e9, -1e9, 1.7e308, -1.7e308)
ACTS: Final = tuple(OperatorCommand)
REPORT_IDS: Final = (
    layout.BRAKE_REPORT,
    layout.THROTTLE_REPORT,
    layout.STEERING_REPORT,
    layout.GEAR_REPORT,
    layout.WHEEL_SPEEDS,
    layout.YAW_RATE,
)
LENGTHS: Final = {layout.GEAR_REPORT: 2, layout.YAW_RATE: 4}
NUMBERS: Final = ("steering", "acceleration", "time", "expires", "x", "y", "heading", "speed", "yaw_rate", "grade")
PEDALS: Final = struct.Struct("<HHHBB")
STEERING: Final = struct.Struct("<hHhbB")
FOUR: Final = struct.Struct("<hhhh")
TWO: Final = struct.Struct("<hh")
PARK, DRIVE = 1, 4
NEVER: Final = -math.inf

#: Where a step may lead; ENGAGED is looked at apart.
AFTER: Final = {
    STATE.DISARMED: {STATE.DISARMED, STATE.READY, STATE.FAULT, STATE.ENGAGED},
    STATE.READY: {STATE.DISARMED, STATE.READY, STATE.FAULT, STATE.ENGAGED},
    STATE.ENGAGED: {STATE.ENGAGED, STATE.STOPPING, STATE.STOPPED, STATE.FAULT},
    STATE.STOPPING: {STATE.STOPPING, STATE.STOPPED, STATE.FAULT},
    STATE.STOPPED: {STATE.STOPPED, STATE.DISARMED, STATE.FAULT},
    STATE.FAULT: {STATE.FAULT, STATE.DISARMED},
}


class _Car:
    """A car that answers to the frames, roughly, and its reports."""

    def __init__(self, chance: random.Random) -> None:
        self.speed = 0.0
        self.angle = 0  # of the steering wheel, a tenth of a degree
        self.gear = PARK
        self.enabled = False
        self.driver = 0  # flag bits of the pedals
        self.override = False
        self.faults = 0
        self._asked = 0
        self._shift = 0
        self._weak = chance.choice((1.0, 1.0, 1.0, 0.5, 0.0))
        self._shift_steps = chance.choice((2, 10, 40, 200))
        self._confirms = chance.random() < 0.95

    def hear(self, frames: tuple[Frame, ...], elapsed: float) -> None:
        brake, throttle, steering, gear = (frame.data for frame in frames)
        if brake[3] & 2:
            self.override = False
        self.enabled = bool(brake[3] & 1) and not self.override and self._confirms
        push = 0.0
        if self.enabled:
            push = throttle[0] + 256 * throttle[1]
            push = push / 65535.0 * 3.8 - (brake[0] + 256 * brake[1]) * self._weak / 550.0
            wish = int.from_bytes(steering[:2], "little", signed=True)
            step = round(5000.0 * elapsed)
            self.angle += min(max(wish - self.angle, -step), step)
        if self.gear == DRIVE:
            push += 0.3
        elif self.gear == PARK:
            push -= 9.0
        self.speed = max(self.speed + (push - 0.1) * elapsed, 0.0)
        asked = gear[0] & 7
        self._shift = self._shift + 1 if asked == self._asked else 0
        self._asked = asked
        if asked and self._shift >= self._shift_steps:
            self.gear = asked

    @property
    def yaw_rate(self) -> float:
        return self.speed * math.tan(self.angle * 0.1 * math.pi / 180.0 / VEHICLE.steering_ratio) / VEHICLE.wheelbase

    def reports(self, noise: int) -> list[Frame]:
        pedal = self.enabled | self.override << 1 | self.driver << 2
        wheel = min(round(self.speed / VEHICLE.wheel_radius * 100.0) + (noise & 1 if self.speed > 0.1 else 0), 32000)
        yaw = min(max(round(self.yaw_rate / 2e-4) + (noise >> 1 & 1), -32000), 32000)
        return [
            Frame(layout.BRAKE_REPORT, PEDALS.pack(0, 0, 0, 0, pedal | self.faults)),
            Frame(layout.THROTTLE_REPORT, PEDALS.pack(0, 0, 0, 0, self.enabled)),
            Frame(layout.STEERING_REPORT, STEERING.pack(self.angle, self.angle & 0x7FFF, 0, 0, self.enabled)),
            Frame(layout.GEAR_REPORT, bytes((self.gear, 0))),
            Frame(layout.WHEEL_SPEEDS, FOUR.pack(wheel, wheel, wheel, wheel)),
            Frame(layout.YAW_RATE, TWO.pack(0, yaw)),
        ]


class Drive:
    """One drive of one seed."""

    def __init__(self, seed: int) -> None:
        chance = random.Random(f"gateway {seed}")
        self.chance = chance
        self.shadow = chance.random() < 0.05
        self.variant = codec.Variant.DBW1_2024 if chance.random() < 0.9 else codec.Variant.DBW1_2018
        self.old = self.variant is codec.Variant.DBW1_2018
        interface = DataspeedDbw1(self.variant)
        self.gateway = Gateway(
            VEHICLE, vehicles.FUSION.calibration, period=PERIOD, interface=interface, shadow=self.shadow
        )
        self.angle_limit = min(VEHICLE.steering_limit, layout.WHEEL_ANGLE_LIMIT[self.variant] / VEHICLE.steering_ratio)
        self.torque_limit = min(3250.0, layout.TORQUE_LIMIT[self.variant])
        self.disorder = {
            what: chance.choice(DISORDER) for what in ("setpoint", "report", "command", "found", "time", "car")
        }
        if chance.random() < 0.5:  # most kinds of disorder hide what another would show
            keep = chance.choice(list(self.disorder))
            self.disorder = {what: rate if what == keep else 0.0 for what, rate in self.disorder.items()}
        self.uneven = chance.random() < 0.3
        self.car = _Car(chance)
        self.now, self.last_now = 0.0, math.nan
        self.sequence = 0
        self.x = self.y = self.heading = 0.0
        self.wish, self.steer = 1.0, 0.0
        self.emergency = False
        # What has been seen, for the invariants.
        self.state, self.counter = STATE.DISARMED, 255
        self.going = False
        self.good_until = self.emergency_until = NEVER  # of any sound setpoint, and of those that are emergencies
        self.wheels_at, self.wheels_stand = NEVER, False
        self.overridden = self.was_overridden = self.on_brake = False
        self.in_park = False
        self.steering = self.acceleration = 0.0
        self.last_inputs: tuple[object, ...] = ()

    def run(self) -> None:
        for number in range(STEPS):
            self._step(number)

    # Inputs.

    def _hit(self, what: str) -> bool:
        rate = self.disorder[what]
        return rate > 0.0 and self.chance.random() < rate

    def _tick(self) -> None:
        chance = self.chance
        gap = PERIOD
        if self.uneven:
            gap = chance.uniform(0.005, 0.0399)
        if self._hit("time"):
            gap = chance.choice(
                (0.0, -0.02, math.nan, math.inf, chance.uniform(0.005, 0.3), chance.uniform(0.03, 0.05))
            )
        self.now += gap
        if not math.isfinite(self.now):
            self.now, self.after = (gap, self.last_now + PERIOD)
        else:
            self.after = self.now
        self.elapsed = gap if 0.0 < gap < 1.0 else 0.0

    def _setpoint(self) -> Setpoint | None:
        chance, car = self.chance, self.car
        self.sequence += 1
        if self.sequence % 40 == 0:
            self.wish = chance.choice((1.5, 2.0, 0.5, -1.0, -3.0, 5.0, -9.0))
            self.steer = chance.choice((0.0, 0.0, 0.02, -0.05, 0.3, -0.6))
            self.emergency = chance.random() < 0.1
        wish = self.wish if car.speed < 12.0 else -1.0
        fields: dict[str, object] = {
            "steering": self.steer,
            "acceleration": wish,
            "emergency": self.emergency,
            "note": "",
            "sequence": self.sequence,
            "time": self.now,
            "expires": self.now + 0.1,
            "x": self.x,
            "y": self.y,
            "heading": self.heading,
            "speed": car.speed,
            "yaw_rate": car.yaw_rate,
            "grade": 0.0,
            "faults": (),
            "fallback_path": None if self.sequence & 1 else FallbackPath(1.0, (0.01, 0.02, 0.0)),
        }
        if self._hit("setpoint"):
            kind = chance.randrange(8)
            if kind == 0:
                return None
            if kind == 7:
                # Finite, and its difference from the next one is not.
                fields[chance.choice(("x", "y", "heading", "speed", "yaw_rate"))] = chance.choice((1.7e308, -1.7e308))
            if kind == 1:
                fields["time"] = self.now - chance.uniform(0.0, 0.3)
                fields["expires"] = fields["time"] + chance.uniform(0.0, 0.12)  # type: ignore[operator]
            elif kind == 2:
                fields["sequence"] = chance.choice((-1, 0, self.sequence - 3, self.sequence + 1000, 1 << 70))
            elif kind == 3:
                fields["faults"] = (chance.choice(("pose_stale", "outside_geofence", "no_such_code")),)
            elif kind == 4:
                fields["fallback_path"] = FallbackPath(
                    chance.choice((1.0, 0.0, math.nan, 1e-300)),
                    tuple(chance.choices(ODD, k=chance.choice((0, 1, 64, 65)))),
                )
            elif kind == 5:
                fields["acceleration"] = chance.uniform(-20.0, 20.0)
                fields["steering"] = chance.uniform(-2.0, 2.0)
                fields["emergency"] = chance.random() < 0.5
            elif kind == 6:
                for name in chance.sample(NUMBERS, chance.choice((1, 1, 2, 10))):
                    fields[name] = chance.choice(ODD)
        return Setpoint(**fields)  # type: ignore[arg-type]

    def _reports(self) -> list[Frame]:
        chance, car = self.chance, self.car
        if self._hit("car"):
            kind = chance.randrange(6)
            if kind == 0:
                car.driver ^= 1
            elif kind == 1:
                car.override = True
                car.driver |= chance.randrange(2)
            elif kind == 2:
                car.faults = chance.choice((0, 0, 8, 16, 32, 64, 128))
            elif kind == 3:
                car.gear = chance.randrange(8)
            elif kind == 4:
                car.speed = chance.uniform(0.0, 15.0)
            else:
                car.angle = chance.randint(-4700, 4700)
        frames = car.reports(chance.getrandbits(2))
        if self._hit("report"):
            kind = chance.randrange(6)
            place = chance.randrange(len(frames))
            if kind == 0:
                del frames[place]
            elif kind == 1:
                frames = []
            elif kind == 2:
                identifier = frames[place].id
                frames[place] = Frame(identifier, chance.randbytes(LENGTHS.get(identifier, 8)))
            elif kind == 3:
                frames.append(Frame(chance.choice(REPORT_IDS), chance.randbytes(chance.randrange(9))))
            elif kind == 4:
                data = bytearray(frames[place].data)
                data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
                frames[place] = Frame(frames[place].id, bytes(data))
            else:
                frames.append(Frame(chance.randrange(0x60, 0x76), chance.randbytes(8)))
        return frames

    def _act(self) -> OperatorCommand | None:
        chance = self.chance
        if self._hit("command"):
            return chance.choice(ACTS)
        lot = chance.random()
        if lot > 0.1:
            return None
        match self.state:
            case STATE.READY:
                return OperatorCommand.ENGAGE
            case STATE.ENGAGED if not self.going:
                return OperatorCommand.GO
            case STATE.ENGAGED if lot < 0.0003:
                return OperatorCommand.STOP
            case STATE.FAULT if lot < 0.02:
                return OperatorCommand.DISARM
            case _:
                return None

    # A step, and what must hold of it.

    def _step(self, number: int) -> None:
        self._tick()
        setpoint, reports, command = self._setpoint(), self._reports(), self._act()
        found = (self.chance.choice(("bus_down", "drive_gone", "no_such_code")),) if self._hit("found") else ()
        self.last_inputs = (number, self.now, setpoint, reports, command, found)
        self._note(setpoint, reports)
        try:
            verdict, frames = self.gateway.step(self.now, setpoint, reports, command, found)
        except Exception as error:
            raise Violation(f"1: {type(error).__name__}: {error}") from error
        self._judge_frames(verdict, frames, command)
        self._judge_state(verdict, setpoint, command, found)
        self._judge_rates(verdict)
        self.state, self.steering, self.acceleration = verdict.state, verdict.steering, verdict.acceleration
        self.last_now = self.now
        self.now = self.after
        self.car.hear(frames, self.elapsed)
        self.x += self.car.speed * self.elapsed * math.cos(self.heading)
        self.y += self.car.speed * self.elapsed * math.sin(self.heading)
        self.heading += self.car.yaw_rate * self.elapsed

    def _note(self, setpoint: Setpoint | None, reports: list[Frame]) -> None:
        """Read what came in, apart from the gateway."""
        s, now = setpoint, self.now
        finite = s is not None and all(math.isfinite(getattr(s, name)) for name in NUMBERS)
        if s is not None and finite and s.sequence >= 0 and s.expires - s.time <= 0.1001 and s.time <= now + 1e-3:
            self.good_until = max(self.good_until, s.expires)
            if s.emergency:
                self.emergency_until = max(self.emergency_until, s.expires)
        self.was_overridden = override = self.overridden
        for frame in reports:
            data = frame.data
            if frame.id == layout.WHEEL_SPEEDS and len(data) == 8:
                wheels = FOUR.unpack(data)
                self.wheels_at = now
                self.wheels_stand = all(abs(w) * 0.01 * VEHICLE.wheel_radius < 0.05 for w in wheels)
            elif frame.id == layout.BRAKE_REPORT and len(data) == 8 and (data[6] & 3 != 3 or self.old):
                # Kind 3 of the newer kit is none: such a report says nothing.
                override = bool(data[7] & 2)
                self.on_brake = bool(data[7] & 4)
            elif frame.id == layout.GEAR_REPORT and len(data) == 2 and data[0] & 7 <= 5 and data[0] >> 4 & 7 <= 5:
                self.in_park = data[0] & 7 == PARK
        self.overridden = override

    def _judge_frames(self, verdict: object, frames: tuple[Frame, ...], command: OperatorCommand | None) -> None:
        brake, throttle, steering, gear = (frame.data for frame in frames)
        ids = [frame.id for frame in frames]
        hold(2, ids == [0x60, 0x62, 0x64, 0x66] and [*map(len, (brake, throttle, steering, gear))] == [8, 8, 8, 1])
        hold(2, brake[4:7] == throttle[4:7] == steering[4:7] == b"\0\0\0" and brake[2] >> 4 == 3, "or its mode")
        hold(2, throttle[2] >> 4 == 2 and not (brake[2] | throttle[2]) & 15)
        flags = brake[3]
        hold(3, not (brake[3] | throttle[3] | steering[2]) & 4)
        hold(2, flags == throttle[3] == steering[2] and not flags & 0xF8)
        state = verdict.state  # type: ignore[attr-defined]
        hold(4, (flags & 1 == 1) == (state in COMMANDING and not self.shadow))
        self.counter = (self.counter + 1) & 255
        hold(5, brake[7] == throttle[7] == steering[7] == self.counter)
        engaging = state is STATE.ENGAGED and self.state is not STATE.ENGAGED
        hold(6, (flags & 2 == 2) == (gear[0] & 128 == 128) == (engaging and not self.shadow))
        if engaging:
            hold(9, command is OperatorCommand.ENGAGE and self.state in (STATE.DISARMED, STATE.READY))
            self.going = False
        elif state is not STATE.ENGAGED:
            self.going = False
        elif command is OperatorCommand.GO and "go_too_early" not in verdict.reasons:  # type: ignore[attr-defined]
            self.going = True
        torque, percent = brake[0] + 256 * brake[1], throttle[0] + 256 * throttle[1]
        hold(7, torque <= self.torque_limit and not (torque and percent) and (self.going or not percent))
        self._judge_gear(gear[0] & 7, state)

    def _judge_gear(self, wish: int, state: ArmingState) -> None:
        if wish:
            hold(11, not self.shadow and self.wheels_stand and not self.now - self.wheels_at > 0.1001)
            hold(11, wish == (PARK if state is STATE.STOPPED else DRIVE) and state in (STATE.STOPPED, STATE.ENGAGED))
            hold(11, wish == PARK or not self.going)

    def _judge_state(
        self, verdict: object, setpoint: Setpoint | None, command: OperatorCommand | None, found: tuple[str, ...]
    ) -> None:
        before, after = self.state, verdict.state  # type: ignore[attr-defined]
        hold(9, after in AFTER[before], f"{before} -> {after}")
        if before is STATE.FAULT and after is STATE.DISARMED:
            hold(9, command is OperatorCommand.DISARM)
        if before is STATE.STOPPED and after is STATE.DISARMED:
            hold(9, self.in_park and self.wheels_stand, "let go")
        if after is STATE.ENGAGED:
            hold(10, not found and self.good_until >= self.now - 2e-6)
            hold(10, setpoint is None or not setpoint.faults)
            gap = self.now - self.last_now
            hold(10, 0.0 < gap <= 2.0 * PERIOD + 2e-6 or not math.isfinite(self.last_now), "the gap")
        if before in COMMANDING and self.overridden and not self.was_overridden and not self.shadow:
            resting = after in {STATE.STOPPING, STATE.STOPPED} and verdict.throttle == 0.0  # type: ignore[attr-defined]
            hold(13, after is STATE.FAULT or (not self.on_brake and resting))
        hold(14, not (self.gateway.done and after in COMMANDING))

    def _judge_rates(self, verdict: object) -> None:
        before, after = self.state, verdict.state  # type: ignore[attr-defined]
        steering, acceleration = verdict.steering, verdict.acceleration  # type: ignore[attr-defined]
        total = steering + acceleration + verdict.brake_torque + verdict.throttle  # type: ignore[attr-defined]
        hold(8, math.isfinite(total) and abs(steering) <= self.angle_limit + 1e-9 and -9.0 <= acceleration <= 2.0)
        gap = self.now - self.last_now
        elapsed = min(gap, 2.0 * PERIOD) + 1e-9 if gap > 0.0 else 1e-9
        moved, rate = abs(steering - self.steering), VEHICLE.steering_rate_limit
        rise, fall = acceleration - self.acceleration, min(self.acceleration, 0.0) - acceleration
        if before is after is STATE.ENGAGED and self.going:
            speed = abs(self.gateway.monitor.wheel_speed)
            rate = min(rate, 5.0 * VEHICLE.wheelbase / max(speed * speed, 1e-9))
            hold(12, moved <= rate * elapsed + 1e-9, f"steering moved by {moved:g} in {elapsed:g} s")
            jerk = 30.0 if self.emergency_until >= self.now - 2e-6 else 10.0
            hold(12, rise <= (5.0 if self.acceleration >= 0.0 else 10.0) * elapsed + 1e-9, f"rise {rise:g}")
            hold(12, fall <= jerk * elapsed + 1e-9, f"fall {fall:g}")
        elif before in COMMANDING and after in (STATE.STOPPING, STATE.STOPPED):
            hold(12, acceleration <= max(min(self.acceleration, 0.0), 0.0), "the stop releases")
            hold(12, fall <= 30.0 * elapsed + 1e-9, f"fall {fall:g}")
            hold(12, moved <= rate * elapsed + 1e-9, f"steering moved by {moved:g} in {elapsed:g} s")


def run(seed: int) -> int:
    """Drive once; how many steps that were. Raises Violation, which says where."""
    drive = Drive(seed)
    try:
        drive.run()
    except Violation as violation:
        number, now, setpoint, reports, command, found = drive.last_inputs
        raise Violation(
            f"invariant {violation}\n  seed {seed}, step {number}, now {now!r}, {drive.state} before\n"
            f"  setpoint {setpoint}\n"
            f"  reports {[(hex(frame.id), frame.data.hex()) for frame in reports]}\n  act {command}, found {found}"  # type: ignore[attr-defined]
        ) from violation
    return STEPS
