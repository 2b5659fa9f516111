"""The DENM: two independent decoders of release 1 read what was encoded; terminations, limits, bytes that are none."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.v2x.packets import AROUND, frame, spoilt
from tests.v2x.tshark import assert_read, needs_tshark, read
from vve_sumo.v2x import denm
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.denm import AwarenessDistance, Cause, Denm, Termination, TrafficDirection
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.uper import ENCODING, FOLDER

DETECTED = 700_000_000_000
EVENT = Denm(
    7, StationType.PASSENGER_CAR, 5, 9, DETECTED, DETECTED + 100, 39.998, -83.01, Cause.STATIONARY_VEHICLE, 2,
    ConfidenceEllipse(0.5, 0.3, 1.0), None, 3, AwarenessDistance.LESS_THAN_200_M, TrafficDirection.UPSTREAM, 60, 500,
    3.3, 1.0,
)  # fmt: skip
OVER = replace(
    EVENT, cause=None, sub_cause=0, quality=0, speed=None, heading=None, termination=Termination.CANCELLATION
)


def drawn(random: Random) -> tuple[Denm, dict[str, Any]]:
    """A notification and the counts that stand for it on the wire, from which its quantities are made."""

    def maybe(value: int) -> int | None:
        return random.choice((None, value))

    latitude, longitude = random.randint(-900_000_000, 900_000_000), random.randint(-1_799_999_999, 1_800_000_000)
    station, originator, sequence = random.getrandbits(32), random.getrandbits(32), random.getrandbits(16)
    detected, referred, kind = random.getrandbits(42), random.getrandbits(42), random.randrange(16)
    distance, direction, interval = (maybe(random.randrange(*ends)) for ends in ((8,), (4,), (1, 10_001)))
    validity = random.choice((600, random.randrange(86_401)))
    counts: dict[str, Any] = {
        "its.protocolVersion": 2, "its.messageID": 1, "its.stationID": station,
        "its.originatingStationID": originator, "its.sequenceNumber": sequence,
        "denm.detectionTime": detected, "denm.referenceTime": referred, "its.latitude": latitude,
        "its.longitude": longitude, "its.semiMajorConfidence": 4095, "its.semiMinorConfidence": 4095,
        "its.semiMajorOrientation": 3601, "its.altitudeValue": 800_001, "its.altitudeConfidence": 15,
        "denm.stationType": kind,
    }  # fmt: skip
    # An optional field that is absent, and a validity that is the default, are not on the wire.
    for name, value in (
        ("denm.relevanceDistance", distance), ("denm.relevanceTrafficDirection", direction),
        ("denm.transmissionInterval", interval), ("denm.validityDuration", None if validity == 600 else validity),
    ):  # fmt: skip
        counts |= {} if value is None else {name: value}
    message = Denm(
        station, StationType(kind), originator, sequence, detected, referred, latitude / 1e7, longitude / 1e7, None,
        awareness_distance=None if distance is None else AwarenessDistance(distance),
        traffic_direction=None if direction is None else TrafficDirection(direction),
        validity_s=validity, interval_ms=interval,
    )  # fmt: skip
    if random.random() < 0.2:
        termination = random.randrange(2)
        return replace(message, termination=Termination(termination)), counts | {"denm.termination": termination}
    cause, sub_cause, quality = random.randrange(129), random.randrange(256), random.randrange(8)
    speed, heading = maybe(random.randrange(16_383)), maybe(random.randrange(3600))
    counts |= {
        "its.causeCode": cause,
        "its.subCauseCode": sub_cause,
        "denm.informationQuality": quality,
        "denm.traces": 1,
    }
    counts |= {} if speed is None else {"its.speedValue": speed, "its.speedConfidence": 127}
    counts |= {} if heading is None else {"its.headingValue": heading, "its.headingConfidence": 127}
    event = replace(
        message, cause=cause, sub_cause=sub_cause, quality=quality, speed=None if speed is None else speed * 0.01,
        heading=None if heading is None else math.radians(90.0 - heading / 10.0),
    )  # fmt: skip
    return event, counts


@needs_tshark
@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_tshark_reads_the_counts_of_which_a_notification_was_made(messages: int, tmp_path: Path) -> None:
    random = Random(11)
    made = [drawn(random) for _ in range(messages)]
    found = read([frame(MessageId.DENM, denm.encode(message), AROUND) for message, _ in made], tmp_path)
    optional = {"denm.relevanceDistance", "denm.termination", "its.speedValue", "its.headingValue", "its.causeCode"}
    for fields_of_one, (_, counts) in zip(found, made, strict=True):
        assert_read(fields_of_one, counts)
        assert optional & fields_of_one.keys() == optional & counts.keys()


@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_pycrate_makes_the_same_bytes_again(messages: int) -> None:
    """Its modules are those of release 1, EN 302 637-3."""
    from pycrate_asn1dir.ITS_DENM_3 import DENM_PDU_Descriptions

    theirs, random = DENM_PDU_Descriptions.DENM, Random(12)
    for _ in range(messages):
        data = denm.encode(drawn(random)[0])
        theirs.from_uper(data)
        theirs.set_val(theirs.get_val())
        assert theirs.to_uper() == data


def test_causes_are_the_dictionarys() -> None:
    text = (FOLDER / "TS102894-2v241-CDD.asn").read_text(encoding=ENCODING)
    _, _, choice = text.partition("CauseCodeChoice::= CHOICE {")
    listed = [line.split()[0] for line in choice.partition("}")[0].strip().splitlines()]
    numbers = {int("".join(filter(str.isdigit, name))): name for name in listed}
    assert list(numbers) == list(range(len(listed))) == list(range(denm.MAX_CAUSE + 1))
    for cause in Cause:
        assert cause.name.replace("_", "").lower() in numbers[cause].replace("-", "").lower()
    unassigned = {number for number, name in numbers.items() if name.startswith(("reserved", "dontPanic"))}
    assert unassigned == set(numbers) - set(Cause)


angles, sizes = st.floats(-10.0, 10.0), st.floats(0.0, 200.0)
common = {
    "station": st.integers(0, 2**32 - 1), "station_type": st.sampled_from(StationType),
    "originator": st.integers(0, 2**32 - 1), "sequence": st.integers(0, 0xFFFF),
    "detection_time_ms": st.integers(0, 2**42 - 1), "reference_time_ms": st.integers(0, 2**42 - 1),
    "latitude_deg": st.floats(-90.0, 90.0), "longitude_deg": st.floats(-180.0, 180.0),
    "confidence": st.none() | st.builds(ConfidenceEllipse, st.none() | sizes, st.none() | sizes, st.none() | angles),
    "awareness_distance": st.none() | st.sampled_from(AwarenessDistance),
    "traffic_direction": st.none() | st.sampled_from(TrafficDirection),
    "validity_s": st.integers(0, 86_400), "interval_ms": st.none() | st.integers(1, 10_000),
}  # fmt: skip
events = st.builds(
    Denm, **common, cause=st.integers(0, 128), sub_cause=st.integers(0, 255), quality=st.integers(0, 7),
    speed=st.none() | sizes, heading=st.none() | angles,
)  # fmt: skip
terminations = st.builds(Denm, **common, cause=st.none(), termination=st.sampled_from(Termination))


@given(events | terminations)
def test_a_receiver_reads_rounded(message: Denm) -> None:
    read_back = denm.rounded(message)
    assert denm.decode(denm.encode(message)) == read_back
    assert denm.rounded(read_back) == read_back


@given(events)
def test_rounding_changes_no_whole_number_and_quantities_by_a_step(message: Denm) -> None:
    read_back = denm.rounded(message)
    quantities = {"latitude_deg", "longitude_deg", "confidence", "speed", "heading"}
    for name in {one.name for one in fields(Denm)} - quantities:
        assert getattr(read_back, name) == getattr(message, name)
    assert read_back.latitude_deg == pytest.approx(message.latitude_deg, abs=0.6e-7)
    if message.speed is not None:
        assert 0.0 <= read_back.speed - min(message.speed, 163.82) + 1e-8 <= 0.01 + 2e-8


@pytest.mark.parametrize("function", [denm.encode, denm.rounded])
@pytest.mark.parametrize(
    "message",
    [
        *(replace(EVENT, **{name: value}) for name in ("latitude_deg", "longitude_deg", "speed", "heading")
          for value in (math.nan, math.inf)),
        *(replace(EVENT, **{name: -1}) for name in (
            "station", "originator", "sequence", "detection_time_ms", "reference_time_ms", "cause", "sub_cause",
            "quality", "validity_s", "speed")),
        replace(EVENT, sequence=65_536), replace(EVENT, cause=129), replace(EVENT, sub_cause=256),
        replace(EVENT, quality=8), replace(EVENT, validity_s=86_401), replace(EVENT, interval_ms=0),
        replace(EVENT, interval_ms=10_001), replace(EVENT, detection_time_ms=2**42),
        replace(EVENT, cause=None), replace(EVENT, termination=Termination.NEGATION), replace(OVER, speed=1.0),
    ],
)  # fmt: skip
def test_what_no_notification_can_say_is_refused(message: Denm, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(message)


@given(spoilt(denm.encode(EVENT)) | spoilt(denm.encode(OVER)))
def test_any_bytes_are_a_notification_or_refused(data: bytes) -> None:
    try:
        found = denm.decode(data)
    except MessageDecodeError:
        return
    assert denm.decode(denm.encode(found)) == denm.rounded(found)


def test_an_event_with_neither_situation_nor_termination_is_refused() -> None:
    data = bytearray(denm.encode(OVER))
    # The first bits after the header: which containers follow, whether there are extensions, then whether it is over.
    assert data[6] >> 3 & 1
    with pytest.raises(MessageDecodeError):
        denm.decode(bytes(data[:6]) + bytes([data[6] & ~8]) + bytes(data[7:]))
