"""A pose receiver on a real pty: whole, lost, and what cannot be opened."""

from __future__ import annotations

import os
import pty
import time
import tty

import pytest

from tests.pose.ncom_packets import PACKETS
from tests.pose.source_reading import gathered, ready
from vve_sumo.errors import RigError
from vve_sumo.pose import nmea
from vve_sumo.pose.sources import open_serial


@pytest.fixture
def line():
    far, near = pty.openpty()
    tty.setraw(near)
    source = open_serial(os.ttyname(near), 115_200)
    yield source, far
    source.close()
    os.close(near)


def test_a_serial_line(line):
    source, far = line
    assert source.receive() == []
    os.write(far, b"".join(PACKETS[:20]))
    portions = gathered(source, 20 * 72)
    assert b"".join(data for _, data in portions) == b"".join(PACKETS[:20])
    assert portions[0][0] == pytest.approx(time.monotonic(), abs=1.0)
    assert not source.lost
    os.close(far)


def test_a_device_that_goes_away_is_lost_and_raises_nothing(line):
    source, far = line
    os.close(far)
    ready(source)
    assert source.receive() == []
    assert source.lost
    assert source.receive() == []


def test_no_device_a_device_in_use_and_a_plain_file_name_the_key(line, tmp_path):
    source, far = line
    with pytest.raises(RigError, match=r"^pose\.device: /dev/ttyNONE does not exist: is the receiver plugged in\?$"):
        open_serial("/dev/ttyNONE", 115_200)
    device = os.ttyname(source.fileno())
    with pytest.raises(RigError, match=rf"^pose\.device: {device} is in use by another program$"):
        open_serial(device, 115_200)
    plain = tmp_path / "plain"
    plain.touch()
    with pytest.raises(RigError, match=rf"^pose\.device: {plain} .*"):
        open_serial(str(plain), 115_200)
    os.close(far)


def test_an_impossible_baud_rate_names_the_key():
    far, near = pty.openpty()
    with pytest.raises(RigError, match=r"^pose\.baud: .* cannot do -1 baud$"):
        open_serial(os.ttyname(near), -1)
    os.close(far)
    os.close(near)


def test_nmea_over_a_pty_one_byte_at_a_time(line):
    from tests.pose.nmea_sentences import drive

    source, far = line
    decoder, found = nmea.Decoder(velocity_sigma=0.05, heading_sigma=0.004), 0
    for _, sentence in drive(3):
        for byte in sentence:
            os.write(far, bytes((byte,)))
        found += sum(len(decoder.feed(data, 0.0)) for _, data in gathered(source, len(sentence)))
    os.close(far)
    assert found == 3
    assert decoder.discarded == 0
