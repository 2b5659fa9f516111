"""The least that a brain is: the radar datagram in, a setpoint out; nothing but Python is needed, so copy it.

    python minimal.py [RADAR_PORT SETPOINT_PORT [KEY_FILE]]

It drives straight on at 5 m/s and brakes for whatever the radar sees within 20 m ahead.
"""

import hashlib
import hmac
import math
import socket
import struct
import sys
import zlib
from pathlib import Path

HEAD, RADAR, TARGET, ANSWER = struct.Struct("<4sBBHII"), struct.Struct("<ddffII"), "<fffHBB", struct.Struct("<dffII")
MAX_SCAN_AGE = 0.3  # [s]
hears, answers = (int(port) for port in sys.argv[1:3] or ("5002", "5003"))
key = bytes.fromhex(Path(sys.argv[3]).read_text()) if len(sys.argv) > 3 else b""


def tag(body: bytes) -> bytes:
    """Return what a signed datagram ends in; nothing without a key."""
    return hmac.new(key, body, hashlib.sha256).digest()[:16] if key else b""


wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.bind(("127.0.0.1", hears))
newest = -1
while True:
    data = wire.recv(2048)
    if key:
        data, signature = data[:-16], data[-16:]
        if not hmac.compare_digest(tag(data), signature):
            continue  # not from who has the key
    if len(data) < 52 or zlib.crc32(data[:-4]) != int.from_bytes(data[-4:], "little"):
        continue  # torn
    magic, version, kind, flags, sequence, _lifetime = HEAD.unpack_from(data)
    if (magic, version, kind) != (b"VVES", 1, 1) or not flags & 1 or sequence <= newest:
        continue  # another datagram, an invalid one, or an old one: no answer, and the gateway stops the car
    newest = sequence
    time, measured, speed, yaw_rate, count, _ = RADAR.unpack_from(data, HEAD.size)
    if not -0.001 < time - measured <= MAX_SCAN_AGE:
        continue  # an old scan under a new time
    targets = list(struct.iter_unpack(TARGET, data[48:-4]))  # range, azimuth, range rate, number, mode, 0
    if not all(map(math.isfinite, (time, measured, speed, *(x for t in targets for x in t[:3])))):
        continue  # a comparison with what is not a number is never true: such a target would not be braked for
    ahead = min((t[0] for t in targets if abs(t[0] * math.sin(t[1])) < 1.5), default=math.inf)
    acceleration = -3.0 if ahead < 20.0 else max(-1.0, min(1.0, 5.0 - speed))
    body = HEAD.pack(b"VVES", 1, 2, 0, sequence, 100_000) + ANSWER.pack(time, 0.0, acceleration, sequence, 0)
    body += struct.pack("<I", zlib.crc32(body))
    wire.sendto(body + tag(body), ("127.0.0.1", answers))
