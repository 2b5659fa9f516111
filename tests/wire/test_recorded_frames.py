"""Frames of radars that the codecs made and read when their layouts were written by hand: every bit and digit is kept.

`recorded_frames.jsonl` holds cycles, hosts and object lists with their frames, and what these frames were read as.
"""

from __future__ import annotations

import json
from dataclasses import astuple
from pathlib import Path
from typing import Any

from vve_sumo.values import Frame
from vve_sumo.wire import ars408, esr

ROWS = [json.loads(line) for line in Path(__file__).with_name("recorded_frames.jsonl").read_text("ascii").splitlines()]


def rows(kind: str) -> list[list[Any]]:
    chosen = [row[1:] for row in ROWS if row[0] == kind]
    assert len(chosen) == 60
    return chosen


def plain(value: Any) -> Any:
    """A value's fields as the file holds them."""
    return json.loads(json.dumps(astuple(value)))


def said(frames: tuple[Frame, ...]) -> list[list[Any]]:
    return [[frame.id, frame.data.hex()] for frame in frames]


def test_cycles_of_an_esr() -> None:
    for (scan, stamp, host, tracks, *flags), frames, read in rows("esr"):
        made = [esr.Track(*track[:7], esr.TrackStatus(track[7]), esr.Mode(track[8]), track[9]) for track in tracks]
        sent = esr.encode(esr.Cycle(scan, stamp, esr.HostMotion(*host), made, *flags))
        assert said(tuple(frame for frame in sent if any(frame.data))) == frames
        (back,) = esr.Decoder().feed(sent)
        assert plain(back) == read


def test_host_of_an_esr() -> None:
    for motion, frames, read in rows("esr_host"):
        sent = esr.encode_host(esr.HostMotion(*motion))
        assert said(sent) == frames
        back = esr.decode_host(sent[0])
        assert back is not None
        assert plain(back) == read


def test_object_lists_of_an_ars408() -> None:
    for (counter, objects, sensor, valid), frames, (count, found, failed) in rows("ars408"):
        made = [
            ars408.Object(*one[:5], ars408.Motion(one[5]), *one[6:8], ars408.Measurement(one[8]),
                          ars408.Kind(one[9]), *one[10:])
            for one in objects
        ]  # fmt: skip
        sent = ars408.encode(ars408.ObjectList(counter, made), sensor, valid)
        assert said(sent) == frames
        decoder = ars408.Decoder(sensor)
        (back,) = decoder.feed(sent)
        assert (back.counter, plain(back)[1], decoder.failed) == (count, found, failed)
