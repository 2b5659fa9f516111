"""The CPM: a second compiler of the same ASN.1 reads what was encoded, a receiver `rounded`; other bytes are refused.

tshark 4.0 has the draft of release 1 (TR 103 562) only, whose bytes are others: it does not read this release. Two
encoders of the same files agree; the meaning of each field remains unchecked by other programs.
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
from vve_sumo.v2x import cpm, uper
from vve_sumo.v2x.cpm import Cpm, Sensor, SensorType
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.perceived_object import PerceivedObject
from vve_sumo.v2x.reference_position import ConfidenceEllipse

NOW = 700_000_000_000
CAR = PerceivedObject(
    7, -0.05, 12.345, -3.2, 0.5, 0.7, 3.3, -1.1, 0.3, 4.55, 1.82, 1.5, 0.9, 12, (1, 2), StationType.PASSENGER_CAR, 80
)
MESSAGE = Cpm(
    5, NOW, 40.0, -83.0, ConfidenceEllipse(1.0, 0.9, 0.2), False, 1.0,
    (Sensor(1, SensorType.RADAR, 160.0, -0.3, 0.3), Sensor(2, SensorType.LIDAR)),
    (CAR, replace(CAR, id=8, kind=StationType.CYCLIST, velocity_x=None, velocity_y=None)), 3,
)  # fmt: skip
ROADSIDE = Cpm(6, NOW, 40.0, -83.0, roadside=True)
#: what an object is, as the dictionary's choice says it
CLASSES: dict[StationType, Any] = {
    StationType.UNKNOWN: ("otherSubClass", 0),
    StationType.PEDESTRIAN: ("vruSubClass", ("pedestrian", 1)),
    StationType.CYCLIST: ("vruSubClass", ("bicyclistAndLightVruVehicle", 1)),
    StationType.LIGHT_VRU_VEHICLE: ("vruSubClass", ("bicyclistAndLightVruVehicle", 6)),
    StationType.MOPED: ("vruSubClass", ("motorcyclist", 1)),
    StationType.MOTORCYCLE: ("vruSubClass", ("motorcyclist", 2)),
    StationType.ANIMAL: ("vruSubClass", ("animal", 0)),
    StationType.PASSENGER_CAR: ("vehicleSubClass", 5),
    StationType.BUS: ("vehicleSubClass", 6),
    StationType.LIGHT_TRUCK: ("vehicleSubClass", 7),
    StationType.HEAVY_TRUCK: ("vehicleSubClass", 8),
    StationType.TRAILER: ("vehicleSubClass", 9),
    StationType.SPECIAL_VEHICLE: ("vehicleSubClass", 10),
    StationType.TRAM: ("vehicleSubClass", 11),
    StationType.AGRICULTURAL: ("vehicleSubClass", 14),
}


def drawn_object(random: Random) -> tuple[PerceivedObject, dict[str, Any]]:
    """An object, and the content of counts that stands for it, of which its quantities are made."""

    def maybe(value: int) -> int | None:
        return random.choice((None, value))

    def confidence(count: int) -> float | None:
        return None if count == 4096 else count * 0.01

    number, delta = random.getrandbits(16), random.randint(-2048, 2047)
    x, y = random.randint(-131_072, 131_071), random.randint(-131_072, 131_071)
    sigma_x, sigma_y = random.randint(1, 4096), random.randint(1, 4096)
    one = PerceivedObject(number, delta * 0.001, x * 0.01, y * 0.01, confidence(sigma_x), confidence(sigma_y))
    content: dict[str, Any] = {
        "objectId": number, "measurementDeltaTime": delta,
        "position": {
            "xCoordinate": {"value": x, "confidence": sigma_x}, "yCoordinate": {"value": y, "confidence": sigma_y},
        },
    }  # fmt: skip
    if random.random() < 0.7:
        east, north = random.randint(-16_383, 16_382), random.randint(-16_383, 16_382)
        one = replace(one, velocity_x=east * 0.01, velocity_y=north * 0.01)
        components = {"xVelocity": {"value": east, "confidence": 127}, "yVelocity": {"value": north, "confidence": 127}}
        content["velocity"] = ("cartesianVelocity", components)
    if (angle := maybe(random.randrange(3600))) is not None:
        one = replace(one, heading=math.radians(angle / 10.0))
        content["angles"] = {"zAngle": {"value": angle, "confidence": 127}}
    for name, axis in (("length", "X"), ("width", "Y"), ("height", "Z")):
        if (size := maybe(random.randint(1, 255))) is not None:
            one = replace(one, **{name: size * 0.1})
            content[f"objectDimension{axis}"] = {"value": size, "confidence": 32}
    if (age := maybe(random.randrange(1501))) is not None:
        one, content["objectAge"] = replace(one, age=age * 0.001), age
    if (quality := maybe(random.randrange(16))) is not None:
        one, content["objectPerceptionQuality"] = replace(one, quality=quality), quality
    if sensors := [random.randrange(256) for _ in range(random.randrange(4))]:
        one, content["sensorIdList"] = replace(one, sensors=tuple(sensors)), sensors
    if random.random() < 0.9:
        kind, percent = random.choice(list(CLASSES)), maybe(random.randint(1, 100))
        one = replace(one, kind=kind, kind_percent=percent)
        content["classification"] = [{"objectClass": CLASSES[kind], "confidence": percent or 101}]
    return one, content


def drawn_sensor(random: Random) -> tuple[Sensor, dict[str, Any]]:
    number, kind, shadowing = random.randrange(256), random.randrange(15), bool(random.getrandbits(1))
    content: dict[str, Any] = {"sensorId": number, "sensorType": kind, "shadowingApplies": shadowing}
    if random.random() < 0.5:
        return Sensor(number, SensorType(kind), shadowing=shadowing), content
    reach, start, end = random.randrange(4096), random.randrange(3600), random.randrange(3600)
    sector = {"range": reach, "horizontalOpeningAngleStart": start, "horizontalOpeningAngleEnd": end}
    content["perceptionRegionShape"] = ("radial", sector)
    angles = math.radians(start / 10.0), math.radians(end / 10.0)
    return Sensor(number, SensorType(kind), reach * 0.1, *angles, shadowing), content


def drawn(random: Random) -> tuple[Cpm, dict[str, Any]]:
    """A message, and the content of counts that stands for it, of which its quantities are made."""
    latitude, longitude = random.randint(-900_000_000, 900_000_000), random.randint(-1_799_999_999, 1_800_000_000)
    station, time_ms, roadside = random.getrandbits(32), random.getrandbits(42), random.random() < 0.3
    containers: list[dict[str, Any]] = [{"containerId": 2, "containerData": ("OriginatingRsuContainer", {})}]
    orientation = None
    if not roadside:
        orientation = random.choice((None, random.randrange(3600)))
        forward = {"value": 3601 if orientation is None else orientation, "confidence": 127}
        vehicle = ("OriginatingVehicleContainer", {"orientationAngle": forward})
        containers = [{"containerId": 1, "containerData": vehicle}]
    sensors = [drawn_sensor(random) for _ in range(random.randrange(3))]
    if sensors:
        listed = ("SensorInformationContainer", [content for _, content in sensors])
        containers.append({"containerId": 3, "containerData": listed})
    objects = [drawn_object(random) for _ in range(random.choice((0, 1, 2, 7)))]
    total = random.choice((None, len(objects) + 3))
    if objects or total:
        perceived = {
            "numberOfPerceivedObjects": total or len(objects),
            "perceivedObjects": [content for _, content in objects],
        }
        containers.append({"containerId": 5, "containerData": ("PerceivedObjectContainer", perceived)})
    place = {
        "latitude": latitude, "longitude": longitude,
        "positionConfidenceEllipse": {
            "semiMajorConfidence": 4095, "semiMinorConfidence": 4095, "semiMajorOrientation": 3601,
        },
        "altitude": {"altitudeValue": 800_001, "altitudeConfidence": "unavailable"},
    }  # fmt: skip
    message = Cpm(
        station, time_ms, latitude / 1e7, longitude / 1e7, None, roadside,
        None if orientation is None else math.radians(90.0 - orientation / 10.0),
        tuple(one for one, _ in sensors), tuple(one for one, _ in objects), total,
    )  # fmt: skip
    management = {"referenceTime": time_ms, "referencePosition": place}
    return message, {
        "header": {"protocolVersion": 2, "messageId": 14, "stationId": station},
        "payload": {"managementContainer": management, "cpmContainers": containers},
    }


@pytest.mark.parametrize("messages", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_another_compiler_reads_the_counts_of_which_a_message_was_made(messages: int, release2: ModuleType) -> None:
    kind, random = release2.CPM_PDU_Descriptions.CollectivePerceptionMessage, Random(31)
    for _ in range(messages):
        message, content = drawn(random)
        assert read_and_made_again(kind, cpm.encode(message)) == content


def test_every_class_is_read_as_what_it_was() -> None:
    """Vehicles' classes are a union of ranges in the dictionary: four bits, from 0 to 14."""
    for kind in CLASSES:
        (one,) = cpm.decode(cpm.encode(replace(MESSAGE, objects=(replace(CAR, kind=kind),)))).objects
        assert one.kind is kind
    # extension bit, two bits of the alternative, four of the class
    assert uper.encode(cpm.MESSAGE, ("vehicleSubClass", 14), "ObjectClass") == bytes([0b000_1110_0])


def test_a_polar_velocity_is_read_as_components() -> None:
    polar = {
        "velocityMagnitude": {"speedValue": 1000, "speedConfidence": 127},
        "velocityDirection": {"value": 300, "confidence": 127},
    }
    assert velocity_read(("polarVelocity", polar)) == pytest.approx(
        (10.0 * math.cos(math.pi / 6.0), 10.0 * math.sin(math.pi / 6.0))
    )
    polar["velocityDirection"]["value"] = 3601
    assert velocity_read(("polarVelocity", polar)) == (None, None)
    one_component = {"xVelocity": {"value": 16_383, "confidence": 127}, "yVelocity": {"value": 5, "confidence": 127}}
    assert velocity_read(("cartesianVelocity", one_component)) == (None, None)


def velocity_read(velocity: Any) -> tuple[float | None, float | None]:
    """What is read of a message whose only object another station gave this velocity."""
    content = uper.decode(cpm.MESSAGE, cpm.encode(replace(MESSAGE, objects=(CAR,))))
    last = content["payload"]["cpmContainers"][-1]
    perceived = uper.decode(cpm.MESSAGE, last["containerData"], "PerceivedObjectContainer")
    perceived["perceivedObjects"][0]["velocity"] = velocity
    last["containerData"] = uper.encode(cpm.MESSAGE, perceived, "PerceivedObjectContainer")
    (one,) = cpm.decode(uper.encode(cpm.MESSAGE, content)).objects
    return one.velocity_x, one.velocity_y


angles, sizes = st.floats(-10.0, 10.0), st.floats(0.0, 300.0)
places, speeds = st.floats(-1500.0, 1500.0), st.floats(-200.0, 200.0)
objects = st.builds(
    PerceivedObject, st.integers(0, 0xFFFF), st.floats(-3.0, 3.0), places, places, st.none() | sizes, st.none() | sizes,
    heading=st.none() | angles, length=st.none() | sizes, width=st.none() | sizes, height=st.none() | sizes,
    age=st.none() | st.floats(0.0, 10.0), quality=st.none() | st.integers(0, 15),
    sensors=st.lists(st.integers(0, 255), max_size=3).map(tuple),
    kind=st.sampled_from(sorted(CLASSES)), kind_percent=st.none() | st.integers(1, 100),
)  # fmt: skip
moving = st.builds(lambda one, x, y: replace(one, velocity_x=x, velocity_y=y), objects, speeds, speeds)
sensors = st.builds(
    Sensor, st.integers(0, 255), st.sampled_from(SensorType), st.none() | st.floats(0.0, 500.0), angles, angles,
    st.booleans(),
)  # fmt: skip
common = {
    "station": st.integers(0, 2**32 - 1), "reference_time_ms": st.integers(0, 2**42 - 1),
    "latitude_deg": st.floats(-90.0, 90.0), "longitude_deg": st.floats(-180.0, 180.0),
    "confidence": st.none() | st.builds(ConfidenceEllipse, st.none() | sizes, st.none() | sizes, st.none() | angles),
    "sensors": st.lists(sensors, max_size=3).map(tuple),
    "objects": st.lists(objects | moving, max_size=4).map(tuple), "total": st.none() | st.integers(4, 255),
}  # fmt: skip


@given(st.builds(Cpm, **common, orientation=st.none() | angles) | st.builds(Cpm, **common, roadside=st.just(True)))
def test_a_receiver_reads_rounded(message: Cpm) -> None:
    read_back = cpm.rounded(message)
    assert cpm.decode(cpm.encode(message)) == read_back
    assert cpm.rounded(read_back) == read_back


@pytest.mark.parametrize("function", [cpm.encode, cpm.rounded])
@pytest.mark.parametrize(
    "message",
    [
        *(replace(MESSAGE, **{name: math.nan}) for name in ("latitude_deg", "longitude_deg", "orientation")),
        *(replace(MESSAGE, objects=(replace(CAR, **{name: value}),)) for name in (
            "delta_time", "x", "y", "confidence_x", "confidence_y", "velocity_x", "velocity_y", "heading", "length",
            "width", "height", "age") for value in (math.nan, math.inf)),
        *(replace(MESSAGE, objects=(replace(CAR, **{name: value}),)) for name, value in (
            ("id", 65_536), ("confidence_x", -1.0), ("velocity_x", None), ("length", -1.0), ("age", -0.1),
            ("quality", 16), ("sensors", (256,)), ("sensors", (1,) * 129), ("kind", StationType.INFRASTRUCTURE),
            ("kind", None), ("kind_percent", 0), ("kind_percent", 101))),
        *(replace(MESSAGE, sensors=(Sensor(1, SensorType.RADAR, *sector),)) for sector in (
            (math.nan, 0.0, 0.0), (-1.0, 0.0, 0.0), (1.0, math.nan, 0.0), (1.0, 0.0, math.inf))),
        replace(MESSAGE, sensors=(Sensor(256, SensorType.RADAR),)),
        replace(MESSAGE, sensors=(Sensor(1, SensorType.RADAR),) * 129),
        replace(MESSAGE, station=2**32), replace(MESSAGE, reference_time_ms=-1), replace(MESSAGE, roadside=True),
        replace(MESSAGE, total=1), replace(MESSAGE, total=256), replace(MESSAGE, objects=(CAR,) * 256, total=None),
    ],
)  # fmt: skip
def test_what_no_message_can_say_is_refused(message: Cpm, function: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        function(message)


@given(spoilt(cpm.encode(MESSAGE)) | spoilt(cpm.encode(ROADSIDE)))
def test_any_bytes_are_a_message_or_refused(data: bytes) -> None:
    try:
        found = cpm.decode(data)
    except MessageDecodeError:
        return
    assert cpm.decode(cpm.encode(found)) == cpm.rounded(found)
