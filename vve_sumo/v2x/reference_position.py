"""Where a station or an event is: WGS84 latitude and longitude, and the ellipse that it is in, as messages carry them.

Degrees and not radians, because the wire counts tenths of a microdegree. Altitudes are sent as unavailable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vve_sumo.frozen import fast_frozen
from vve_sumo.v2x.data_elements import SEMI_AXIS, heading_count, heading_of, rounded_heading
from vve_sumo.v2x.decode_error import MessageDecodeError

STEPS: Final = 1e7  #: counts of latitude and longitude in a degree
NO_LATITUDE: Final = 900_000_001
NO_LONGITUDE: Final = 1_800_000_001
_UNUSED_LONGITUDE: Final = -1_800_000_000  #: the standard has it as 180 degrees east
#: the content of an altitude that is unavailable
_NO_ALTITUDE: Final = {"altitudeValue": 800_001, "altitudeConfidence": 15}

#: names of the ellipse's fields in a ReferencePositionWithConfidence, which is the same on the wire as ...
AXIS_LENGTHS: Final = ("semiMajorAxisLength", "semiMinorAxisLength", "semiMajorAxisOrientation")
#: ... a ReferencePosition
CONFIDENCES: Final = ("semiMajorConfidence", "semiMinorConfidence", "semiMajorOrientation")


@fast_frozen
@dataclass(frozen=True, slots=True)
class ConfidenceEllipse:
    """In which the true position is with a probability of 95 %; None is unavailable."""

    semi_major: float | None = None  #: half of the longer axis [m], at most 40.93; more is read as 40.94
    semi_minor: float | None = None  #: half of the shorter axis [m], likewise
    orientation: float | None = None  #: of the longer axis [rad], counter-clockwise from true east


_NO_ELLIPSE: Final = ConfidenceEllipse()


class Position(NamedTuple):
    """A position as a receiver reads it."""

    latitude_deg: float
    longitude_deg: float
    ellipse: ConfidenceEllipse | None  #: None where all of it is unavailable


def latitude_count(latitude_deg: float) -> int:
    """Return the count of a latitude [degree]; raises ValueError for one that is not on the earth."""
    if not -90.0 <= latitude_deg <= 90.0:
        raise ValueError(f"latitude: expected -90 to 90 degrees, got {latitude_deg}")
    return round(latitude_deg * STEPS)


def longitude_count(longitude_deg: float) -> int:
    """Return the count of a longitude [degree]; raises ValueError for one that is not on the earth."""
    if not -180.0 <= longitude_deg <= 180.0:
        raise ValueError(f"longitude: expected -180 to 180 degrees, got {longitude_deg}")
    count = round(longitude_deg * STEPS)
    return -count if count == _UNUSED_LONGITUDE else count


def position_content(
    latitude_deg: float, longitude_deg: float, ellipse: ConfidenceEllipse | None, names: tuple[str, str, str]
) -> dict[str, Any]:
    """Return the content of a position whose ellipse has `AXIS_LENGTHS` or `CONFIDENCES`.

    Raises ValueError for numbers that are not finite and places that are not on the earth.
    """
    of = ellipse or _NO_ELLIPSE
    counts = SEMI_AXIS.count(of.semi_major), SEMI_AXIS.count(of.semi_minor), heading_count(of.orientation)
    return {
        "latitude": latitude_count(latitude_deg),
        "longitude": longitude_count(longitude_deg),
        "positionConfidenceEllipse": dict(zip(names, counts, strict=True)),
        "altitude": _NO_ALTITUDE,
    }


def position_of(content: dict[str, Any], names: tuple[str, str, str]) -> Position:
    """Return the position of a content.

    Raises MessageDecodeError where it is unavailable: no receiver can place what the message is about.
    """
    latitude, longitude = content["latitude"], content["longitude"]
    if latitude == NO_LATITUDE or longitude == NO_LONGITUDE:
        raise MessageDecodeError("the position is unavailable")
    major, minor, orientation = (content["positionConfidenceEllipse"][name] for name in names)
    ellipse = _ellipse(SEMI_AXIS.value(major), SEMI_AXIS.value(minor), heading_of(orientation))
    return Position(latitude / STEPS, longitude / STEPS, ellipse)


def rounded_position(latitude_deg: float, longitude_deg: float, ellipse: ConfidenceEllipse | None) -> Position:
    """Return what a receiver reads of a position; raises ValueError as `position_content` does."""
    read = ellipse and _ellipse(
        SEMI_AXIS.rounded(ellipse.semi_major),
        SEMI_AXIS.rounded(ellipse.semi_minor),
        rounded_heading(ellipse.orientation),
    )
    return Position(latitude_count(latitude_deg) / STEPS, longitude_count(longitude_deg) / STEPS, read)


def _ellipse(major: float | None, minor: float | None, orientation: float | None) -> ConfidenceEllipse | None:
    if major is None and minor is None and orientation is None:
        return None
    return ConfidenceEllipse(major, minor, orientation)
