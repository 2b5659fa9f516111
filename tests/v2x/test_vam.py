"""The VAM: a second compiler of the same ASN.1 reads what was encoded, a receiver `rounded`; other bytes are refused.

No decoder of this release of the VAM was found that is independent of the ASN.1 files shipped here: pycrate's own
modules are of release 1, tshark 4.0 has none. Two encoders of the same files agree; that the files are those of the
standard, and the meaning of each field, remain unchecked by other programs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.v2x.packets import spoilt
from tests.v2x.pycrate_release2 import read_and_made_again
from vve_sumo.v2x import vam
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.vam import Environment, Profile, SizeClass, Vam

NOW = 700_000_000_000
CYCLIST = Vam(
    5, StationType.CYCLIST, NOW, 40.0, -83.0, ConfidenceEllipse(1.0, 0.9, 0.2), 1.0, 4.4, 0.3, 0.1,
    Environment.ZEBRA_CROSSING, Profile.BICYCLIST_AND_LIGHT_VRU_VEHICLE, 7, SizeClass.MEDIUM,
)  # fmt: skip
PEDESTRIAN = Vam(6, StationType.PEDESTRIAN, NOW, 40.0, -83.0, heading=1.0, speed=1.3)
CHOICES = ("pedestrian", "bicyclistAndLightVruVehicle", "motorcyclist", "animal")


def drawn(random: Random) -> tuple[Vam, dict[str, Any]]:
    """A message, and the content of counts that stands for it on the wire, of which its quantities are made."""
    latitude, longitude = random.randint(-900_000_000, 900_000_000), random.randint(-1_799_999_999, 1_800_000_000)
    station, kind, time_ms = random.getrandbits(32), random.randrange(16), random.getrandbits(41)
    heading, speed = random.choice((3601, random.randrange(3600))), random.choice((16_383, random.randrange(16_383)))
    acceleration, yaw_rate = random.randint(-160, 160), random.choice((None, random.randint(-32_766, 32_766)))
    environment, profile, sub_profile = random.randrange(6), random.choice((None, 1, 2, 3, 4)), random.randrange(16)
    size = random.randrange(4)
    motion: dict[str, Any] = {
        "heading": {"value": heading, "confidence": 127},
        "speed": {"speedValue": speed, "speedConfidence": 127},
        "longitudinalAcceleration": {
            "longitudinalAccelerationValue": acceleration, "longitudinalAccelerationConfidence": 102,
        },
    }  # fmt: skip
    if yaw_rate is not None:
        motion["yawRate"] = {"yawRateValue": yaw_rate, "yawRateConfidence": "unavailable"}
    if environment:
        motion["environment"] = environment
    message = Vam(
        station, StationType(kind), time_ms, latitude / 1e7, longitude / 1e7, None,
        None if heading == 3601 else math.radians(90.0 - heading / 10.0),
        None if speed == 16_383 else speed * 0.01, acceleration * 0.1,
        None if yaw_rate is None else math.radians(yaw_rate * 0.01), Environment(environment),
    )  # fmt: skip
    place = {
        "latitude": latitude, "longitude": longitude,
        "positionConfidenceEllipse": {
            "semiMajorAxisLength": 4095, "semiMinorAxisLength": 4095, "semiMajorAxisOrientation": 3601,
        },
        "altitude": {"altitudeValue": 800_001, "altitudeConfidence": "unavailable"},
    }  # fmt: skip
    parameters = {
        "basicContainer": {"stationType": kind, "referencePosition": place},
        "vruHighFrequencyContainer": motion,
    }
    if profile is not None:
        message = replace(message, profile=Profile(profile), sub_profile=sub_profile, size_class=SizeClass(size))
        low: dict[str, Any] = {"profileAndSubprofile": (CHOICES[profile - 1], sub_profile)}
        parameters["vruLowFrequencyContainer"] = low | ({"sizeClass": size} if size else {})
    body = {"generationDeltaTime": time_ms % 65_536, "vamParameters": parameters}
    return message, {"header": {"protocolVersion": 3, "messageId": 16, "stationId": station}, "vam": body}


@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_another_compiler_reads_the_counts_of_which_a_message_was_made(messages: int, release2: ModuleType) -> None:
    random = Random(21)
    for _ in range(messages):
        message, content = drawn(random)
        assert read_and_made_again(release2.VAM_PDU_Descriptions.VAM, vam.encode(message)) == content


angles, sizes = st.floats(-10.0, 10.0), st.floats(0.0, 200.0)
common = {
    "station": st.integers(0, 2**32 - 1), "station_type": st.sampled_from(StationType),
    "time_ms": st.integers(NOW - 30_000, NOW + 30_000), "latitude_deg": st.floats(-90.0, 90.0),
    "longitude_deg": st.floats(-180.0, 180.0),
    "confidence": st.none() | st.builds(ConfidenceEllipse, st.none() | sizes, st.none() | sizes, st.none() | angles),
    "heading": st.none() | angles, "speed": st.none() | sizes, "acceleration": st.none() | st.floats(-20.0, 20.0),
    "yaw_rate": st.none() | angles, "environment": st.sampled_from(Environment),
}  # fmt: skip
messages_with_profile = st.builds(
    Vam, **common, profile=st.sampled_from(Profile), sub_profile=st.integers(0, 15),
    size_class=st.sampled_from(SizeClass),
)  # fmt: skip


@given(st.builds(Vam, **common) | messages_with_profile)
def test_a_receiver_reads_rounded(message: Vam) -> None:
    read_back = vam.rounded(message)
    assert vam.decode(vam.encode(message), NOW) == read_back
    assert vam.rounded(read_back) == read_back


@pytest.mark.parametrize("function", [vam.encode, vam.rounded])
@pytest.mark.parametrize(
    "message",
    [
        *(replace(CYCLIST, **{name: value})
          for name in ("latitude_deg", "longitude_deg", "heading", "speed", "acceleration", "yaw_rate")
          for value in (math.nan, math.inf)),
        replace(CYCLIST, speed=-0.1), replace(CYCLIST, station=-1), replace(CYCLIST, time_ms=2**42),
        replace(CYCLIST, sub_profile=16), replace(CYCLIST, profile=None),
        replace(CYCLIST, profile=None, sub_profile=0),
    ],
)  # fmt: skip
def test_what_no_message_can_say_is_refused(message: Vam, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(message)


@given(spoilt(vam.encode(CYCLIST)) | spoilt(vam.encode(PEDESTRIAN)))
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        found = vam.decode(data, NOW)
    except MessageDecodeError:
        return
    assert vam.decode(vam.encode(found), NOW) == vam.rounded(found)
