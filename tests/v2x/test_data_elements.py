"""How quantities are counted, by the words of ETSI TS 102 894-2 and by the numbers that its ASN.1 names."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.v2x import data_elements as elements
from vve_sumo.v2x.data_elements import (
    DataElement,
    ExteriorLights,
    Scale,
    StationType,
    angle_count,
    angle_of,
    heading_count,
    heading_of,
)
from vve_sumo.v2x.uper import ENCODING, FOLDER

DICTIONARY = (FOLDER / "TS102894-2v241-CDD.asn").read_text(encoding=ENCODING)
ELEMENTS = [one for one in vars(elements).values() if isinstance(one, DataElement)]
SCALES = [one for one in vars(elements).values() if isinstance(one, Scale)]


def declared(name: str) -> tuple[dict[str, int], int, int]:
    """The named numbers, the least and the greatest number of an integer type."""
    found = re.search(rf"^{name} *::= *INTEGER *\{{(.*?)\}} *\((-?\d+) *\.\. *(-?\d+)", DICTIONARY, re.S | re.M)
    assert found is not None, name
    named = {key: int(number) for key, number in re.findall(r"([\w-]+) *\((-?\d+)\)", found[1])}
    return named, int(found[2]), int(found[3])


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda one: one.scale.name)
def test_an_element_counts_as_the_dictionary_declares(element: DataElement) -> None:
    named, least, greatest = declared(element.scale.name)
    assert named["unavailable"] == element.unavailable == greatest == element.count(None)
    assert element.value(element.unavailable) is None
    above = {number for name, number in named.items() if name.lower().endswith(("outofrange", "positive"))}
    assert element.count(1e9) == element.scale.highest == max(above) == greatest - 1
    assert element.scale.lowest == max(least, named.get("doNotUse", least - 1) + 1)
    assert (element.scale.lowest < 0) == any("egative" in name for name in named)


@pytest.mark.parametrize("scale", SCALES, ids=lambda one: one.name)
def test_what_is_always_known_counts_as_the_dictionary_declares(scale: Scale) -> None:
    found = re.search(
        rf"^{scale.name} *::= *INTEGER *(?:\{{.*?\}})? *\((-?\d+) *\.\. *(-?\d+)\)", DICTIONARY, re.S | re.M
    )
    assert found is not None
    assert (scale.lowest, scale.highest) == (int(found[1]), int(found[2]))
    assert scale.count(1e9) == scale.highest


@pytest.mark.parametrize("scale", [*(one.scale for one in ELEMENTS), *SCALES], ids=lambda one: one.name)
def test_every_count_stands_for_itself(scale: Scale) -> None:
    for count in range(scale.lowest, scale.highest + 1):
        assert scale.count(scale.value(count)) == count


@pytest.mark.parametrize(
    ("element", "value", "count"),
    [
        (elements.SPEED, 0.0, 0),
        (elements.SPEED, -1e-12, 0),
        (elements.SPEED, 0.0001, 1),
        (elements.SPEED, 0.01, 1),
        (elements.SPEED, 0.0101, 2),
        (elements.SPEED, 163.81, 16_381),
        (elements.SPEED, 163.811, 16_382),
        (elements.ACCELERATION, -16.0, -160),
        (elements.ACCELERATION, -15.99, -159),
        (elements.ACCELERATION, -0.05, 0),
        (elements.ACCELERATION, 0.05, 1),
        (elements.ACCELERATION, 15.91, 160),
        (elements.YAW_RATE, math.radians(-327.66), -32_766),
        (elements.YAW_RATE, math.radians(0.011), 2),
        (elements.YAW_RATE, math.radians(327.651), 32_766),
        (elements.CURVATURE, -0.10235, -1_023),
        (elements.CURVATURE, 0.00001, 1),
        (elements.CURVATURE, 0.10211, 1_022),
        (elements.VEHICLE_LENGTH, 0.0, 1),
        (elements.VEHICLE_LENGTH, 4.84, 49),
        (elements.VEHICLE_LENGTH, 102.11, 1_022),
        (elements.VEHICLE_WIDTH, 6.01, 61),
        (elements.SEMI_AXIS, 0.0, 1),
        (elements.SEMI_AXIS, 40.931, 4_094),
        (elements.VELOCITY, -0.015, -1),
        (elements.VELOCITY, -170.0, -16_383),
        (elements.OBJECT_DIMENSION, 25.41, 255),
        (elements.COORDINATE_CONFIDENCE, 40.941, 4_095),
        (elements.COORDINATE, -1310.72, -131_072),
        (elements.COORDINATE, 12.3401, 1_235),
        (elements.DELTA_TIME, -0.0999, -99),
        (elements.LENGTH, 80.04, 800),
    ],
)
def test_a_quantity_between_two_steps_is_rounded_as_the_words_say(
    element: DataElement | Scale, value: float, count: int
) -> None:
    assert element.count(value) == count


@pytest.mark.parametrize(("compass", "count"), [(0.0, 0), (90.0, 900), (180.0, 1800), (270.0, 2700), (359.97, 0)])
def test_a_heading_is_counted_clockwise_from_north(compass: float, count: int) -> None:
    for turns in (-1, 0, 2):
        assert heading_count(math.radians(90.0 - compass) + turns * math.tau) == count
    towards = heading_of(count)
    assert towards is not None
    assert -math.pi <= towards <= math.pi
    assert math.sin(towards) == pytest.approx(math.cos(math.radians(count / 10.0)))


@given(st.integers(0, 3599))
def test_every_heading_stands_for_itself(count: int) -> None:
    assert heading_count(heading_of(count)) == count


@pytest.mark.parametrize(("degrees", "count"), [(0.0, 0), (0.01, 1), (359.9, 3599), (359.91, 0), (-90.0, 2700)])
def test_an_angle_is_counted_counter_clockwise_and_rounded_up(degrees: float, count: int) -> None:
    assert angle_count(math.radians(degrees)) == count
    assert angle_of(count) == pytest.approx(math.remainder(math.radians(count / 10.0), math.tau))


@given(st.integers(0, 3599))
def test_every_angle_stands_for_itself(count: int) -> None:
    assert angle_count(angle_of(count) or 0.0) == count


def test_kinds_and_lights_are_the_dictionarys() -> None:
    def plain(name: str) -> str:
        return name.replace("_", "").lower()

    named, _, _ = declared("TrafficParticipantType")
    assert {plain(one.name): one.value for one in StationType} == {plain(key): value for key, value in named.items()}
    assert [StationType.of(number) for number in (5, 16, 255)] == [5, 0, 0]
    lights = re.search(r"^ExteriorLights ::= BIT STRING \{(.*?)\}", DICTIONARY, re.S | re.M)
    assert lights is not None
    keys = {1 << (7 - int(bit)): key.lower() for key, bit in re.findall(r"(\w+) +\((\d)\)", lights[1])}
    assert keys.keys() == {*ExteriorLights}
    assert all(plain(one.name or "?") in keys[one] for one in ExteriorLights)
