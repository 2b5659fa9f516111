"""NMEA sentences, built by pynmea2 and by hand, and a drive of them."""

from __future__ import annotations

import datetime
import math

import pynmea2

from vve_sumo.pose.nmea import Decoder
from vve_sumo.values import Fix

MIDNIGHT = datetime.datetime(2026, 11, 21, tzinfo=datetime.UTC)
#: 2026-11-21 00:00:00 UTC in GPS seconds: 17121 days since 1980-01-06, and 18 leap seconds
MIDNIGHT_GPS = 17_121 * 86_400 + 18
NOON = 12 * 3600.0
PERIOD = 0.1
#: what follows the time in a GGA sentence
POSITION = "3959.8830000,N,08258.9926000,W,4,14,0.7,231.4,M,-33.9,M,1.0,0001"


def sealed(body: str) -> bytes:
    """The sentence of `body`, with the checksum by its definition: exclusive or of what is between $ and *."""
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def clock_text(seconds: float) -> str:
    time = MIDNIGHT + datetime.timedelta(seconds=round(seconds, 3))
    return time.strftime("%H%M%S.") + f"{time.microsecond // 10_000:02d}"


def gga(seconds=NOON, latitude=39.99805, longitude=-82.98321, quality=4, age="1.2") -> bytes:
    def degrees_minutes(angle: float, digits: int) -> str:
        whole = int(abs(angle))
        return f"{whole:0{digits}d}{(abs(angle) - whole) * 60:010.7f}"

    fields = (clock_text(seconds), degrees_minutes(latitude, 2), "N" if latitude >= 0 else "S")
    fields += (degrees_minutes(longitude, 3), "E" if longitude >= 0 else "W", str(quality))
    return f"{pynmea2.GGA('GP', 'GGA', (*fields, '14', '0.7', '231.4', 'M', '-33.9', 'M', age, '0001'))}\r\n".encode()


def gst(seconds=NOON, latitude="0.011", longitude="0.014") -> bytes:
    fields = (clock_text(seconds), "1.1", "0.01", "0.01", "12.0", latitude, longitude, "0.02")
    return f"{pynmea2.GST('GP', 'GST', fields)}\r\n".encode()


def hdt(compass=65.0) -> bytes:
    return f"{pynmea2.HDT('GP', 'HDT', (f'{compass % 360:.3f}', 'T'))}\r\n".encode()


def ths(compass: float | str = 65.0, status="A") -> bytes:
    heading = compass if isinstance(compass, str) else f"{compass % 360:.3f}"
    return sealed(f"GPTHS,{heading},{status}")


def vtg(course: float | None = 65.0, speed=10.0) -> bytes:
    track = "" if course is None else f"{course % 360:.3f}"
    fields = (track, "T", "", "M", f"{speed * 3600 / 1852:.4f}", "N", f"{speed * 3.6:.4f}", "K", "R")
    return f"{pynmea2.VTG('GP', 'VTG', fields)}\r\n".encode()


def rmc(seconds=NOON, course=65.0, speed=10.0, status="A", date: str | None = None) -> bytes:
    day = date or (MIDNIGHT + datetime.timedelta(seconds=seconds)).strftime("%d%m%y")
    head = f"GNRMC,{clock_text(seconds)},{status},3959.8830,N,08258.9926,W"
    return sealed(f"{head},{speed * 3600 / 1852:.4f},{course:.3f},{day},,,R,V")


def zda(seconds=NOON) -> bytes:
    day = MIDNIGHT + datetime.timedelta(seconds=seconds)
    return sealed(f"GPZDA,{clock_text(seconds)},{day:%d},{day:%m},{day:%Y},00,00")


def pashr(seconds=NOON, compass=65.0, pitch=1.5, roll=-0.4, sigma=0.08, quality=2) -> bytes:
    body = f"PASHR,{clock_text(seconds)}0,{compass % 360:.2f},T,{roll:+.2f},{pitch:+.2f},+0.00"
    return sealed(f"{body},0.020,0.020,{sigma:.3f},{quality},1")


def epoch(seconds: float, **changes) -> list[bytes]:
    """What a receiver sends for one time, along an easterly road at 10 m/s."""
    moved = (seconds - NOON) * 10.0 * math.sin(math.radians(65.0)) / (111_195.0 * math.cos(math.radians(39.99805)))
    north = (seconds - NOON) * 10.0 * math.cos(math.radians(65.0)) / 111_195.0
    where = {"latitude": 39.99805 + north, "longitude": -82.98321 + moved} | changes
    return [gga(seconds, **where), gst(seconds), hdt(), vtg()]


def drive(count: int, start: float = NOON) -> list[tuple[float, bytes]]:
    """Rows of arrival and sentence, 30 ms on the wire for each epoch."""
    rows = [(start - PERIOD, rmc(start - PERIOD)), (start - PERIOD, gga(start - PERIOD))]
    for k in range(count):
        seconds = start + k * PERIOD
        rows += [(seconds + 0.01 * n, sentence) for n, sentence in enumerate(epoch(seconds))]
    return rows


def decoder() -> Decoder:
    return Decoder(velocity_sigma=0.05, heading_sigma=0.004)


def fed(rows, to: Decoder | None = None) -> list[Fix]:
    to = to or decoder()
    return [fix for received, data in rows for fix in to.feed(data, received)]
