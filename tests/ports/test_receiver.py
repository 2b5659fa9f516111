"""The shipped kinds of receiver, and a small one of an invented make, against the port's suite."""

from __future__ import annotations

import contextlib
import datetime
import math
import os
import pty
import socket
import time
import tomllib
import tty
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.conftest import REPOSITORY
from tests.ports.receiver import FarEnd, Portions, ReceiverConformance, no_bus, udp_far_end
from tests.pose import test_nmea
from tests.pose.test_trust import EPOCH, drive
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.pose import ncom, oxts_can
from vve_sumo.pose.receivers.oxts_can import FRAME
from vve_sumo.pose.receivers.port import PORT, Receiver, load
from vve_sumo.rig.load import parse, parse_json
from vve_sumo.rig.resolve import receiver_of
from vve_sumo.rig.validation import arming_obstacle
from vve_sumo.values import Frame

TODAY = datetime.date(2026, 5, 1)
TOY = Path(__file__).parent / "toy" / "csv_udp.py"
DELAY = 0.01
CAR = {"minimum_delay_ms": 10.0}
SIGMAS = {"velocity_sigma_mps": 0.05, "heading_sigma_deg": 0.2}


@cache
def as_ncom() -> Portions:
    encoder = ncom.Encoder()
    return [(fix.time - EPOCH + DELAY, encoder.encode(fix)) for fix in drive(250)]


@cache
def as_nmea() -> Portions:
    return test_nmea.drive(40)


@cache
def as_frames() -> Portions:
    """For longer than a unit is believed to be catching up."""
    encoder = oxts_can.Encoder()
    return [
        (fix.time - EPOCH + DELAY, b"".join(FRAME.pack(frame.id, len(frame.data), frame.data) for frame in frames))
        for fix, frames in ((fix, encoder.encode(fix)) for fix in drive(700, period=0.02))
    ]


@cache
def as_lines() -> Portions:
    rows = []
    for fix in drive(250):
        numbers = (
            fix.time, math.degrees(fix.latitude), math.degrees(fix.longitude), fix.altitude,
            90.0 - math.degrees(fix.heading), math.degrees(fix.pitch), fix.velocity_north, fix.velocity_east,
            fix.velocity_down, -math.degrees(fix.yaw_rate), fix.acceleration, 3, fix.position_sigma,
            fix.velocity_sigma, fix.differential_age,
        )  # fmt: skip
        rows.append((fix.time - EPOCH + DELAY, (",".join(map(repr, numbers)) + "\n").encode()))
    return rows


class TestNcomUdp(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "ncom_udp", **CAR}

    def portions(self) -> Portions:
        return as_ncom()

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return udp_far_end()


class TestNmeaUdp(TestNcomUdp):
    table: ClassVar[dict[str, Any]] = {"kind": "nmea_udp", **CAR, **SIGMAS}

    def portions(self) -> Portions:
        return as_nmea()


class TestNmeaTcp(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "nmea_tcp", **CAR, **SIGMAS}

    def portions(self) -> Portions:
        return as_nmea()

    @contextmanager
    def far_end(self, _folder: Path) -> Iterator[FarEnd]:
        with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
            peers: list[socket.socket] = []

            def write(data: bytes) -> None:
                if not peers:
                    peers.append(stack.enter_context(server.accept()[0]))
                peers[0].sendall(data)

            yield FarEnd({"port": server.getsockname()[1]}, write, no_bus)


class TestNmeaSerial(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "nmea_serial", "device": "/dev/ttyS0", **CAR, **SIGMAS}

    def portions(self) -> Portions:
        return as_nmea()

    @contextmanager
    def far_end(self, _folder: Path) -> Iterator[FarEnd]:
        near, far = pty.openpty()
        tty.setraw(far)
        try:
            yield FarEnd({"device": os.ttyname(far)}, lambda data: os.write(near, data), no_bus)
        finally:
            os.close(near)
            os.close(far)


class Wire:
    """A bus of one listener, over a socket pair: each datagram is a portion of frames."""

    def __init__(self, end: socket.socket, *, waitable: bool = True) -> None:
        self._end, self._waitable, self.closed = end, waitable, False
        end.setblocking(False)

    def fileno(self) -> int | None:
        return self._end.fileno() if self._waitable else None

    def drain(self) -> list[Frame]:
        frames = []
        with contextlib.suppress(BlockingIOError):
            while data := self._end.recv(4096):
                frames += [Frame(number, payload[:size]) for number, size, payload in FRAME.iter_unpack(data)]
            raise RigError("the bus is down")
        return frames

    def close(self) -> None:
        self.closed = True


class TestOxtsCan(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "oxts_can", "interface": "socketcan", "channel": "can1", **CAR}
    grain = FRAME.size

    def portions(self) -> Portions:
        return as_frames()

    @contextmanager
    def far_end(self, _folder: Path) -> Iterator[FarEnd]:
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        with near, far:
            asked: list[tuple[str, str, int]] = []

            def open_bus(*which: Any) -> Wire:
                asked.append(which)
                return Wire(near)

            yield FarEnd({"bitrate": 250_000}, far.send, open_bus)
            assert asked == [("socketcan", "can1", 250_000)]

    def test_a_driver_that_cannot_be_waited_on_is_refused(self) -> None:
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        with near, far:
            wire = Wire(near, waitable=False)
            with pytest.raises(RigError, match=r"pose\.interface: .* take socketcan or slcan"):
                self.receiver().open(lambda *_which: wire)
            assert wire.closed

    def test_a_bus_that_goes_down_is_lost(self) -> None:
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        with near:
            source = self.receiver().open(lambda *_which: Wire(near))
            far.close()
            assert source.receive() == []
            assert source.lost


class TestFile(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "file", "file": "drive.ncom"}

    def portions(self) -> Portions:
        return as_ncom()

    @contextmanager
    def far_end(self, folder: Path) -> Iterator[FarEnd]:
        file = folder / "drive.ncom"
        file.write_bytes(b"".join(data for _received, data in self.portions()[:40]))
        yield FarEnd({"file": str(file)}, len, no_bus)


class TestToy(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": f"{TOY}:make", "heading_sigma_deg": 0.2, **CAR}

    def portions(self) -> Portions:
        return as_lines()

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return udp_far_end()


# --- how a kind is found ----------------------------------------------------------------------------------------------


def test_the_shipped_kinds_are_known_and_each_is_a_receiver() -> None:
    assert set(PORT.shipped) == {"ncom_udp", "nmea_udp", "nmea_tcp", "nmea_serial", "oxts_can", "file"}
    assert set(PORT.shipped) <= set(PORT.known())
    for suite in ReceiverConformance.__subclasses__():
        assert isinstance(suite().configured(), Receiver)


def a_rig(**pose: Any) -> dict[str, Any]:
    table = tomllib.loads((REPOSITORY / "rigs" / "fusion_example.toml").read_text(encoding="utf-8"))
    table["lot"]["surveyed"] = datetime.date(2026, 5, 1)
    return table | {"pose": pose}


def test_a_rig_drives_with_a_receiver_of_somebody_s_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(TOY.parent)
    table = a_rig(kind="csv_udp.py:make", heading_sigma_deg=0.2, port=4000, **CAR)
    rig = parse(table, Path("mine.toml"))
    receiver = receiver_of(rig)
    assert receiver.place() == "127.0.0.1 port 4000"
    assert receiver.not_fixed_hint == "see the green light on the receiver"
    assert rig.pose.rate_hz == 100.0
    monkeypatch.chdir(tmp_path)
    kept = rig.model_dump(mode="json", exclude_unset=True)
    assert receiver_of(parse_json(kept, Path("record"))).place() == receiver.place(), "wherever the record is read"


def test_a_key_that_somebody_s_own_receiver_lacks_is_one_line() -> None:
    table = a_rig(kind=f"{TOY}:make", heading_sigma_deg=0.2, baud=9600, **CAR)
    with pytest.raises(
        ConfigError, match=r"^mine\.toml: unknown key 'pose\.baud'; kind '.*csv_udp\.py:make' has "
    ) as one:
        parse(table, Path("mine.toml"))
    assert "\n" not in str(one.value)


def test_no_car_is_armed_on_a_recording() -> None:
    assert "recording" in str(arming_obstacle(parse(a_rig(kind="file", file="a.ncom"), Path("mine.toml")), TODAY))


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("def make():\n    return 7\n", "make returned 7, expected a class derived from ReceiverTable"),
        ("def make():\n    raise OSError('no licence')\n", "make raised OSError: no licence"),
        ("def make(kind):\n    return kind\n", "make raised TypeError: "),
        ("import nothing_like_it\n", "raised ModuleNotFoundError: "),
        ("", r"offers no function make\(\)"),
        (
            "from vve_sumo.pose.receivers.port import ReceiverTable\n\n\nclass Half(ReceiverTable):\n"
            "    def place(self):\n        return 'here'\n\n\ndef make():\n    return Half\n",
            "Half lacks decoder, open, profile, silent_hint",
        ),
    ],
)
def test_what_is_no_receiver_is_one_line(tmp_path: Path, lines: str, said: str) -> None:
    file = tmp_path / "poor.py"
    file.write_text(lines, encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as refused:
        load(f"{file}:make")
    assert str(refused.value).startswith(f"receiver {file}:make: ")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("kind", "portions"), [("ncom_udp", as_ncom), ("nmea_udp", as_nmea)])
def test_a_stray_datagram_before_the_receiver_does_not_lock_it_out(kind: str, portions: Any) -> None:
    with udp_far_end() as far:
        more = SIGMAS if kind == "nmea_udp" else {}
        table = load(kind)(kind=kind, minimum_delay_ms=10.0, port=far.changes["port"], **more)
        source = table.open(no_bus)
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.sendto(b"whoever is there", ("127.0.0.1", far.changes["port"]))
                for _received, data in portions()[:3]:
                    far.write(data)
                time.sleep(0.05)
                arrived = [data for _stamp, data in source.receive()]
                assert arrived[1:] == [data for _received, data in portions()[:3]]
                assert source.found() == ()
                name = f"127.0.0.1:{stranger.getsockname()[1]}"
                assert source.sender_report()["refused"] == {name: 1}
        finally:
            source.close()
