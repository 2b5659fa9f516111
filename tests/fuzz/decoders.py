"""Random bytes, and messages spoilt at random, against everything that decodes.

A run is 1000 inputs to one decoder: NCOM, NMEA 0183, OXTS CAN, UBX, SBF and NovAtel's logs with the trust gate behind
them, the drive-by-wire codec, and the link's setpoints, acts and feedback. Inputs are valid, cut short, run together,
changed in some bytes, with something in between, or random from the first byte. Invariants, at every input:

 1. No exception, whatever comes in.
 2. A decoder of fixes holds less than one message of the bytes that it was fed (72 of NCOM, 256 of NMEA, 4100 of UBX,
    SBF and NovAtel's logs); every byte of NCOM and every OXTS frame is counted once; an input takes less than a second
    of processor time on average.
 3. A fix has a finite time, position and time of arrival, latitude within 90 degrees, longitude within 360, heading
    within 180 or NaN; what is not known is NaN, nothing is infinite. Times increase strictly, but where the sender's
    clock was set back, which shows by more than half a minute.
 4. A fix that the trust gate lets through has everything finite that a drive reads of it.
 5. The drive-by-wire codec gives None for an unknown identifier and for no other, `Malformed` for every wrong length,
    and never an infinite number; NaN stands only where the wire has a pattern for "invalid". Encoding a decoded report
    and decoding that gives the same report.
 6. A link message with a wrong checksum is never taken; one that is taken says the same after it is encoded and decoded
    again; what was encoded is decoded bit for bit.
"""

from __future__ import annotations

import math
import random
import struct
import time
import zlib
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, Final

from tests.fixes import GOOD
from tests.fuzz.invariant import Violation, hold
from vve_sumo.messages import MalformedMessage
from vve_sumo.pose import ncom, nmea, novatel, novatel_encoder, oxts_can, sbf, sbf_encoder, ubx, ubx_encoder
from vve_sumo.pose.stream import MessageCutter
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import ArmingState, FallbackPath, Fix, FixQuality, Frame, GatewayStatus, Setpoint
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec

INPUTS: Final = 1000  # of a run
PATIENCE: Final = 1.0  # processor time of one input [s]
ODD: Final = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1e-300, 1.7e308, -1e9, 0.1)
NUMBERS: Final = tuple(field.name for field in fields(Fix) if field.name not in ("locked", "quality"))
READ: Final = (
    "time",
    "latitude",
    "longitude",
    "heading",
    "velocity_north",
    "velocity_east",
    "yaw_rate",
    "acceleration",
)
#: Fields of reports whose wire form has a pattern for "invalid".
MAY_BE_NAN: Final = {
    "wheel_angle", "command", "speed", "torque", "front_left", "front_right", "rear_left", "rear_right", "longitudinal",
    "lateral", "vertical", "roll", "yaw", "torque_requested", "torque_actual", "acceleration_over_ground",
}  # fmt: skip
#: bytes at the ends of a message that stay: what marks it, and its checksum
HEADS: Final = {ubx: 6, sbf: 8, novatel: 12}
TAILS: Final = {ubx: 2, sbf: 0, novatel: 4}
LEAST: Final = str(-1 << 63)  # is sent as the number next to it: a count that low is no count
REPORTS: Final = (0x061, 0x063, 0x065, 0x067, 0x06A, 0x06B, 0x06C, 0x074)
LENGTHS: Final = {
    0x060: 8, 0x061: 8, 0x062: 8, 0x063: 8, 0x064: 8, 0x065: 8, 0x066: 1, 0x067: 2, 0x06A: 8, 0x06B: 6, 0x06C: 4,
    0x074: 8,
}  # fmt: skip


def _spoilt(chance: random.Random, data: bytes, others: bytes) -> bytes:
    """`data` as it may arrive."""
    kind = chance.randrange(7)
    changed = bytearray(data)
    if kind == 0 or not data:
        return data
    if kind == 1:
        return data[: chance.randrange(len(data) + 1)]
    if kind == 2:
        return data + others
    if kind == 3:
        for _ in range(chance.choice((1, 1, 2, 8))):
            changed[chance.randrange(len(changed))] = chance.getrandbits(8)
        return bytes(changed)
    if kind == 4:
        changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
        return bytes(changed)
    if kind == 5:
        place = chance.randrange(len(data) + 1)
        return data[:place] + chance.randbytes(chance.randrange(20)) + data[place:]
    return chance.randbytes(chance.randrange(200))


def _number(chance: random.Random, span: float) -> float:
    return chance.choice(ODD) if chance.random() < 0.03 else chance.uniform(-span, span)


# Fixes.


def _fix(chance: random.Random, now: float) -> Fix:
    return replace(
        GOOD,
        time=1_460_000_000.0 + now,
        time_received=now,
        latitude=chance.uniform(-1.57, 1.57),
        longitude=chance.uniform(-3.14, 3.14),
        altitude=chance.uniform(-100.0, 5000.0),
        heading=chance.uniform(-3.14, 3.14),
        pitch=chance.uniform(-0.3, 0.3),
        roll=chance.uniform(-0.3, 0.3),
        velocity_north=chance.uniform(-30.0, 30.0),
        velocity_east=chance.uniform(-30.0, 30.0),
        yaw_rate=chance.uniform(-2.0, 2.0),
        acceleration=chance.uniform(-9.0, 9.0),
        quality=chance.choice((FixQuality.RTK_FIXED, FixQuality.RTK_FLOAT)),
        position_sigma=0.02,
    )


class _Gate:
    """Judges what a decoder gave, and hands it to the trust gate."""

    def __init__(self) -> None:
        self._gate = TrustGate(DRIVE, 1_460_000_000.0)
        self._last = -math.inf

    def judge(self, now: float, given: list[Fix]) -> None:
        for fix in given:
            hold(3, all(not math.isinf(getattr(fix, name)) for name in NUMBERS), fix)
            hold(3, math.isfinite(fix.time + fix.latitude + fix.longitude) and fix.time_received == now, fix)
            hold(3, abs(fix.latitude) <= math.pi / 2 and abs(fix.longitude) <= math.tau, fix)
            hold(3, not abs(fix.heading) > math.pi + 1e-9, fix)
            hold(3, fix.time > self._last or fix.time < self._last - 30.0, (self._last, fix))
            self._last = fix.time
            if self._gate.step(now, fix).trusted:
                hold(4, all(math.isfinite(getattr(fix, name)) for name in READ), fix)


def _ncom(chance: random.Random, reported: list[object]) -> None:
    decoder, encoder, gate = ncom.Decoder(), ncom.Encoder(), _Gate()
    fed, now = 0, 0.0
    for _ in range(INPUTS):
        now += 0.01
        packet = encoder.encode(_fix(chance, now))
        if chance.random() < 0.3:
            packet = _resealed(chance, packet)
        data = _spoilt(chance, packet, packet[:-1] if chance.random() < 0.5 else b"\xe7" * 100)
        reported[:] = [now, data]
        fed += len(data)
        gate.judge(now, decoder.feed(data, now))
        hold(2, 0 <= fed - ncom.LENGTH * decoder.packets - decoder.discarded < ncom.LENGTH, decoder.counts)


def _resealed(chance: random.Random, packet: bytes) -> bytes:
    """The same with changed contents under right checksums."""
    changed = bytearray(packet)
    for _ in range(chance.choice((1, 4, 60))):
        changed[chance.randrange(1, 71)] = chance.getrandbits(8)
    if chance.random() < 0.3:
        changed[23:39] = struct.pack("<dd", chance.choice(ODD), chance.choice(ODD))
    for end in (22, 61, 71):
        changed[end] = sum(changed[1:end]) & 255
    return bytes(changed)


def _nmea(chance: random.Random, reported: list[object]) -> None:
    decoder, gate = nmea.Decoder(velocity_sigma=0.05, heading_sigma=0.005), _Gate()
    now = 0.0
    for number in range(INPUTS):
        if number % 5 == 0:
            now += 0.1
        body = _sentence(chance, number % 5, now)
        data = f"${body}*{_xor(body.encode()):02X}\r\n".encode()
        if chance.random() < 0.7:
            data = _spoilt(chance, data, b"$GPGGA,")
        reported[:] = [now, data]
        gate.judge(now, decoder.feed(data, now))
        hold(2, len(decoder._buffer) < 256, decoder._buffer)


def _xor(data: bytes) -> int:
    total = 0
    for byte in data:
        total ^= byte
    return total


def _sentence(chance: random.Random, kind: int, now: float) -> str:
    clock = f"{12 + int(now // 3600) % 12:02d}{int(now // 60) % 60:02d}{now % 60.0:05.2f}"
    parts = (
        ["GPRMC", clock, "A", "3959.883", "N", "08258.99", "W", "19.4", "65.0", "221126", "", "", "R", "V"],
        ["GPGGA", clock, "3959.8830", "N", "08258.9926", "W", "4", "14", "0.7", "231.4", "M", "-33.9", "M", "1.2", "1"],
        ["GPGST", clock, "1.1", "0.01", "0.01", "12.0", "0.011", "0.014", "0.02"],
        ["GPHDT", f"{chance.uniform(0.0, 360.0):.2f}", "T"],
        ["GPVTG", "65.0", "T", "", "M", "19.4", "N", "36.0", "K", "R"],
    )[kind]
    if chance.random() < 0.2:
        odd = ("", "nan", "inf", "-1", "1e999", "999999999999", "x", "\x00", "6000.0", "-0", "9" * 200, "1_0", "24")
        parts[chance.randrange(1, len(parts))] = chance.choice(odd)
    if chance.random() < 0.02:
        parts = [
            "PASHR",
            clock,
            "65.0",
            "T",
            "0.1",
            "0.2",
            "0.0",
            "0.02",
            "0.02",
            chance.choice(("0.08", "inf", "")),
            "2",
            "1",
        ]
    if chance.random() < 0.02:
        del parts[chance.randrange(1, len(parts)) :]
    return ",".join(parts)


def _oxts_can(chance: random.Random, reported: list[object]) -> None:
    decoder, encoder, gate = oxts_can.Decoder(), oxts_can.Encoder(), _Gate()
    fed, now = 0, 0.0
    waiting: list[Frame] = []
    for _ in range(INPUTS):
        if not waiting:
            now += 0.01
            waiting = list(encoder.encode(_fix(chance, now)))
        frame = waiting.pop(0)
        if chance.random() < 0.05:
            identifier = chance.choice((frame.id, 0x600 + chance.randrange(0x31), 0x500 + chance.randrange(256), 0x7FF))
            frame = Frame(identifier, chance.randbytes(chance.randrange(9)))
        elif chance.random() < 0.02:
            continue
        reported[:] = [now, frame]
        fed += 1
        gate.judge(now, decoder.feed_frames([frame], now))
        hold(2, sum(decoder.counts.values()) + decoder.discarded == fed, decoder.counts)


def _streams(chance: random.Random, reported: list[object]) -> None:
    module, encoder = chance.choice(
        ((ubx, ubx_encoder.Encoder()), (sbf, sbf_encoder.Encoder()), (novatel, novatel_encoder.Encoder()))
    )
    decoder, gate, now = module.Decoder(), _Gate(), 0.0
    for _ in range(INPUTS):
        now += 0.01
        messages = encoder.encode(_fix(chance, now))
        if chance.random() < 0.3:
            messages = _resealed_stream(chance, module, messages)
        data = _spoilt(chance, messages, messages[:-1]) if chance.random() < 0.5 else messages
        reported[:] = [module.__name__, now, data]
        gate.judge(now, decoder.feed(data, now))
        hold(2, decoder.held < 4100, decoder.held)


def _resealed_stream(chance: random.Random, module: Any, messages: bytes) -> bytes:
    """The same messages with changed contents under right checksums."""
    changed = []
    for message in MessageCutter(module.FRAMING).cut(messages):
        content = bytearray(message)
        for _ in range(chance.choice((1, 4, 30))):
            content[chance.randrange(HEADS[module], len(content) - TAILS[module])] = chance.getrandbits(8)
        if module is ubx:
            content[-2:] = ubx.checksum(bytes(content[2:-2]))
        elif module is sbf:
            content[2:4] = sbf.checksum(bytes(content[4:])).to_bytes(2, "little")
        else:
            content[-4:] = novatel.checksum(bytes(content[:-4])).to_bytes(4, "little")
        changed.append(bytes(content))
    return b"".join(changed)


# The drive-by-wire codec.


def _dbw(chance: random.Random, reported: list[object]) -> None:
    variants = tuple(codec.Variant)
    for _ in range(INPUTS):
        identifier = chance.choice(tuple(LENGTHS)) if chance.random() < 0.9 else chance.randrange(0x800)
        length = LENGTHS.get(identifier, 8) if chance.random() < 0.9 else chance.randrange(65)
        frame, variant = Frame(identifier, chance.randbytes(length)), chance.choice(variants)
        reported[:] = [frame, variant]
        message = codec.decode(frame, variant)
        hold(5, (message is None) == (identifier not in LENGTHS), message)
        if message is None:
            continue
        malformed = isinstance(message, codec.Malformed)
        clear_alone = identifier in (0x060, 0x062, 0x064) and length == 4
        hold(5, length == LENGTHS[identifier] or clear_alone or malformed, message)
        if malformed:
            continue
        for name in message._fields:
            value = getattr(message, name)
            if isinstance(value, float):
                hold(5, math.isfinite(value) or (value != value and name in MAY_BE_NAN), message)
        if identifier in REPORTS:
            again = codec.decode(codec.encode(message, variant), variant)
            hold(5, repr(again) == repr(message), (message, again))


# The link.


def _setpoint(chance: random.Random) -> Setpoint:
    numbers = [_number(chance, 100.0) for _ in range(10)]
    knots = tuple(_number(chance, 1.0) for _ in range(chance.choice((0, 1, 30, 65))))
    return Setpoint(
        numbers[0], numbers[1], chance.random() < 0.5, _text(chance), chance.choice((0, -1, 7, (1 << 63) - 1)),
        *numbers[2:9], numbers[9], tuple(_text(chance) for _ in range(chance.choice((0, 0, 1, 64)))),
        None if chance.random() < 0.5 else FallbackPath(_number(chance, 2.0), knots),
    )  # fmt: skip


def _text(chance: random.Random) -> str:
    return "".join(chance.choices("ab_\u00e9\u4e2d\ud800\x00", k=chance.choice((0, 1, 5, 60))))


def _feedback(chance: random.Random) -> link.Feedback:
    numbers = [_number(chance, 100.0) for _ in range(8)]
    codes = tuple(_text(chance) for _ in range(chance.choice((0, 1, 5))))
    verdict = GatewayStatus(chance.choice(tuple(ArmingState)), codes, *numbers[:2], codes[:1], *numbers[2:4])
    return link.Feedback(numbers[4], chance.randrange(1 << 40), numbers[5], verdict, *numbers[6:8], _text(chance), 12)


def _links(chance: random.Random, reported: list[object]) -> None:
    kinds: tuple[tuple[Callable[[bytes], Any], Callable[[Any], bytes], Callable[[random.Random], Any]], ...] = (
        (link.decode_setpoint, link.encode_setpoint, _setpoint),
        (link.decode_operator_command, link.encode_operator_command, lambda one: one.choice(tuple(OperatorCommand))),
        (link.decode_feedback, link.encode_feedback, _feedback),
    )
    for _ in range(INPUTS):
        decode, encode, made = chance.choice(kinds)
        message = made(chance)
        data = encode(message)
        reported[:] = [message, data]
        hold(6, repr(decode(data)) == repr(message).replace(r"\ud800", "?"), (message, decode(data)))
        spoilt = _spoilt(chance, data, data)
        if chance.random() < 0.7 and len(spoilt) > 4:
            spoilt = spoilt[:-4] + struct.pack("<I", zlib.crc32(spoilt[:-4]))
        reported[:] = [message, spoilt]
        taken = decode(spoilt)
        if isinstance(taken, MalformedMessage):
            continue
        hold(6, len(spoilt) > 4 and struct.unpack("<I", spoilt[-4:])[0] == zlib.crc32(spoilt[:-4]), taken)
        if LEAST not in repr(taken):
            hold(6, repr(decode(encode(taken))) == repr(taken), taken)


DECODERS: Final = (_ncom, _nmea, _oxts_can, _dbw, _links, _streams)


def run(seed: int) -> int:
    """Try one decoder; how many inputs that were. Raises Violation, which says where."""
    chance = random.Random(f"decoders {seed}")
    fuzz = DECODERS[seed % len(DECODERS)]
    reported: list[object] = []
    begun = time.process_time()
    try:
        fuzz(chance, reported)
        hold(2, time.process_time() - begun < INPUTS * PATIENCE, "time")
    except Violation as violation:
        raise Violation(f"invariant {violation}\n  seed {seed}, {fuzz.__name__[1:]}, input {reported}") from violation
    except Exception as error:
        raise Violation(
            f"invariant 1: {type(error).__name__}: {error}\n  seed {seed}, {fuzz.__name__[1:]}, input {reported}"
        ) from error
    return INPUTS
