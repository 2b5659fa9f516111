"""The shipped kinds of receiver, and a small one of an invented make, against the port's suite."""

from __future__ import annotations

import contextlib
import datetime
import functools
import json
import math
import os
import pty
import re
import socket
import time
import tomllib
import tty
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from tests import vehicles
from tests.conftest import REPOSITORY
from tests.ports.receiver import FarEnd, Portions, ReceiverConformance, no_bus, udp_far_end
from tests.pose import nmea_sentences
from tests.pose.test_trust import EPOCH, drive
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.frames import MapFrame
from vve_sumo.live.simulated_vehicle import CarConfig, SimulatedVehicle, TruthFile
from vve_sumo.physical_constants import EARTH_RADIUS
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.pose import ncom, oxts_can
from vve_sumo.pose.receivers.oxts_can import FRAME
from vve_sumo.pose.receivers.port import PORT, Receiver, configured, load, standard
from vve_sumo.rig.load import parse, parse_json
from vve_sumo.rig.resolve import receiver_of
from vve_sumo.rig.validation import arming_obstacle
from vve_sumo.values import Fix, FixQuality, Frame

TODAY = datetime.date(2026, 5, 1)
TOY = Path(__file__).parent / "toy" / "csv_udp.py"
RECEIVERS = (REPOSITORY / "docs" / "receivers.md").read_text(encoding="utf-8")
DELAY = 0.01
CAR = {"minimum_delay_ms": 10.0}
SIGMAS = {"velocity_sigma_mps": 0.05, "heading_sigma_deg": 0.2}


@cache
def as_ncom() -> Portions:
    encoder = ncom.Encoder()
    return [(fix.time - EPOCH + DELAY, encoder.encode(fix)) for fix in drive(250)]


@cache
def as_nmea() -> Portions:
    return nmea_sentences.drive(40)


@cache
def as_frames() -> Portions:
    """For longer than a unit is believed to be catching up."""
    encoder = oxts_can.Encoder()
    return [
        (fix.time - EPOCH + DELAY, b"".join(FRAME.pack(frame.id, len(frame.data), frame.data) for frame in frames))
        for fix, frames in ((fix, encoder.encode(fix)) for fix in drive(700, period=0.02))
    ]


@cache
def encoded(kind: str) -> Portions:
    """A drive as a kind's own encoder writes it."""
    encoder = configured(
        {"kind": kind, "device": "/dev/null", **CAR} if "serial" in kind else {"kind": kind, **CAR}
    ).encoder()
    assert encoder is not None
    return [(fix.time - EPOCH + DELAY, encoder.encode(fix)) for fix in drive(80)]


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


#: of NCOM: of velocities 1e-4 m/s, angles 1e-6 rad, rates 1e-5 rad/s; sigmas 1 mm, 1 mm/s and 1e-5 rad (OXTS NCOM
#: description); degrees are doubles
OF_NCOM = {
    "time": 1e-3, "latitude": 1e-12, "longitude": 1e-12, "altitude": 1e-3, "heading": 1e-6, "pitch": 1e-6,
    "roll": 1e-6, "velocity_north": 1e-4, "velocity_east": 1e-4, "velocity_down": 1e-4, "yaw_rate": 1e-5,
    "acceleration": 1e-4, "position_sigma": 1e-3, "velocity_sigma": 1e-3, "heading_sigma": 1e-5,
    "differential_age": 1e-2,
}  # fmt: skip
#: of the sentences: minutes of eight decimals, millimetres, thousandths of a degree; knots of four decimals along a
#: course of three, which at 43 m/s is 0.4 mm/s aside
OF_NMEA = {
    "time": 1e-3, "latitude": math.radians(1e-8 / 60.0), "longitude": math.radians(1e-8 / 60.0), "altitude": 1e-3,
    "heading": math.radians(1e-3), "velocity_north": 1e-3, "velocity_east": 1e-3, "differential_age": 0.1,
}  # fmt: skip
#: of OXTS's default map: 1e-7 degrees, mm, cm/s, hundredths of a degree; status channels as of NCOM
OF_FRAMES = {
    "time": 1e-3, "latitude": math.radians(1e-7), "longitude": math.radians(1e-7), "altitude": 1e-3,
    "heading": math.radians(0.01), "pitch": math.radians(0.01), "roll": math.radians(0.01), "velocity_north": 0.01,
    "velocity_east": 0.01, "velocity_down": 0.01, "yaw_rate": math.radians(0.01), "position_sigma": 1e-3,
    "velocity_sigma": 1e-3, "heading_sigma": 1e-5, "differential_age": 1e-2,
}  # fmt: skip
#: of UBX: 1e-7 degrees, mm, mm/s, hundred-thousandths of a degree; ages of corrections are classes
OF_UBX = {
    "time": 1e-3, "latitude": math.radians(1e-7), "longitude": math.radians(1e-7), "altitude": 1e-3,
    "heading": math.radians(1e-5), "velocity_north": 1e-3, "velocity_east": 1e-3, "velocity_down": 1e-3,
    "position_sigma": 1e-3, "velocity_sigma": 1e-3, "heading_sigma": math.radians(1e-5),
}  # fmt: skip
#: of SBF: position and height are doubles, of the rest a float has 24 bits: of 360 degrees 3e-5, of 64 m/s 4e-6
OF_SBF = {
    "time": 1e-3, "latitude": 1e-12, "longitude": 1e-12, "altitude": 1e-6, "heading": math.radians(3.1e-5),
    "pitch": math.radians(2e-6), "roll": math.radians(2e-6), "velocity_north": 4e-6, "velocity_east": 4e-6,
    "velocity_down": 4e-6, "yaw_rate": math.radians(8e-6), "position_sigma": 1e-6, "velocity_sigma": 1e-6,
    "heading_sigma": 1e-7, "differential_age": 1e-2,
}  # fmt: skip
#: of NovAtel's logs: all are doubles but the sigmas and the age of the corrections, which are floats
OF_NOVATEL = {
    **dict.fromkeys({*OF_NCOM} - {"yaw_rate", "acceleration"}, 1e-9), "time": 1e-3, "position_sigma": 1e-6,
    "velocity_sigma": 1e-6, "heading_sigma": 1e-8, "differential_age": 4e-6,
}  # fmt: skip
#: lines hold all digits of a double
OF_LINES = dict.fromkeys({*OF_NCOM} - {"roll", "heading_sigma"}, 1e-9)


class TestNcomUdp(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "ncom_udp", **CAR}
    resolution = OF_NCOM

    def portions(self) -> Portions:
        return as_ncom()

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return udp_far_end()


class TestNmeaUdp(TestNcomUdp):
    table: ClassVar[dict[str, Any]] = {"kind": "nmea_udp", **CAR, **SIGMAS}
    resolution = OF_NMEA

    def portions(self) -> Portions:
        return as_nmea()


class TestNmeaTcp(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "nmea_tcp", **CAR, **SIGMAS}
    resolution = OF_NMEA

    def portions(self) -> Portions:
        return as_nmea()

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return tcp_far_end()


class TestNmeaSerial(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "nmea_serial", "device": "/dev/ttyS0", **CAR, **SIGMAS}
    resolution = OF_NMEA

    def simulated(self, folder: Path, _port: int) -> dict[str, Any]:
        return {"device": f"pty:{folder / 'gnss.pty'}"}

    def portions(self) -> Portions:
        return as_nmea()

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return serial_far_end()


@contextmanager
def serial_far_end() -> Iterator[FarEnd]:
    """Write to a pseudo-terminal of the test's own."""
    near, far = pty.openpty()
    tty.setraw(far)
    try:
        yield FarEnd({"device": os.ttyname(far)}, lambda data: os.write(near, data), no_bus)
    finally:
        os.close(near)
        os.close(far)


@contextmanager
def tcp_far_end() -> Iterator[FarEnd]:
    """Serve a port of the test's own to one client."""
    with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
        peers: list[socket.socket] = []

        def write(data: bytes) -> None:
            if not peers:
                peers.append(stack.enter_context(server.accept()[0]))
            peers[0].sendall(data)

        yield FarEnd({"port": server.getsockname()[1]}, write, no_bus)


class TestUbxSerial(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "ubx_serial", "device": "/dev/ttyACM0", **CAR}
    resolution = OF_UBX

    def simulated(self, folder: Path, _port: int) -> dict[str, Any]:
        return {"device": f"pty:{folder / 'gnss.pty'}"}

    def portions(self) -> Portions:
        return encoded("ubx_serial")

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return serial_far_end()


class TestSbfTcp(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "sbf_tcp", **CAR}
    resolution = OF_SBF

    def portions(self) -> Portions:
        return encoded("sbf_tcp")

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return tcp_far_end()


class TestNovatelUdp(ReceiverConformance):
    table: ClassVar[dict[str, Any]] = {"kind": "novatel_udp", **CAR}
    resolution = OF_NOVATEL

    def portions(self) -> Portions:
        return encoded("novatel_udp")

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return udp_far_end()


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
    resolution = OF_FRAMES
    warm_up = 620  #: the unit is believed to be catching up for 12 s
    says_locked = False  #: the default map holds no navigation status

    def simulated(self, folder: Path, _port: int) -> dict[str, Any]:
        return {"interface": "slcan", "channel": f"pty:{folder / 'oxts.pty'}"}

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
    resolution = OF_LINES

    def portions(self) -> Portions:
        return as_lines()

    def far_end(self, _folder: Path) -> AbstractContextManager[FarEnd]:
        return udp_far_end()


# --- how a kind is found ----------------------------------------------------------------------------------------------


def test_the_shipped_kinds_are_known_and_each_is_a_receiver() -> None:
    wired = {"nmea": ("udp", "tcp", "serial"), "ubx": ("udp", "serial")}
    wired |= dict.fromkeys(("sbf", "novatel"), ("udp", "tcp", "serial"))
    expected = {f"{what}_{wire}" for what, wires in wired.items() for wire in wires}
    assert set(PORT.shipped) == {*expected, "ncom_udp", "oxts_can", "file"}
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


STRAYS = [("ncom_udp", as_ncom), ("nmea_udp", as_nmea)]
STRAYS += [(kind, functools.partial(encoded, kind)) for kind in ("ubx_udp", "sbf_udp", "novatel_udp")]


@pytest.mark.parametrize(("kind", "portions"), STRAYS)
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
                assert source.sender_faults() == ()
                name = f"127.0.0.1:{stranger.getsockname()[1]}"
                assert source.sender_report()["refused"] == {name: 1}
        finally:
            source.close()


@pytest.mark.parametrize("block", re.findall(r"```toml\n(.*?)```", RECEIVERS, flags=re.DOTALL))
def test_the_page_s_examples_are_receivers(block: str) -> None:
    table = tomllib.loads(block)["pose"]
    assert parse(a_rig(**table), Path("mine.toml")).pose.kind == table["kind"]


def test_the_page_names_every_kind() -> None:
    assert {kind for kind in PORT.shipped if f"`{kind}`" not in RECEIVERS} == {"file"}


# --- the simulated vehicle speaks as the receiver of its rig ----------------------------------------------------------

LOT = "+proj=tmerc +lat_0=40 +lon_0=-81 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
PLACE = (40.002, -82.98, 300.0)
SPOKEN = [
    {"kind": "ncom_udp"},
    {"kind": "nmea_udp", **SIGMAS},
    {"kind": "ubx_udp"},
    {"kind": "sbf_udp"},
    {"kind": "novatel_udp"},
    {"kind": f"{TOY}:make", "heading_sigma_deg": 0.2},
]


class SilentBus:
    """A car's bus that nobody else is on."""

    def send(self, frames: Iterable[Frame]) -> None:
        pass

    def receive(self) -> list[Frame]:
        return []

    def close(self) -> None:
        pass


@pytest.mark.parametrize("table", SPOKEN, ids=lambda table: Path(table["kind"]).name)
def test_the_simulated_vehicle_is_heard_by_the_receiver_of_its_rig(table: dict[str, Any]) -> None:
    """Its bytes over the receiver's wire, by the receiver's decoder: where the car stands, and how it points."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        table = {**table, "port": taken.getsockname()[1], **CAR}
    config = CarConfig(
        vehicles.parameters(noise=0.0), MapFrame(LOT), *PLACE, EPOCH, time.monotonic(), 7, receiver=table
    )
    kept = CarConfig.from_dict(json.loads(json.dumps(config.to_dict())))
    vehicle, receiver = SimulatedVehicle(kept, SilentBus(), TruthFile(None)), configured(table)
    source, decoder, fixes = receiver.open(no_bus), receiver.decoder(), list[Fix]()
    try:
        begun = time.monotonic()
        while len(fixes) < 20 and time.monotonic() < begun + 30.0:
            vehicle.step()
            for stamp, data in source.receive():
                fixes += decoder.feed(data, stamp)
    finally:
        vehicle.close()
        source.close()
    assert len(fixes) >= 20
    last = fixes[-1]
    assert last.quality is FixQuality.RTK_FIXED
    assert 0.0 < last.time - EPOCH < 60.0
    north, east = math.radians(PLACE[0]), math.radians(PLACE[1])
    # The receiver stands on the car, some metres from the rear axle.
    assert math.hypot(last.latitude - north, (last.longitude - east) * math.cos(north)) * EARTH_RADIUS < 5.0
    assert math.degrees(last.heading) == pytest.approx(90.0 - PLACE[2] + 360.0, abs=0.01)


def test_only_what_the_messages_hold_can_be_wrong_in_them() -> None:
    fault, parameters = InjectedFault("pose_minute_wrong", 1.0, 1.0), vehicles.parameters()
    toy = configured({"kind": f"{TOY}:make", "heading_sigma_deg": 0.2, **CAR})

    def car(receiver: Receiver) -> FaultInjectedCar:
        seeds = [np.random.SeedSequence(number) for number in (1, 2)]
        return FaultInjectedCar(
            parameters, (0.0, 0.0, 0.0), MapFrame(LOT), EPOCH, seeds[0], [fault], seeds[1], receiver=receiver
        )

    assert car(standard()).truth().speed == 0.0
    with pytest.raises(ConfigError, match="fault pose_minute_wrong: it cannot be injected: no message of the receiver"):
        car(toy)


def test_the_standard_receiver_speaks_as_it_always_did() -> None:
    """Byte for byte what the codec writes."""
    encoder, own = standard().encoder(), ncom.Encoder()
    assert encoder is not None
    for fix in drive(30):
        assert encoder.encode(fix) == own.encode(fix)


def test_no_module_beyond_the_port_imports_a_kind_of_receiver() -> None:
    """Beside, NCOM's codec is for wires, a bridge that hears them, recordings, and calibration, which asks for it."""
    kinds = "|".join(PORT.shipped)
    named = re.compile(rf"receivers\.({kinds})\b|receivers import ({kinds})\b")
    room = REPOSITORY / "vve_sumo"
    found = [file for file in room.rglob("*.py") if named.search(file.read_text(encoding="utf-8"))]
    assert {file.parent.name for file in found} <= {"receivers"}
    codec = re.compile(r"from vve_sumo\.pose(\.ncom)? import .*\b(ncom|Decoder|Encoder)\b")
    using = {file.relative_to(room).as_posix() for file in room.rglob("*.py") if codec.search(file.read_text("utf-8"))}
    assert {one.split("/")[0] for one in using} == {"pose", "wire", "commissioning", "bridges"}
