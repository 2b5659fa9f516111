"""Who is taken for the receiver: whatever order strangers speak in."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.drive.reasons import DRIVE_REASONS
from vve_sumo.pose.senders import MAX_NAMED, STANDS, Senders

SOURCE = "192.168.25.44"
ADDRESSES = st.sampled_from([SOURCE, "192.168.25.45", "10.0.0.1", "127.0.0.1", "127.9.9.9"])


@given(
    st.sampled_from([SOURCE, "127.0.0.1", None]),
    st.lists(st.tuples(ADDRESSES, st.integers(1, 3), st.floats(0.0, 2.0)), max_size=40),
)
def test_at_most_one_sender_is_ever_taken_and_every_other_datagram_is_counted_and_told(source, datagrams):
    senders, now, taken = Senders(source), 0.0, []
    for address, port, passed in datagrams:
        now += passed
        accepted = senders.accepts(now, (address, port), b"x")
        if accepted:
            taken.append((address, port))
        else:
            assert senders.faults(now)
            assert set(senders.faults(now)) <= DRIVE_REASONS.keys()
    assert len(set(taken)) <= 1
    assert all(address == source if source else address.startswith("127.") for address, _port in taken)
    assert sum(senders.sender_report()["refused"].values()) == len(datagrams) - len(taken)
    assert senders.faults(now + STANDS + 1e-6) == ()


def test_the_receiver_is_taken_after_strangers_spoke():
    senders = Senders(SOURCE)
    assert not senders.accepts(0.0, ("10.0.0.1", 3000), b"x")
    assert senders.accepts(0.1, (SOURCE, 3000), b"x")
    assert senders.sender_report() == {"sender": f"{SOURCE}:3000", "refused": {"10.0.0.1:3000": 1}}


def test_who_sends_what_no_receiver_sends_is_not_the_receiver():
    senders = Senders(SOURCE, lambda data: data == b"fix")
    assert senders.accepts(0.0, (SOURCE, 1), b"junk"), "its decoder says what is wrong"
    assert senders.faults(0.0) == ()
    assert senders.accepts(0.1, (SOURCE, 2), b"junk")
    assert senders.accepts(0.2, (SOURCE, 2), b"fix")
    assert senders.sender_report() == {"sender": f"{SOURCE}:2", "refused": {f"{SOURCE}:1": 1}}
    assert senders.accepts(0.3, (SOURCE, 2), b"junk"), "damage on the way makes nobody another one"
    assert not senders.accepts(0.4, (SOURCE, 1), b"fix")
    assert senders.faults(0.4) == ("pose_two_senders",)
    assert senders.sender_report()["refused"] == {f"{SOURCE}:1": 2}


@pytest.mark.parametrize(
    ("sender", "code"), [((SOURCE, 3001), "pose_two_senders"), (("10.0.0.1", 3000), "pose_foreign_sender")]
)
def test_another_port_is_told_from_another_address(sender, code):
    senders = Senders(SOURCE)
    assert senders.accepts(0.0, (SOURCE, 3000), b"x")
    assert not senders.accepts(1.0, sender, b"x")
    assert senders.faults(1.0 + STANDS) == (code,)
    assert senders.accepts(1.1, (SOURCE, 3000), b"x"), "the receiver is heard on"


def test_a_flood_from_everywhere_takes_no_more_room_than_a_few_names():
    senders = Senders(SOURCE)
    for number in range(10_000):
        senders.accepts(0.0, (f"10.0.{number // 256}.{number % 256}", 5), b"x")
    refused = senders.sender_report()["refused"]
    assert len(refused) == MAX_NAMED + 1
    assert sum(refused.values()) == 10_000
