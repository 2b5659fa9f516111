"""A few seconds of each fuzz run, and that its judgement finds what is wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.fuzz import damaged, decoders, gateway, setpoints, stations
from tests.fuzz.__main__ import main
from tests.fuzz.invariant import Violation
from vve_sumo.pose import trust
from vve_sumo.stations import station_gate
from vve_sumo.values import ArmingState, Fix, Frame
from vve_sumo.vehicle.gateway import Gateway, GatewayOutput
from vve_sumo.wire.setpoints import SetpointInbox


def test_no_decoder_breaks_an_invariant():
    assert [decoders.run(seed) for seed in range(2 * len(decoders.DECODERS))] == [1000] * 2 * len(decoders.DECODERS)


def test_the_gateway_breaks_no_invariant():
    assert [gateway.run(seed) for seed in range(20)] == [600] * 20


def test_no_damaged_packet_is_trusted_farther_off_than_its_bounds():
    tally = damaged.Tally()
    assert [damaged.run(seed, tally) for seed in range(4)] == [2000] * 4
    assert tally.fixes > 7900
    assert tally.given > 80
    assert tally.trusted < 0.2 * tally.given
    assert tally.worst["position [m]"] > 0.0, "it hardly ever happens that none is too small to see"


def test_a_gate_that_trusts_what_is_damaged_is_found(monkeypatch):
    monkeypatch.setattr(trust, "_of_the_rest", lambda last, fix, profile: [])
    with pytest.raises(Violation, match=r"invariant 1: .*\n  seed \d+"):
        [damaged.run(seed, damaged.Tally()) for seed in range(4)]


def test_drives_reach_every_state_and_move_the_car(monkeypatch):
    seen, fastest = set(), 0.0
    for seed in range(20):
        drive = gateway.Drive(seed)
        for number in range(gateway.STEPS):
            drive._step(number)
            seen |= {(drive.state, drive.going)}
            fastest = max(fastest, drive.car.speed)
    assert {state for state, _ in seen} == set(ArmingState)
    assert (ArmingState.ENGAGED, True) in seen
    assert fastest > 5.0


def test_no_bad_setpoint_changes_what_is_asked_of_the_gateway():
    assert [setpoints.run(seed) for seed in range(40)] == [1000] * 40


def test_no_packet_of_an_on_board_unit_breaks_an_invariant():
    assert stations.run(0) == 1000


@pytest.mark.thorough
def test_no_packet_of_many_breaks_an_invariant():
    assert [stations.run(seed) for seed in range(1, 8)] == [1000] * 7


def test_a_gate_that_takes_any_speed_is_found(monkeypatch):
    monkeypatch.setattr(station_gate, "_max_speed", lambda kind: 1000.0)
    with pytest.raises(Violation, match=r"invariant 3: .*\n  seed \d+"):
        [stations.run(seed) for seed in range(8)]


@pytest.mark.slow
def test_no_bad_setpoint_of_a_million_changes_what_is_asked_of_the_gateway():
    assert sum(setpoints.run(seed) for seed in range(40, 1040)) == 1_000_000


class Lax(SetpointInbox):
    """An inbox with one flaw."""

    flaw = ""

    def _refusal(self, now, setpoint):
        reason = super()._refusal(now, setpoint)
        return "" if reason == self.flaw else reason

    def take(self, now, data):
        reason = super().take(now, data)
        if self.flaw == "renews" and reason:
            self._expires = now + 0.1
        return reason


@pytest.mark.parametrize(
    ("flaw", "number"), [("setpoint_replayed", 3), ("setpoint_unasked", 3), ("setpoint_late", 3), ("renews", "[24]")]
)
def test_an_inbox_with_a_flaw_is_found(monkeypatch, flaw, number):
    monkeypatch.setattr(setpoints, "SetpointInbox", Lax)
    monkeypatch.setattr(Lax, "flaw", flaw)
    with pytest.raises(Violation, match=f"{number}: "):
        [setpoints.run(seed) for seed in range(10)]


class Wrong(Gateway):
    """A gateway with one flaw."""

    flaw = ""

    def step(self, *inputs):
        output = super().step(*inputs)
        brake, throttle, steering, gear = output.frames
        going = brake.data[3] & 1
        if self.flaw == "ignores the driver" and going:
            brake = Frame(brake.id, brake.data[:3] + bytes((brake.data[3] | 4,)) + brake.data[4:])
        elif self.flaw == "stands on both pedals" and going:
            throttle = Frame(throttle.id, b"\x01" + throttle.data[1:])
        elif self.flaw == "does not count" and going:
            steering = Frame(steering.id, steering.data[:7] + b"\0")
        elif self.flaw == "shifts under way" and throttle.data[:2] != b"\0\0":
            gear = Frame(gear.id, b"\x04")
        verdict = output.status
        if self.flaw == "jumps" and going:
            verdict = replace(verdict, steering=0.1 * (brake.data[7] & 1))
        return GatewayOutput(verdict, (brake, throttle, steering, gear))


@pytest.mark.parametrize(
    ("flaw", "number"),
    [
        ("ignores the driver", 3),
        ("stands on both pedals", 7),
        ("does not count", 5),
        ("shifts under way", 11),
        ("jumps", 12),
    ],
)
def test_a_flaw_is_found_and_named_with_its_seed(monkeypatch, flaw, number):
    monkeypatch.setattr(gateway, "Gateway", Wrong)
    monkeypatch.setattr(Wrong, "flaw", flaw)
    with pytest.raises(Violation, match=rf"invariant {number}: .*\n  seed \d+, step \d+, now "):
        [gateway.run(seed) for seed in range(20)]


def test_a_fix_that_is_none_is_found():
    gate = decoders._Gate()
    fix = decoders._fix(decoders.random.Random(1), 0.0)
    gate.judge(0.0, [fix])
    for wrong in ({"latitude": 2.0}, {"altitude": float("inf")}, {"time": fix.time - 1.0}, {"heading": 4.0}):
        bad: Fix = replace(fix, time=fix.time + 1.0)
        with pytest.raises(Violation, match="3: "):
            gate.judge(0.0, [replace(bad, **wrong)])


@pytest.mark.parametrize(
    ("what", "count"), [("decoders", 1200), ("gateway", 1200), ("damaged", 4000), ("setpoints", 1200)]
)
def test_the_command_says_what_it_tried(capsys, what, count):
    assert main([what, "--count", str(count), "--seed", "7"]) == 0
    assert capsys.readouterr().out.endswith("of the seeds 7 to 8, 0 violations\n")
