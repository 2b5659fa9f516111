"""What a real car is told of another one of its drive, and what it does then."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.drive.termination import Outcome
from vve_sumo.live.other_cars import OtherCars, lost_reason
from vve_sumo.values import ArmingState


@dataclass
class Car:
    """A real car as the others see it."""

    id: str
    stops_with_others: bool = True
    outcome: Outcome | None = None
    code: str = ""
    other_cars_lost: dict[str, dict[str, Any]] = field(default_factory=dict)

    def lost(self) -> str:
        return self.code

    def stop_reasons(self) -> tuple[str, ...]:
        return ("pose_stale",) if self.code else ()


@pytest.mark.parametrize("state", list(ArmingState))
@pytest.mark.parametrize("has_engaged", [False, True])
def test_a_car_is_lost_when_nobody_commands_it_or_its_gateway_stopped_it(state: ArmingState, has_engaged: bool) -> None:
    assert lost_reason(True, has_engaged, state) == "other_car_gone"
    stopped = has_engaged and state != ArmingState.ENGAGED
    assert lost_reason(False, has_engaged, state) == ("other_car_stopped" if stopped else "")


@given(st.lists(st.tuples(st.sampled_from(["", "other_car_gone", "other_car_stopped"]), st.booleans()), min_size=2))
def test_each_car_stops_for_every_other_that_is_lost_and_for_itself_never(cars: list[tuple[str, bool]]) -> None:
    made = [Car(str(number), stops, code=code) for number, (code, stops) in enumerate(cars)]
    others = OtherCars(made, lambda line: None)
    for place, car in enumerate(made):
        lost = {other.code for other in made if other is not car} - {""}
        assert set(others.codes(place, 1.0)) == (lost if car.stops_with_others else set())
        assert set(car.other_cars_lost) == {other.id for other in made if other is not car and other.code}


def test_a_car_is_told_once_with_time_and_reasons_also_one_that_goes_on() -> None:
    said: list[str] = []
    first, second = Car("ego", stops_with_others=False), Car("second", code="other_car_stopped")
    others = OtherCars([first, second], said.append)
    assert [others.codes(0, now) for now in (1.0, 2.0)] == [(), ()]
    assert first.other_cars_lost == {"second": {"code": "other_car_stopped", "time_s": 1.0, "reasons": ["pose_stale"]}}
    assert said == ["ego: another real car was stopped, or is no longer engaged (second); it goes on, as its rig says"]


def test_a_drive_that_is_over_tells_nobody_and_one_that_is_half_over_does() -> None:
    first, second = Car("ego"), Car("second", outcome=Outcome.ARRIVED, code="other_car_stopped")
    others = OtherCars([first, second], lambda line: None)
    assert others.codes(0, 1.0) == ("other_car_stopped",)
    first.outcome = Outcome.ARRIVED
    assert others.codes(0, 2.0) == ()
