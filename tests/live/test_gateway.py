"""The gateway's process against real signals, real sockets and a serial bus: whatever dies, the car is stopped."""

from __future__ import annotations

import json
import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.live.bench import LIFETIME, Bench, Heard, LiveCar, stop
from tests.live.patience import until
from tests.setpoints import setpoint as complete
from tests.vehicle.car import CALIBRATION, FUSION, PERIOD
from vve_sumo.bus import read_log
from vve_sumo.live import signals
from vve_sumo.live.channel import ALIVE
from vve_sumo.live.gateway import (
    DBW_SILENCE_LIMIT,
    Inbox,
    dbw_is_gone,
    next_step_time,
)
from vve_sumo.live.messages import decode
from vve_sumo.live.priority import OOM_NEVER
from vve_sumo.record.reader import read_table
from vve_sumo.timing import MAX_STEP_INTERVAL, MIN_STEP_INTERVAL
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout, messages
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import Gear

Open = Callable[..., Bench]

STOP_ID = 0x321
SLOW = {"timer_gap", "setpoint_expired"}  #: what a machine with too much to do may add to any of these drives


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Open]:
    """Open a bench that is closed whatever happens, and with `speed` [m/s] let its car reach that."""
    opened: list[Bench] = []

    def open_bench(speed: float | None = None, **arguments: Any) -> Bench:
        for _ in range(5):
            opened.append(Bench(tmp_path / f"record{len(opened)}", **arguments))
            if speed is None or opened[-1].drive(speed):
                return opened[-1]
            opened[-1].close()
        return pytest.fail("this machine is too slow to drive a car")

    yield open_bench
    for each in opened:
        each.close()


def counters(heard: list[Heard]) -> list[int]:
    """The counters of what the car was commanded, unwrapped."""
    count, unwrapped = 0, []
    for before, after in pairwise(heard):
        count += (after.brake.counter - before.brake.counter) & 0xFF
        unwrapped.append(count)
    return unwrapped


def assert_stopping(commanded: list[Heard]) -> None:
    """Nothing but a stop: no throttle, and the kit enabled until park was asked for."""
    assert commanded
    assert all(heard.throttle.value == 0.0 for heard in commanded)
    for before, after in pairwise(commanded):
        if not after.brake.enable and before.brake.enable:
            assert before.gear.gear is Gear.PARK
        assert before.brake.enable or not after.brake.enable, "never enabled again"
        assert after.brake.enable is after.throttle.enable is after.steering.enable


# What is taken in.


@given(st.floats(0.0, 1e6), st.booleans(), st.booleans())
def test_steps_are_due_half_a_period_after_the_last_at_the_soonest_and_one_and_a_half_at_the_latest(last, fresh, alone):
    expected = MIN_STEP_INTERVAL if fresh else 1.0 if alone else MAX_STEP_INTERVAL
    assert next_step_time(last, fresh, alone, PERIOD) - last == pytest.approx(expected * PERIOD, abs=1e-9)


def setpoint(sequence: int, **changes: Any) -> Setpoint:
    """A setpoint of a moment."""
    plain = {"sequence": sequence, "time": 0.0, "expires": 0.1, "speed": 0.0, "yaw_rate": 0.0}
    plain |= {"x": 0.0, "y": 0.0, "heading": 0.0}
    return complete(0.0, 1.0, **(plain | changes))


def test_of_two_setpoints_the_newer_one_counts_and_the_older_ones_faults():
    inbox = Inbox()
    inbox.take_from_drive(link.encode_setpoint(setpoint(1, faults=("pose_lost",))))
    newer = link.encode_setpoint(setpoint(2))
    inbox.take_from_drive(newer)
    taken = inbox.take()
    assert (taken.setpoint.sequence, taken.datagram, taken.process_faults) == (2, newer, ("pose_lost",))
    assert inbox.take() == (None, b"", None, ())


@given(st.integers(0, 10_000), st.integers(0, 7))
def test_a_flipped_bit_is_found_and_asks_for_a_stop(where, bit):
    whole = bytearray(link.encode_setpoint(setpoint(1)))
    whole[where % len(whole)] ^= 1 << bit
    inbox = Inbox()
    inbox.take_from_drive(bytes(whole))
    taken = inbox.take()
    assert taken.setpoint is None
    assert taken.process_faults == ("setpoint_corrupt",)


def test_the_drive_has_no_say_in_acts():
    inbox = Inbox()
    for command in OperatorCommand:
        inbox.take_from_drive(link.encode_operator_command(command))
    assert inbox.take() == (None, b"", None, ())
    assert inbox.refused == len(OperatorCommand)


@given(st.lists(st.sampled_from([*OperatorCommand, None]), max_size=6))
def test_acts_come_in_their_order_and_stop_before_all_others(acts):
    inbox = Inbox()
    for command in acts:
        inbox.take_from_console(b"prose" if command is None else link.encode_operator_command(command))
    operators = any(command in (OperatorCommand.STOP, None) for command in acts)
    stops = operators or OperatorCommand.STOP_BY_PAGE in acts
    assert inbox.fresh is stops
    taken = [inbox.take().command for _ in range(len(acts) + 1)]
    stop = OperatorCommand.STOP if operators else OperatorCommand.STOP_BY_PAGE
    assert taken == ([stop] if stops else acts) + [None] * (len(acts) + 1 - (1 if stops else len(acts)))


def test_a_stop_asked_for_again_and_again_is_urgent_once():
    inbox = Inbox()
    inbox.take_from_console(link.encode_operator_command(OperatorCommand.STOP))
    assert inbox.fresh
    assert inbox.take().command is OperatorCommand.STOP
    for _ in range(50):
        inbox.take_from_console(link.encode_operator_command(OperatorCommand.STOP))
        assert not inbox.fresh
        assert inbox.take().command is OperatorCommand.STOP


@given(st.floats(0.0, 1e6), st.floats(0.0, 1e3))
def test_a_kit_is_gone_a_minute_after_its_last_word(heard: float, later: float) -> None:
    assert dbw_is_gone(heard + later, heard) is (heard + later - heard > DBW_SILENCE_LIMIT)
    assert DBW_SILENCE_LIMIT == 60.0


IDS = [layout.BRAKE_REPORT, layout.THROTTLE_REPORT, layout.STEERING_REPORT, layout.GEAR_REPORT]


@given(st.lists(st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=40))
def test_a_bus_that_babbles_is_no_word_of_the_kit(frames: list[Frame]) -> None:
    """Only what its four modules report counts, and only where that can be understood."""
    core = Gateway(FUSION, CALIBRATION, period=PERIOD)
    core.step(5.0, None, [])
    assert core.monitor.last_dbw_report == -math.inf
    core.step(5.0 + PERIOD, None, frames)
    understood = [frame for frame in frames if not isinstance(codec.decode(frame), codec.Malformed)]
    assert (core.monitor.last_dbw_report > 0.0) is any(frame.id in IDS for frame in understood)
    core.step(5.0 + 2 * PERIOD, None, [Frame(0x3FF, b"babble!!")] * 40)
    assert core.monitor.last_dbw_report <= 5.0 + PERIOD


@pytest.mark.parametrize("number", IDS)
def test_each_module_of_the_kit_is_heard(number: int) -> None:
    core = Gateway(FUSION, CALIBRATION, period=PERIOD)
    (report,) = [frame for frame in LiveCar().reports() if frame.id == number]
    core.step(7.0, None, [report])
    assert core.monitor.last_dbw_report == 7.0


# The process.


@pytest.mark.live
def test_a_drive_from_ready_to_park(bench: Open) -> None:
    b = bench(3.0)
    b.act(OperatorCommand.END)
    b.rest()
    reported = {code for feedback in b.feedbacks for code in feedback.status.reasons}
    assert "drive_over" in reported
    assert "stop_asked" not in reported, "nobody asked for it"
    assert b.car.gear is Gear.PARK
    assert b.feedbacks[-1].status.state is ArmingState.DISARMED
    gaps = [after.time - before.time for before, after in pairwise(b.heard)]
    assert sorted(gaps)[len(gaps) // 2] == pytest.approx(PERIOD, abs=0.003)
    assert set(counters(b.heard)) == set(range(1, len(b.heard))), "every step counts by one"


@pytest.mark.live
def test_the_record_holds_all_that_went_in_and_came_out(bench: Open) -> None:
    """The core, run again over the record, says the same bytes in the same order."""
    b = bench(2.0)
    b.act(OperatorCommand.STOP)
    b.rest()
    finish(b)
    rows = read_table(b.folder, "gateway").to_pylist()
    log = [frame for _time, _bus, frame in read_log(b.folder / "can.log")]
    again, at = gateway_again(b), 0
    for row in rows:
        heard = log[at : at + row["frames_received"]]
        sent = log[at + row["frames_received"] : at + row["frames_received"] + row["frames_sent"]]
        at += row["frames_received"] + row["frames_sent"]
        said = link.decode_setpoint(row["setpoint"]) if row["setpoint"] else None
        command = OperatorCommand(row["operator_command"]) if row["operator_command"] else None
        output = again.step(
            row["time_s"], said, heard, command, [code for code in row["process_faults"].split("+") if code]
        )
        assert list(output.frames) == sent, row["step"]
        assert "+".join(output.status.reasons) == row["reasons"]
    assert at == len(log)
    assert [row["step"] for row in rows] == list(range(len(rows)))
    assert {row["operator_command"] for row in rows} == {"", "engage", "go", "stop"}
    summary = json.loads((b.folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["gateway_steps"] == len(rows)


def gateway_again(b: Bench) -> Gateway:
    """The core that the bench's process runs."""
    return Gateway(FUSION, CALIBRATION, period=PERIOD, interface=DataspeedDbw1(b.car.variant))


@pytest.mark.live
@pytest.mark.parametrize(("how", "reason"), [(signal.SIGSTOP, "setpoint_expired"), (signal.SIGKILL, "drive_gone")])
def test_a_frozen_or_killed_sender_has_no_more_say_after_its_lifetime(
    bench: Open, how: signal.Signals, reason: str
) -> None:
    b = bench(4.0)
    assert any(heard.throttle.value > 0.0 for heard in b.heard[-3:])
    b.kill(b.sender, how)
    gone = b.now
    b.rest()
    assert_stopping(told_after(b, gone + LIFETIME + 2 * PERIOD))
    assert reason in reasons_of(b)


@pytest.mark.live
def test_a_killed_gateway_says_nothing_more(bench: Open) -> None:
    b = bench(3.0)
    b.kill(b.gateway, signal.SIGKILL)
    killed = b.now
    b.run(0.5)
    assert b.since(killed + PERIOD) == []


@pytest.mark.live
def test_a_gateway_that_slept_latches_it_and_makes_up_for_nothing(bench: Open) -> None:
    b = bench(4.0)
    stop(b, b.gateway, 0.2)
    woken = b.now
    b.rest()
    assert "timer_gap" in reasons_of(b)
    assert_stopping(told_after(b, woken + PERIOD))
    steps = np.diff(read_table(b.folder, "gateway")["time_s"].to_numpy())
    assert steps.max() > 0.15
    assert steps.min() >= MIN_STEP_INTERVAL * PERIOD - 1e-9
    assert set(counters(b.heard)) == set(range(1, len(b.heard)))


@pytest.mark.thorough
@pytest.mark.live
def test_signals_hammered_at_a_moving_gateway_change_nothing(bench: Open) -> None:
    b = bench(3.0)
    for _ in range(20):
        for number in signals.TERMINATING:
            b.kill(b.gateway, number)
        b.run(0.004)
    b.run(0.2)
    assert b.gateway.poll() is None
    assert b.state is ArmingState.ENGAGED or SLOW.intersection(b.reasons), b.reasons
    b.act(OperatorCommand.STOP)
    b.rest()


@pytest.mark.thorough(witnesses=1)
@pytest.mark.live
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda b: b.drive_end.send(b"prose"), "setpoint_corrupt"),
        # The row `console_killed` of the fault matrix is one such.
        pytest.param(lambda b: b.console.close(), "operator_gone", marks=pytest.mark.slow),
        # It showed itself alive once and never again: frozen, with its channel open.
        (lambda b: b.console.send(ALIVE), "operator_gone"),
    ],
)
def test_what_is_wrong_on_a_channel_stops_the_car(bench: Open, damage: Callable[[Bench], object], reason: str) -> None:
    b = bench(2.0, sender=False)
    damage(b)
    b.rest()
    assert reason in reasons_of(b)


@pytest.mark.live
def test_acts_from_the_drive_are_refused_and_counted(bench: Open) -> None:
    b = bench(sender=False)
    b.run_until(lambda: b.state is ArmingState.READY)
    for _ in range(10):
        b.drive_end.send(link.encode_operator_command(OperatorCommand.ENGAGE))
        b.run(0.05)
    assert b.state is ArmingState.READY
    b.console.close()
    b.rest()
    assert "10 acts refused" in (b.folder / "gateway.txt").read_text()
    assert not any(heard.brake.enable for heard in b.heard)


@pytest.mark.live
def test_a_gateway_that_nobody_can_engage_any_more_ends(bench: Open) -> None:
    b = bench()
    b.run_until(lambda: b.state is ArmingState.READY)
    b.console.close()
    b.rest()
    assert not any(heard.brake.enable for heard in b.heard)


@pytest.mark.thorough
@pytest.mark.live
def test_a_killed_recorder_stops_the_car(bench: Open) -> None:
    b = bench(3.0)
    b.kill(b.recorder, signal.SIGKILL)
    killed = b.now
    b.rest()
    assert_stopping(b.since(killed + 0.5))
    assert "record_lost" in reasons_of(b, recorded=False)


@pytest.mark.thorough
@pytest.mark.live
def test_a_recorder_that_hangs_stops_the_car_in_bounded_time_and_delays_no_step(bench: Open) -> None:
    b = bench(3.0)
    b.kill(b.recorder, signal.SIGSTOP)
    frozen = b.now
    b.run_until(lambda: "record_full" in b.reasons, patience=300.0)
    commanded = b.since(frozen)
    b.kill(b.recorder, signal.SIGCONT)
    b.rest()
    assert len(commanded) == pytest.approx((commanded[-1].time - commanded[0].time) / PERIOD, rel=0.1)


@pytest.mark.thorough
@pytest.mark.live
def test_a_bus_that_takes_nothing_is_found_and_tried_again(bench: Open) -> None:
    b = bench(2.0)
    frozen = b.now
    while "bus_down" not in b.reasons:
        # The adapter hangs: nobody reads what the gateway writes, nor sends what the car reports.
        for data in b.console.receive():
            b.feedbacks.append(link.decode_feedback(data))
        time.sleep(0.01)
        assert b.now < frozen + 120.0
    b.rest()
    assert "bus_down" in reasons_of(b)


@pytest.mark.live
def test_a_bus_that_is_gone_does_not_take_the_gateway_with_it(bench: Open) -> None:
    b = bench(2.0)
    b.adapter.close()

    def reported() -> bool:
        for data in b.console.receive():
            b.feedbacks.append(link.decode_feedback(data))
        return b.state is ArmingState.STOPPING and "bus_down" in b.reasons

    until(reported)
    before = time.clock_gettime(time.CLOCK_MONOTONIC), cpu_time(b.gateway.pid)
    time.sleep(1.0)
    after = time.clock_gettime(time.CLOCK_MONOTONIC), cpu_time(b.gateway.pid)
    assert b.gateway.poll() is None
    assert (after[1] - before[1]) / (after[0] - before[0]) < 0.5, "a bus that is gone is no reason to spin"


def cpu_time(pid: int) -> float:
    """Processor time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.live
def test_the_stop_button_on_the_bus_stops_the_car(bench: Open) -> None:
    b = bench(2.0, stop_can_id=STOP_ID)
    b.adapter.send([Frame(STOP_ID, b"\x01")])
    b.rest()
    assert "stop_input" in reasons_of(b)


@pytest.mark.thorough
@pytest.mark.live
def test_a_second_master_on_the_bus_stops_the_car(bench: Open) -> None:
    b = bench(2.0)
    b.adapter.send([codec.encode(codec.BrakeCommand(messages.BrakeKind.TORQUE, 0.0, True, 7, False), b.car.variant)])
    b.rest()
    assert "another_writer" in reasons_of(b)


@pytest.mark.live
def test_the_kernel_is_told_to_take_the_gateway_last(bench: Open) -> None:
    b = bench(sender=False)
    b.run_until(lambda: b.state is not None)
    given, said = Path(f"/proc/{b.gateway.pid}/oom_score_adj").read_text(), (b.folder / "gateway.txt").read_text()
    assert f"oom_score_adj {OOM_NEVER}" in said
    assert (int(given) == OOM_NEVER) is ("does not allow oom_score_adj" not in said)
    assert int(Path(f"/proc/{b.recorder.pid}/oom_score_adj").read_text()) > int(given)
    b.console.close()
    b.rest()


@pytest.mark.live
def test_a_bus_that_cannot_be_opened_is_one_line_and_the_rigs_exit_code(bench: Open) -> None:
    b = bench(sender=False, bus={"interface": "slcan", "channel": "/dev/none", "bitrate": 500_000})
    assert b.gateway.wait(30.0) == 3
    (reported,) = map(decode, b.console.receive())
    assert reported.exit_code == 3
    assert reported.text.startswith("CAN bus slcan:/dev/none cannot be opened: ")


def told_after(b: Bench, moment: float) -> list[Heard]:
    """What the car was commanded in the steps after a moment of drive time, once the drive is over.

    By the gateway's own times: when the car hears of it is also a matter of how soon this test's process is run.
    """
    finish(b)
    steps = read_table(b.folder, "gateway")["time_s"].to_numpy()
    assert len(steps) == len(b.heard), "a step is four frames on the bus"
    return b.heard[int(np.searchsorted(steps, moment)) :]


def finish(b: Bench) -> None:
    """Let the recorder finish."""
    b.spare.close()
    assert b.recorder.wait(30.0) == 0


def reasons_of(b: Bench, recorded: bool = True) -> set[str]:
    """All reasons of a drive that is over, as told and, where there is one, as recorded."""
    reported = {reason for feedback in b.feedbacks for reason in feedback.status.reasons}
    if not recorded:
        return reported
    finish(b)
    return {code for row in read_table(b.folder, "gateway")["reasons"].to_pylist() for code in row.split("+")}
