"""The SPATEM: tshark reads the counts of which a message was made, a receiver `rounded`; other bytes are refused."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.v2x.packets import AROUND, frame, spoilt
from tests.v2x.tshark import assert_read, needs_tshark, read
from vve_sumo.errors import ConfigError
from vve_sumo.v2x import spatem
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.spatem import Event, IntersectionState, Movement, Phase, Spatem, Status

RED = Event(Phase.STOP_AND_REMAIN, 120.0, 130.0, 125.0, 100.0, 200.0, 7)
STATE = IntersectionState(
    12, (Movement(1, (RED, Event(Phase.PRE_MOVEMENT))), Movement(2, (Event(Phase.DARK),))), 3, 5, Status.FIXED_TIME,
    1000, 12.345,
)  # fmt: skip
MESSAGE = Spatem(9, (STATE,))


def drawn_event(random: Random, counts: dict[str, list[int]]) -> Event:
    """An event; its counts are added to the lists of them by tshark's names."""

    def mark(name: str) -> float | None:
        if random.random() < 0.5:
            return None
        counts.setdefault(f"dsrc.{name}", []).append(random.randrange(36_001))
        return counts[f"dsrc.{name}"][-1] * 0.1

    phase = random.randrange(10)
    counts.setdefault("dsrc.eventState", []).append(phase)
    if random.random() < 0.3:
        return Event(Phase(phase))
    start, max_end, likely = mark("startTime"), mark("maxEndTime"), mark("likelyTime")
    min_end = random.choice((36_001, random.randrange(36_001)))
    confidence = random.randrange(16)
    counts.setdefault("dsrc.minEndTime", []).append(min_end)
    counts.setdefault("dsrc.confidence", []).append(confidence)
    following = mark("nextTime")
    return Event(
        Phase(phase), None if min_end == 36_001 else min_end * 0.1, max_end, likely, start, following, confidence
    )


def drawn(random: Random) -> tuple[Spatem, dict[str, Any]]:
    """A message, and what tshark should read of it."""
    counts: dict[str, Any] = {
        "its.protocolVersion": 2, "its.messageID": 4, "its.stationID": random.getrandbits(32), "dsrc.signalGroup": [],
        "dsrc.id": [], "dsrc.revision": [], "dsrc.intersectionState.status": [],
    }  # fmt: skip
    states = []
    for _ in range(random.randint(1, 3)):
        number, revision, status = random.getrandbits(16), random.randrange(128), random.getrandbits(14) << 2
        counts["dsrc.id"].append(number)
        counts["dsrc.revision"].append(revision)
        counts["dsrc.intersectionState.status"].append(status.to_bytes(2).hex(":"))
        state = IntersectionState(number, (), None, revision, Status(status))
        for name, field, greatest, unit in (
            ("dsrc.region", "region", 65_535, 1), ("dsrc.moy", "minute_of_year", 527_039, 1),
            ("dsrc.timeStamp", "second", 60_999, 0.001),
        ):  # fmt: skip
            if random.random() < 0.5:
                counts.setdefault(name, []).append(random.randint(0, greatest))
                state = replace(state, **{field: counts[name][-1] * unit})
        movements = []
        for _ in range(random.randint(1, 4)):
            counts["dsrc.signalGroup"].append(random.randrange(256))
            events = tuple(drawn_event(random, counts) for _ in range(random.randint(1, 3)))
            movements.append(Movement(counts["dsrc.signalGroup"][-1], events))
        states.append(replace(state, movements=tuple(movements)))
    return Spatem(counts["its.stationID"], tuple(states)), counts


@needs_tshark
@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_tshark_reads_the_counts_of_which_a_message_was_made(messages: int, tmp_path: Path) -> None:
    random = Random(41)
    made = [drawn(random) for _ in range(messages)]
    found = read([frame(MessageId.SPATEM, spatem.encode(message), AROUND) for message, _ in made], tmp_path)
    optional = {f"dsrc.{name}" for name in ("region", "moy", "timeStamp", "startTime", "maxEndTime", "nextTime")}
    for fields_of_one, (_, counts) in zip(found, made, strict=True):
        assert_read(fields_of_one, counts)
        assert optional & fields_of_one.keys() == optional & counts.keys()


marks = st.none() | st.floats(0.0, 4000.0)
events = st.builds(Event, st.sampled_from(Phase), marks, marks, marks, marks, marks, st.none() | st.integers(0, 15))
movements = st.builds(Movement, st.integers(0, 255), st.lists(events, min_size=1, max_size=3).map(tuple))
states = st.builds(
    IntersectionState, st.integers(0, 0xFFFF), st.lists(movements, min_size=1, max_size=3).map(tuple),
    st.none() | st.integers(0, 0xFFFF), st.integers(0, 127), st.integers(0, 0x3FFF).map(lambda bits: Status(bits << 2)),
    st.none() | st.integers(0, 527_039), st.none() | st.floats(0.0, 70.0),
)  # fmt: skip


@given(st.builds(Spatem, st.integers(0, 2**32 - 1), st.lists(states, min_size=1, max_size=3).map(tuple)))
def test_a_receiver_reads_rounded(message: Spatem) -> None:
    read_back = spatem.rounded(message)
    assert spatem.decode(spatem.encode(message)) == read_back
    assert spatem.rounded(read_back) == read_back


def with_event(event: Event) -> Spatem:
    return Spatem(9, (replace(STATE, movements=(Movement(1, (event,)),)),))


def test_times_are_rounded_to_the_nearest_tenth_and_end_at_an_hour() -> None:
    red = replace(RED, min_end=12.34, max_end=12.36, likely_end=4000.0)
    (state,) = spatem.rounded(with_event(red)).intersections
    (event,) = state.movements[0].events
    assert (event.min_end, event.max_end, event.likely_end) == (12.3, 12.4, 3600.0)


@pytest.mark.parametrize("function", [spatem.encode, spatem.rounded])
@pytest.mark.parametrize(
    "message",
    [
        *(with_event(replace(RED, **{name: value}))
          for name in ("min_end", "max_end", "likely_end", "start", "next_start")
          for value in (math.nan, math.inf, -1.0)),
        *(Spatem(9, (replace(STATE, **{name: value}),)) for name, value in (
            ("second", math.nan), ("second", -1.0), ("id", 65_536), ("region", -1), ("revision", 128),
            ("minute_of_year", 527_040), ("movements", ()), ("movements", (Movement(256, (RED,)),)),
            ("movements", (Movement(1, ()),)), ("movements", (Movement(1, (RED,) * 17),)),
            ("movements", (Movement(1, (replace(RED, confidence=16),)),)))),
        Spatem(2**32, (STATE,)), Spatem(9, ()), Spatem(9, (STATE,) * 33),
    ],
)  # fmt: skip
def test_what_no_message_can_say_is_refused(message: Spatem, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(message)


@given(spoilt(spatem.encode(MESSAGE)))
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        found = spatem.decode(data)
    except MessageDecodeError:
        return
    assert spatem.decode(spatem.encode(found)) == spatem.rounded(found)


def test_without_pycrate_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycrate_asn1dir.ITS_IS", None)
    with pytest.raises(ConfigError, match=r"pip install 'vve-sumo\[v2x-signals\]'"):
        spatem.encode(MESSAGE)
