"""Load of the emulated radars' CAN buses: the scans of recorded drives, encoded, and the bits counted on the wire.

    python -m benchmarks.bus_load [RECORD...] [--smoke]

A data frame of n bytes with an 11-bit identifier has 44 + 8 n bits and the 3 of the space after it; of the first
34 + 8 n a stuffed bit follows every fifth equal one, at most (33 + 8 n) / 4 of them (Bosch, CAN specification 2.0, part
B; the bound: Nolte, Hansson and Norström, 2002). Worst is that bound, measured the bits of the frames themselves.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow.compute as pc

from tests.drive.street import drive_once
from tests.vehicles import FUSION
from vve_sumo.record.reader import read_table
from vve_sumo.values import Actors, Detections, Frame, Point, Pose
from vve_sumo.wire import ars408, esr
from vve_sumo.wire.outputs import KINDS, Context
from vve_sumo.wire.sample import Sample, SampleContent, no_fix

BITRATE = 500_000  # [bit/s]
PERIOD = 0.02  # of a tick [s]
#: bits of a frame that are never stuffed: delimiters, acknowledgement, end and the space after it
UNSTUFFED = 13
POLYNOMIAL = 0x4599  # of CAN's CRC-15
NOBODY = Actors.none(0.0)


def crc15(bits: Sequence[int]) -> int:
    """Return the checksum of bits as a CAN frame carries it."""
    checksum = 0
    for bit in bits:
        turned = bit ^ checksum >> 14
        checksum = checksum << 1 & 0x7FFF ^ (POLYNOMIAL if turned else 0)
    return checksum


def stuffed(frame: Frame) -> list[int]:
    """Return the bits of a frame that stuffing looks at, from its start to its checksum."""
    fields = [(frame.id, 11), (0, 3), (len(frame.data), 4), *((byte, 8) for byte in frame.data)]
    bits = [0] + [value >> place & 1 for value, width in fields for place in reversed(range(width))]
    checksum = crc15(bits)
    return bits + [checksum >> place & 1 for place in reversed(range(15))]


def on_the_wire(frame: Frame) -> int:
    """Return how many bits a frame takes, stuffed ones and the space after it included."""
    count, run, last = UNSTUFFED, 0, -1
    for bit in stuffed(frame):
        run = run + 1 if bit == last else 1
        count, last = count + 1, bit
        if run == 5:
            count, run, last = count + 1, 1, 1 - bit
    return count


def least(size: int) -> int:
    """Return the bits of a frame of so many bytes without a stuffed one."""
    return 47 + 8 * size


def worst(size: int) -> int:
    """Return the bits of a frame of so many bytes with as many stuffed ones as there can be."""
    return least(size) + (33 + 8 * size) // 4


def samples(folder: Path) -> Iterator[Sample]:
    """Yield what the outgoing wires get at every tick of a recorded drive, as far as the radars need it."""
    ticks = read_table(folder, "ticks")
    readings = read_table(folder, "readings").filter(pc.field("sensor") == "radar").to_pylist()
    made = {row["tick"]: row["measured_s"] for row in readings}
    seen = read_table(folder, "sensor_radar").to_pydict()
    rows: dict[int, list[int]] = {}
    for row, tick in enumerate(seen["tick"]):
        rows.setdefault(tick, []).append(row)
    scan = Detections(-1.0, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))
    columns = (ticks[name].to_pylist() for name in ("tick", "speed_mps", "yaw_rate_radps"))
    for tick, speed, yaw_rate in zip(*columns, strict=True):
        now = tick * PERIOD
        if tick in made:
            here = rows.get(tick, [])
            names = ("range_m", "azimuth_rad", "range_rate_mps")
            lists = (np.array([seen[name][row] for row in here]) for name in names)
            scan = Detections(made[tick], *lists, np.array([seen["mode"][row] for row in here], np.int8))
        if speed is None or not np.isfinite(speed):
            continue
        pose = Pose(now, Point.REAR_AXLE, 0.0, 0.0, 0.0, speed, 0.0, yaw_rate, 0.0, 0.0)
        yield Sample(tick, 1.4e9 + now, now, SampleContent(no_fix(now, now), pose, scan, now - scan.time, NOBODY))


def load(kind: str, drive: Sequence[Sample]) -> tuple[float, float]:
    """Return the share of the bus that a radar takes in a drive, and how many tracks or objects it sends at most."""
    output, bits, most = KINDS[kind].make(Context(FUSION.vehicle, "")), 0, 0
    for sample in drive:
        frames = [frame for frame in output.step(sample) if isinstance(frame, Frame)]
        bits += sum(map(on_the_wire, frames))
        of_esr = sum(esr.decode_track(frame) is not None for frame in frames)
        most = max(most, of_esr if kind == "esr" else sum(frame.id == ars408.GENERAL for frame in frames))
    return bits / (len(drive) * PERIOD * BITRATE), most


def main() -> None:
    """Print the computed bounds, and the load of each recorded drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("records", nargs="*", type=Path, metavar="RECORD")
    parser.add_argument("--smoke", action="store_true", help="with a short drive besides, only to see that it runs")
    asked = parser.parse_args()
    print_bounds()
    for folder in asked.records:
        print_load(folder)
    if asked.smoke:
        with tempfile.TemporaryDirectory() as scratch:
            drive_once({"duration_s": 2.0, "obstacles": [{"id": "parked_car", "at_m": 60.0}]}, f"{scratch}/short")
            print_load(Path(scratch) / "short")


def print_bounds() -> None:
    """Print between which shares of the bus each radar's frames lie."""
    cycle = [8] * (esr.TRACKS + 4) + [1]
    for name, sizes, rate in (
        ("ESR, 64 tracks and 5 more frames", cycle, 1.0 / esr.PERIOD),
        ("ESR's host, two messages", [8, 8], 50.0),
        *(
            (f"ARS408, {objects} objects", [len(f.data) for f in _ars408(objects)], 1.0 / ars408.PERIOD)
            for objects in (0, 10, 50, ars408.MAX_OBJECTS)
        ),
    ):
        bounds = [rate * sum(map(of, sizes)) / BITRATE for of in (least, worst)]
        print(f"{name:<36} {len(sizes):4d} frames  {bounds[0]:6.1%} to {bounds[1]:6.1%}")


def print_load(folder: Path) -> None:
    """Print the load of a recorded drive."""
    drive = list(samples(folder))
    for kind in ("esr", "ars408"):
        share, most = load(kind, drive)
        print(f"{folder.name:<28} {kind:<8} {share:6.1%}  at most {most} at once")


def _ars408(objects: int) -> tuple[Frame, ...]:
    one = ars408.Object(0, 50.0, 0.0, -5.0, 0.0, ars408.Motion.STATIONARY)
    return ars408.encode(ars408.ObjectList(0, (one,) * objects))


if __name__ == "__main__":
    main()
