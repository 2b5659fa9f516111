"""Channels: real sockets, with an end that doesn't listen, an end that is gone, an end in another process."""

from __future__ import annotations

import os
import select
import time

from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.live.channel import MAX_DATAGRAM_SIZE, pair


@given(st.lists(st.binary(min_size=1, max_size=3000), max_size=30))
def test_datagrams_arrive_whole_and_in_order(datagrams):
    ours, theirs = pair()
    assert [ours.send(data) for data in datagrams] == [True] * len(datagrams)
    assert theirs.receive() == datagrams
    assert theirs.receive() == []
    assert not ours.closed
    assert not theirs.closed
    ours.close()
    theirs.close()


def test_a_peer_that_does_not_listen_is_told_nothing_and_keeps_nobody():
    ours, theirs = pair()
    begun, sent = time.monotonic(), 0
    while ours.send(sent.to_bytes(4, "big") * 250):
        sent += 1
    assert not ours.send(b"x" * 1000)
    assert time.monotonic() - begun < 5.0
    assert not ours.closed
    heard = theirs.receive()
    assert [int.from_bytes(data[:4], "big") for data in heard] == list(range(sent))
    assert ours.send(b"again")
    assert theirs.receive() == [b"again"]


def test_what_was_sent_before_the_end_is_still_heard_whoever_had_not_read():
    ours, theirs = pair()
    theirs.send(b"last words")
    ours.send(b"never read")
    theirs.close()
    assert ours.receive() == [b"last words"]
    assert ours.closed
    assert ours.receive() == []
    assert not ours.send(b"anybody?")


def test_sending_to_somebody_who_is_gone_shows_it():
    ours, theirs = pair()
    theirs.close()
    assert not ours.closed
    assert not ours.send(b"x")
    assert ours.closed
    ours.close()
    assert not ours.send(b"x")
    assert ours.receive() == []


def test_a_datagram_too_long_is_refused_and_harms_nothing():
    ours, theirs = pair()
    assert not ours.send(bytes(MAX_DATAGRAM_SIZE + 1))
    assert not ours.closed
    assert ours.send(b"short")
    assert theirs.receive() == [b"short"]


def test_a_channel_can_be_waited_on():
    ours, theirs = pair()
    assert select.select([theirs], [], [], 0.0)[0] == []
    ours.send(b"x")
    assert select.select([theirs], [], [], 1.0)[0] == [theirs]
    assert theirs.fileno() not in (0, 1, 2, ours.fileno())
    assert not os.get_inheritable(ours.fileno())
