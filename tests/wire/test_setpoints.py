"""The inbox of external setpoints against a plain model of its rules, and against floods of bytes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.timing import SETPOINT_LIFETIME
from vve_sumo.wire.datagrams import SEQUENCES, SetpointDatagram, encode_setpoint
from vve_sumo.wire.setpoints import FORGED, LATE, MAX_ANSWERED, REPLAYED, UNASKED, SetpointInbox
from vve_sumo.wire.signature import signed

EPOCH = 998.0  #: GNSS second of drive time 0
ASKED = SetpointDatagram(sequence=5, answers=100, time=1000.0, lifetime=0.08, steering=0.1, acceleration=-2.0)


def _inbox(*sent: int) -> SetpointInbox:
    inbox = SetpointInbox(EPOCH)
    for sequence in sent:
        inbox.sample_sent(sequence)
    return inbox


def _bytes(**other: object) -> bytes:
    return encode_setpoint(dataclasses.replace(ASKED, **other))  # type: ignore[arg-type]


def test_a_setpoint_is_acted_on_until_it_expires() -> None:
    inbox = _inbox(99, 100)
    assert inbox.command(0.0) is None
    assert inbox.take(2.0, _bytes()) == ""
    command = inbox.command(2.08)
    assert command is not None
    assert [command.steering, command.acceleration] == pytest.approx([0.1, -2.0])
    assert not command.emergency
    assert inbox.command(2.0801) is None


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"sequence": 5}, REPLAYED),
        ({"sequence": 4}, REPLAYED),
        ({"sequence": 5 + SEQUENCES // 2}, REPLAYED),
        ({"sequence": 6, "answers": 101}, UNASKED),
        ({"sequence": 6, "answers": 100 - MAX_ANSWERED}, LATE),
        ({"sequence": 6}, ""),
        ({"sequence": 5 + SEQUENCES // 2 - 1}, ""),
    ],
)
def test_what_is_not_new_or_not_asked_for_is_refused(other: dict[str, int], reason: str) -> None:
    inbox = _inbox(*range(100 - MAX_ANSWERED - 5, 101))
    assert inbox.take(2.0, _bytes()) == ""
    assert inbox.take(2.05, _bytes(**other)) == reason
    assert inbox.counts[reason] == bool(reason)
    assert (inbox.command(2.1) is None) == bool(reason)  # a refused one does not renew the first


def test_sequences_begin_again_after_the_greatest() -> None:
    inbox = _inbox(SEQUENCES - 1, SEQUENCES)
    assert inbox.take(2.0, _bytes(sequence=SEQUENCES - 1, answers=SEQUENCES - 1)) == ""
    assert inbox.take(2.0, _bytes(sequence=0, answers=0)) == ""


@given(
    steps=st.lists(
        st.tuples(st.floats(0.0, 0.2), st.integers(0, 3), st.booleans(), st.floats(0.001, SETPOINT_LIFETIME)),
        max_size=30,
    )
)
def test_a_command_is_never_older_than_its_lifetime(steps: list[tuple[float, int, bool, float]]) -> None:
    inbox, now, sequence, alive_until = SetpointInbox(EPOCH), 0.0, 0, -1.0
    for number, (passed, ahead, asked, lifetime) in enumerate(steps):
        now += passed
        if asked:
            inbox.sample_sent(number)
        data = _bytes(sequence=sequence + ahead, answers=number, lifetime=round(lifetime, 6), time=EPOCH + now)
        if inbox.take(now, data) == "":
            assert asked
            sequence, alive_until = sequence + ahead, now + round(lifetime, 6)
        assert (inbox.command(now) is not None) == (now <= alive_until)


def test_a_flood_of_bytes_never_gives_a_command() -> None:
    generator, inbox, whole = np.random.default_rng(3), _inbox(100), bytearray(_bytes())
    for _ in range(30_000):
        data = bytearray(whole)
        for place in generator.integers(0, len(data), generator.integers(1, 6)):
            data[place] ^= int(generator.integers(1, 256))
        if bytes(data) != bytes(whole):
            assert inbox.take(2.0, bytes(data))
    assert inbox.command(2.0) is None
    assert inbox.taken == 0


def test_with_a_key_only_who_has_it_is_obeyed() -> None:
    inbox = SetpointInbox(EPOCH, b"secret")
    inbox.sample_sent(100)
    for data in (_bytes(), signed(_bytes(), b"other"), signed(_bytes(), b"secret")[:-1], b""):
        assert inbox.take(2.0, data) == FORGED
    assert inbox.command(2.0) is None
    assert inbox.take(2.0, signed(_bytes(), b"secret")) == ""
    assert inbox.command(2.0) is not None


@pytest.mark.parametrize(
    ("later", "reason"),
    [(-604_800.0, UNASKED), (-0.06, UNASKED), (-0.04, ""), (0.0, ""), (0.2, ""), (0.26, LATE), (3600.0, LATE)],
)
def test_a_signed_setpoint_of_another_drive_is_refused_whatever_it_answers(later: float, reason: str) -> None:
    """Every drive counts its radar datagrams from the same number, so a recorded setpoint answers one of them."""
    recorded, another_drive = signed(_bytes(), b"secret"), SetpointInbox(EPOCH + later, b"secret")
    another_drive.sample_sent(100)
    assert another_drive.take(2.0, recorded) == reason
    assert (another_drive.command(2.0) is None) == bool(reason)
