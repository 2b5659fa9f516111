"""The screen: its words, and what a real terminal and a real pipe get of it."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import time
from collections.abc import Iterator
from typing import TextIO

import pytest

from vve_sumo.live.screen import Screen
from vve_sumo.live.wording import (
    ALARMS,
    BRAIN_GONE,
    BRAIN_SILENT,
    BRAKES,
    CONTROL,
    GONE,
    HELD,
    NEEDED,
    NEVER,
    PARKED,
    ROLLS,
    SILENT,
    GatewayProcessState,
    advice,
    answer,
    bell_count,
    phase,
    picture,
    transition,
)
from vve_sumo.live.wording import (
    DRIVING as ANY_KEY_STOPS,
)
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import REASONS

DRIVING = {
    "tick": 700,
    "time_s": 14.0,
    "state": "engaged",
    "reasons": [],
    "faults": [],
    "pose_reasons": [],
    "speed_mps": 8.25,
    "to_go_m": 118.4,
    "range_m": 31.27,
    "note": "follow",
    "latency": {"p50": 0.00123, "p99": 0.0042, "missed": 3.0},
    "missed": 3,
    "clock": {"age": "declared", "drift_ppm": 4.21},
    "outcome": None,
}


def test_what_the_engineer_reads():
    text = "\n".join(picture(DRIVING))
    for words in ("DRIVING", "29.7 km/h", "118 m to go", "ahead 31.3 m", "follow", "latency 1.2, p99 4.2 ms"):
        assert words in text
    for words in ("missed 3", "recording", "clock declared, drift 4.2 ppm", "fix good"):
        assert words in text


def test_before_anything_is_known_there_are_dashes_and_no_errors():
    text = "\n".join(picture({}))
    assert "STARTING" in text
    assert "no pose yet" in text
    assert "nan" not in text.lower()


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), "much"])
def test_what_is_no_number_is_a_dash(value):
    status = DRIVING | {"to_go_m": value, "range_m": value, "latency": {"p50": None, "p99": None}}
    assert "- m to go" in picture(status)[0]
    assert "ahead - m" in picture(status)[0]


def test_why_not_ready_stands_in_plain_words_once():
    status = DRIVING | {
        "state": "disarmed",
        "reasons": ["not_standing", "latency_budget"],
        "faults": ["latency_budget"],
    }
    lines = picture(status)
    assert lines[2:] == [
        "  - the car is not known to stand",
        "  - too many ticks within a second took longer than the rig's budget, or than a period",
    ]


def test_many_reasons_are_cut_short():
    lines = picture(DRIVING | {"reasons": [f"code_{n}" for n in range(20)]})
    assert lines[-1] == "  - and 12 more"


def test_a_refused_fix_a_broken_record_and_a_silent_drive_are_seen():
    lines = picture(DRIVING | {"pose_reasons": ["not_rtk_fixed"], "faults": ["record_full"]}, silent=1.25)
    assert "FIX REFUSED" in lines[1]
    assert any(line.startswith("  - fix: the position is not RTK with fixed ambiguities") for line in lines)
    assert "RECORD BROKEN" in lines[1]
    assert "nothing for 1.2 s" in lines[2]


@pytest.mark.parametrize("state", ArmingState)
def test_every_state_has_words(state):
    assert phase({"state": state.value})
    assert phase({"state": state.value}).upper() in transition({"state": state.value})


def test_engaging_is_told_apart_from_waiting_and_driving():
    phases = [phase({"state": "engaged", "reasons": [code]}) for code in ("engaging", "shifting", "waiting_for_go")]
    phases.append(phase({"state": "engaged", "reasons": []}))
    assert len(set(phases)) == 4
    assert {"engaging", "shifting", "waiting_for_go"} <= REASONS.keys()


def test_the_driver_who_has_control_is_no_fault():
    assert phase({"state": "fault", "reasons": ["driver_override"]}) == CONTROL
    assert phase({"state": "fault", "reasons": ["dbw_watchdog"]}) == "fault: press r"


def stopping(*reasons: str, **changes):
    return DRIVING | {"state": "stopping", "reasons": list(reasons)} | changes


def test_a_gateway_that_says_nothing_or_is_gone_is_an_alarm_whatever_it_said_last():
    for said in (DRIVING, stopping("stop_asked"), DRIVING | {"state": "stopped"}, DRIVING | {"state": "ready"}):
        silent, gone = (
            phase(said | {"gateway": guard.value}) for guard in (GatewayProcessState.SILENT, GatewayProcessState.GONE)
        )
        assert (silent, gone) == ("gateway silent: brake", "gateway gone: brake")
    assert {SILENT, GONE, BRAKES, ROLLS, BRAIN_SILENT, BRAIN_GONE} == ALARMS
    assert "any key" not in "\n".join(picture(DRIVING | {"gateway": "silent"})).lower()
    assert "watchdog" in advice(DRIVING | {"gateway": "silent"})


def test_brakes_that_do_not_answer_are_an_alarm_until_rest_or_the_driver():
    assert phase(stopping("brake_not_following")) == phase(DRIVING | {"reasons": ["brake_not_following"]}) == BRAKES
    assert "BRAKES DO NOT ANSWER: BRAKE" in picture(stopping("brake_not_following"))[0]
    assert phase(DRIVING | {"state": "stopped", "reasons": ["brake_not_following"]}) not in ALARMS
    rolls = ["brake_not_following", "driver_needed"]
    assert phase(DRIVING | {"state": "stopped", "reasons": rolls}) == BRAKES
    assert phase(DRIVING | {"state": "fault", "reasons": ["driver_override", "brake_not_following"]}) == CONTROL


def test_a_car_that_its_driver_took_over_and_nobody_brakes_is_an_alarm():
    taken = DRIVING | {"state": "fault", "reasons": ["driver_override", "driver_needed"]}
    assert phase(taken) == ROLLS
    assert "BRAKE" in picture(taken)[0]
    assert "shift to P" in advice(taken)
    assert phase(taken | {"gateway": "ended"}) not in ALARMS


def test_at_rest_and_in_a_fault_it_says_what_to_do():
    rest = DRIVING | {"state": "stopped", "reasons": ["stop_asked"]}
    assert phase(rest) == "at rest: brake, shift to P"
    assert "P is reported" in advice(rest)
    needed = phase(rest | {"reasons": ["stop_asked", "driver_needed"]})
    assert needed == NEEDED == "brake, shift to P: the gateway lets go when you do"
    assert phase(stopping("stop_asked", "driver_needed")) == NEEDED, "wheels that are locked say nothing of the car"
    assert bell_count(stopping("driver_needed")) == 3
    assert phase(DRIVING | {"reasons": ["driver_needed"]}) == NEEDED, "also while it is engaged"
    assert "60 s" in advice(stopping("bus_down"))
    assert "60 s" in advice(rest | {"reasons": ["gear_report_stale"]})
    assert "brake" in advice(stopping())


def test_a_drive_that_is_over_is_parked_and_nobody_is_blamed_for_its_end():
    parked = DRIVING | {"state": "disarmed", "reasons": ["drive_over"], "engaged": True, "gear": "park"}
    assert phase(parked) == PARKED == "parked, drive over"
    assert transition(parked).endswith("PARKED, DRIVE OVER")
    assert transition(stopping("drive_over")).endswith("STOPPING: the drive is over")
    assert phase(parked | {"gear": "drive"}) != PARKED
    assert phase(DRIVING | {"state": "disarmed", "reasons": [], "engaged": False, "gear": "park"}) == "not ready"
    assert phase(DRIVING | {"state": "disarmed", "engaged": False, "gateway": "ended"}) == NEVER


@pytest.mark.parametrize("state", ArmingState)
def test_shadow_mode_never_promises_that_a_key_stops_the_car(state):
    status = DRIVING | {"state": state.value, "reasons": ["shadow"], "gateway": "responding"}
    text = "\n".join(picture(status)).lower()
    assert "any key stops" not in text
    assert "held" not in text
    assert phase(status | {"reasons": ["shadow", "waiting_for_go"]}) != "engaged and held: g goes, any other key stops"
    if state is ArmingState.ENGAGED:
        assert "the driver drives" in text
        assert "no key stops the car" in text


def test_a_car_that_waits_for_the_drivers_foot_is_not_said_to_drive():
    waits = DRIVING | {"reasons": ["driver_on_brake"], "went": False}
    assert phase(waits) == HELD
    assert phase(waits | {"went": True}) == phase(DRIVING | {"went": False}) == ANY_KEY_STOPS


def test_what_was_missing_a_moment_ago_does_not_stand_beside_ready():
    for state, words in (("ready", "READY: E ENGAGES"), ("engaged", "DRIVING: ANY KEY STOPS")):
        assert transition(DRIVING | {"state": state, "faults": ["road_not_measured"]}).endswith(words)


def test_numbers_stand_with_their_reasons():
    status = DRIVING | {"state": "disarmed", "faults": ["start_position"], "details": {"start_position": "3.2 m left"}}
    assert picture(status)[-1] == "  - the car does not stand at its path's start: 3.2 m left"


def test_a_key_that_comes_too_early_is_answered_with_what_is_waited_for():
    missing = {"state": "disarmed", "reasons": ["no_setpoint"]}
    assert answer("e", missing) == "  e does nothing yet, it waits for this: no setpoint that is still good"
    assert answer("g", DRIVING | {"state": "ready"}) == "  g does nothing yet: e engages first"
    assert answer("g", DRIVING | {"reasons": ["shifting"]}) == (
        "  g came too early and stops the drive: engaging: the car shifts to drive"
    )
    assert "r" in answer("e", {"state": "fault", "reasons": ["timer_gap"]})


def test_what_a_silent_drive_said_last_is_not_shown_for_what_is():
    shown = picture(DRIVING | {"wheel_speed_mps": 2.0}, silent=0.6)
    assert shown[0].startswith("DRIVING: ANY KEY STOPS  7.2 km/h  - m to go  ahead - m")
    assert "loads the virtual road" in "\n".join(picture({}, silent=3.0))


def test_bells():
    assert bell_count(DRIVING | {"gateway": "silent"}) == 3
    assert [bell_count({"state": state}) for state in ("engaged", "stopping", "fault")] == [1, 2, 3]


def test_a_pipe_gets_a_line_for_every_transition_and_nothing_else():
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream:
        screen = Screen(stream)
        for state in ("disarmed", "disarmed", "ready", "engaged", "engaged", "stopping"):
            screen.show(DRIVING | {"state": state, "reasons": ["stop_asked"] if state == "stopping" else []})
        screen.close()
    with os.fdopen(reading) as stream:
        lines = stream.read().splitlines()
    assert [line.split("s  ")[1].split(":")[0] for line in lines] == ["NOT READY", "READY", "DRIVING", "STOPPING"]
    assert lines[-1].endswith(": the operator asked to stop")
    assert all("\x1b" not in line and "\a" not in line for line in lines)


def _shown(screen: Screen, reader: int, status: dict, lasting: float) -> str:
    text, end = b"", time.monotonic() + lasting
    while (now := time.monotonic()) < end:
        screen.show(status | {"tick": now})
        if select.select([reader], [], [], 0.02)[0]:
            text += os.read(reader, 65536)
    return text.decode()


@contextlib.contextmanager
def _on_a_terminal() -> Iterator[tuple[Screen, TextIO, int]]:
    """A screen, the stream that it writes to, and the descriptor at which the terminal's other end is read."""
    reader, writer = pty.openpty()
    with os.fdopen(writer, "w") as stream:
        screen = Screen(stream)
        yield screen, stream, reader
        screen.close()
    os.close(reader)


class Terminal:
    """As much of a terminal as the screen uses: carriage return, line feed, cursor up, erase below."""

    def __init__(self) -> None:
        self.lines, self.row, self.column = [""], 0, 0

    def take(self, text: str) -> None:
        for piece in re.findall(r"\x1b\[\d*[A-Z]|\r|\n|\a|[^\x1b\r\n\a]+", text):
            if piece == "\r":
                self.column = 0
            elif piece == "\n":
                self.row += 1
                self.lines += [""] * (self.row + 1 - len(self.lines))
            elif piece.endswith("A") and piece.startswith("\x1b"):
                self.row -= int(piece[2:-1])
            elif piece == "\x1b[J":
                del self.lines[self.row + 1 :]
                self.lines[self.row] = self.lines[self.row][: self.column]
            elif piece != "\a":
                line = self.lines[self.row]
                self.lines[self.row] = line[: self.column] + piece + line[self.column + len(piece) :]
                self.column += len(piece)


@pytest.mark.thorough
def test_a_terminal_shows_one_picture_below_the_transitions_and_rings():
    reader, writer = pty.openpty()
    with os.fdopen(writer, "w") as stream:
        screen = Screen(stream)
        terminal = Terminal()
        first = _shown(screen, reader, DRIVING | {"state": "disarmed", "reasons": ["not_standing"]}, 0.5)
        second = _shown(screen, reader, DRIVING | {"state": "stopping"}, 1.0)
        screen.close()
        terminal.take(first + second)
        assert first.count("\a") == 1
        assert second.count("\a") == 2
        assert first.count("NOT READY") <= 1 + 6  # the transition, and ten pictures a second at most
        shown = [line for line in terminal.lines if line]
        assert len(shown) == 5
        assert shown[0].endswith("NOT READY: the car is not known to stand")
        assert shown[1].endswith("STOPPING")
        assert shown[2].startswith("STOPPING")
        assert shown[3].startswith("  > wait")
        assert "latency" in shown[4]
    os.close(reader)


@pytest.mark.thorough
@pytest.mark.parametrize("status", [DRIVING | {"gateway": "silent"}, stopping("brake_not_following")])
def test_an_alarm_rings_at_every_picture_until_it_is_over(status):
    with _on_a_terminal() as (screen, _stream, reader):
        text = _shown(screen, reader, status, 1.0)
        assert text.count("\a") == text.count("\x1b[J") >= 8
        over = _shown(screen, reader, DRIVING | {"state": "stopped"}, 1.0)
        assert over.count("\a") == 1


@pytest.mark.thorough
def test_a_terminal_that_nobody_reads_does_not_hold_the_drive_up():
    with _on_a_terminal() as (screen, stream, reader):
        assert os.get_blocking(stream.fileno())  # the shell's own description stays as it was
        longest, states = 0.0, ("engaged", "stopping")
        for k in range(3000):
            begun = time.monotonic()
            screen.show(DRIVING | {"state": states[k % 2], "tick": k, "reasons": [f"code_{n}" for n in range(9)]})
            longest = max(longest, time.monotonic() - begun)
        assert longest < 1.0
        # Once somebody reads again, the picture comes back.
        text = _shown(screen, reader, DRIVING | {"state": "stopped"}, 1.0)
        assert "AT REST" in text


def test_a_pipe_that_nobody_reads_or_holds_does_not_hold_the_drive_up():
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream:
        screen = Screen(stream)
        for k in range(2000):
            screen.show(DRIVING | {"state": ("engaged", "stopping")[k % 2], "reasons": ["dbw_watchdog"] * 3})
        os.close(reading)
        screen.show(DRIVING)
        screen.close()


def test_a_stop_over_the_page_is_not_called_the_operators() -> None:
    said = transition(DRIVING | {"state": "stopping", "reasons": ["stop_asked_by_page"]})
    assert "STOPPING: somebody asked to stop over the page in a browser" in said
    assert "operator" not in said
