"""The C header and its reader, compiled and run on our datagrams; what is not right or not new is refused."""

from __future__ import annotations

import contextlib
import math
import shutil
import socket
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.wire import datagrams
from vve_sumo.wire.datagrams import RadarDatagram, SetpointDatagram, Target
from vve_sumo.wire.signature import signed

BRAINS = REPOSITORY / "examples" / "brains"
CC = shutil.which("cc") or shutil.which("gcc")
pytestmark = [
    pytest.mark.skipif(CC is None, reason="needs a C compiler"),
    pytest.mark.skipif(sys.byteorder != "little", reason="the header is for little-endian machines"),
]

ROUND_TRIP = """
#include <stdio.h>
#include "vve_wire.h"
int main(void) {
    uint8_t data[2048];
    vve_radar radar;
    size_t length = fread(data, 1, sizeof data, stdin);
    if (!vve_read_radar(data, length, &radar)) return 1;
    vve_setpoint answer = {.time_s = radar.time_s, .steering_rad = radar.target[0].azimuth_rad,
                           .acceleration_mps2 = radar.target[0].range_rate_mps, .answers = radar.head.sequence};
    answer.head.sequence = 77;
    answer.head.lifetime_us = radar.head.lifetime_us;
    answer.head.flags = VVE_EMERGENCY;
    if (!vve_write_setpoint(data, &answer)) return 2;
    fwrite(data, 1, VVE_SETPOINT_LENGTH, stdout);
    return 0;
}
"""


def _compiled(source: Path, folder: Path) -> Path:
    program = folder / source.stem
    subprocess.run(
        [CC or "cc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", f"-I{BRAINS}", "-o", program, source, "-lm"],
        check=True,
    )
    return program


def _radar(sequence: int, *, valid: bool = True) -> bytes:
    targets = (Target(3, 31.5, 0.25, -8.5), Target(9, 60.0, -0.5, 2.0, 1))
    return datagrams.encode_radar(RadarDatagram(sequence, 1000.02, 0.08, 999.93, 8.5, 0.1, targets, valid=valid))


@pytest.fixture(scope="module")
def round_trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program that reads a radar datagram and writes a setpoint."""
    folder = tmp_path_factory.mktemp("c")
    (folder / "round_trip.c").write_text(ROUND_TRIP, encoding="utf-8")
    return _compiled(folder / "round_trip.c", folder)


def test_header_reads_and_writes_what_python_does(round_trip: Path) -> None:
    answer = subprocess.run([round_trip], input=_radar(42), capture_output=True, check=True).stdout
    assert datagrams.decode_setpoint(answer) == SetpointDatagram(77, 42, 1000.02, 0.08, 0.25, -8.5, emergency=True)
    torn = bytearray(_radar(42))
    torn[30] ^= 1
    assert subprocess.run([round_trip], input=bytes(torn), capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize("place", [16, 24, 32, 36, 48, 52, 56, 64, 68, 72])
@pytest.mark.parametrize("none", [math.nan, math.inf])
def test_header_refuses_a_number_that_is_none_wherever_it_is(place: int, none: float, round_trip: Path) -> None:
    body = bytearray(_radar(42)[:-4])
    form = "<d" if place < 32 else "<f"
    body[place : place + struct.calcsize(form)] = struct.pack(form, none)
    data = bytes(body) + struct.pack("<I", zlib.crc32(body))
    assert subprocess.run([round_trip], input=data, capture_output=True, check=False).returncode == 1


SIGNER = """
#include <string.h>
#include "vve_wire.h"
int main(int count, char **words) {
    uint8_t data[4096], key[VVE_KEY];
    if (count < 3 || !vve_read_key(words[2], key)) return 3;
    size_t length = fread(data, 1, sizeof data - VVE_TAG, stdin);
    length = strcmp(words[1], "sign") ? vve_without_tag(data, length, key) : vve_sign(data, length, key);
    fwrite(data, 1, length, stdout);
    return length == 0;
}
"""


@pytest.fixture(scope="module")
def signer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program that signs what it reads, or takes a signature off."""
    folder = tmp_path_factory.mktemp("c")
    (folder / "signer.c").write_text(SIGNER, encoding="utf-8")
    return _compiled(folder / "signer.c", folder)


def _signer(program: Path, what: str, key: Path, data: bytes) -> bytes | None:
    done = subprocess.run([program, what, key], input=data, capture_output=True, check=False)
    assert done.returncode in (0, 1)
    return done.stdout if done.returncode == 0 else None


def test_header_signs_and_checks_as_python_does(signer: Path, tmp_path: Path) -> None:
    chance = Random(5)
    for length in (1, 43, 44, 52, 55, 56, 57, 63, 64, 65, 119, 120, 127, 128, 1000, 1076):
        key, data = chance.randbytes(32), chance.randbytes(length)
        (tmp_path / "key").write_text(key.hex() + "\n", encoding="ascii")
        tagged = signed(data, key)
        assert _signer(signer, "sign", tmp_path / "key", data) == tagged
        assert _signer(signer, "check", tmp_path / "key", tagged) == data
        bit = chance.randrange(8 * len(tagged))
        forged = bytearray(tagged)
        forged[bit // 8] ^= 1 << bit % 8
        for other in (bytes(forged), tagged[:-1], data, signed(data, chance.randbytes(32))):
            assert _signer(signer, "check", tmp_path / "key", other) is None
    (tmp_path / "key").write_text("12 34", encoding="ascii")
    assert subprocess.run([signer, "sign", tmp_path / "key"], input=b"", check=False).returncode == 3


@contextlib.contextmanager
def _reader(program: Path) -> Iterator[tuple[subprocess.Popen[str], tuple[str, int]]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        place = probe.getsockname()
    with subprocess.Popen([program, str(place[1])], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process, place
        finally:
            process.kill()


def test_reader_uses_what_is_valid_and_new_alone(tmp_path: Path) -> None:
    with (
        _reader(_compiled(BRAINS / "print_radar.c", tmp_path)) as (process, place),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end,
    ):
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        first = ""
        while not first:  # until the program has bound its port, datagrams are lost
            with contextlib.suppress(ConnectionRefusedError):
                end.connect(place)
                end.send(_radar(1))
                end.settimeout(0.02)
                with contextlib.suppress(TimeoutError):
                    end.recv(1)
                first = next(lines)
        assert first == "1 1000.020 s, scan 0.090 s old, 8.50 m/s: " + (
            "[3] 31.5 m 0.250 rad -8.50 m/s [9] 60.0 m -0.500 rad 2.00 m/s\n"
        )
        for data in (_radar(2), _radar(2), _radar(1), _radar(3, valid=False), _radar(4)[:-1]):
            end.send(data)
        heard = [next(lines).split()[0:2] for _ in range(6)]
        assert heard[0][0] == "2"
        assert heard[1:] == [
            ["refused:", "not"],
            ["refused:", "not"],
            ["3", "invalid"],
            ["refused:", "not"],
            ["silent:", "no"],
        ]
