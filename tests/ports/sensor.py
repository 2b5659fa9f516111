"""What every kind of sensor must hold to, whoever wrote it: subclass, name the kind, run pytest.

    from tests.ports.sensor import SensorConformance

    class TestMine(SensorConformance):
        kind = "my_sensor.py:make"
        settings = {"width_m": 2.0}

A sensor is stepped on a car at the origin that faces along +x, in `scene()`, of which it must see something.
"""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace
from typing import Any, ClassVar, Final

import numpy as np
import pytest

from tests.sensors.scenes import FUSION, actors, car, rear_axle
from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Box
from vve_sumo.sensors.drawing import from_dict, placed, quantities, to_dict
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.port import Column, Sensor, SensorSettings, configured, drawing_of
from vve_sumo.values import Actors

PERIOD: Final = 0.02
TICKS: Final = 200
#: of a step, in the mean: a tick has 20 ms for all that it does [s]
MEAN_STEP: Final = 0.005
#: a row of an actor is drawn no farther than this from the actor's body, in the median [m]
DRAWN_WITHIN: Final = 2.0

Steps = list[tuple[tuple[Column, ...] | None, tuple[str, ...]]]


class SensorConformance:
    """The suite."""

    kind: ClassVar[str]
    settings: ClassVar[dict[str, Any]] = {}

    def scene(self) -> Actors:
        """Return what the sensor looks at."""
        return actors([car(30.0, 0.0), car(18.0, 3.5, speed=4.0), car(60.0, -3.5)])

    def configured(self) -> SensorSettings:
        return configured(self.kind, self.settings)

    def sensor(self, seed: int = 1) -> Sensor:
        return self.configured().sensor(FUSION, np.random.default_rng(seed))

    def guarded(self, seed: int = 1) -> GuardedSensor:
        return GuardedSensor("mine", self.configured(), FUSION, np.random.default_rng(seed))

    def steps(self, sensor: GuardedSensor, scene: Actors, ticks: int = TICKS) -> Steps:
        return [(sensor.step(PERIOD * tick, rear_axle(), scene), sensor.faults) for tick in range(ticks)]

    # --- what is declared ---------------------------------------------------------------------------------------------

    def test_settings_survive_their_record(self) -> None:
        settings = self.configured()
        kept = json.loads(json.dumps(self.settings))
        assert configured(self.kind, kept).model_dump() == settings.model_dump()

    def test_an_unknown_key_is_one_line(self) -> None:
        with pytest.raises(ConfigError, match=r"^sensor .*: unknown key 'no_such_key'") as refused:
            configured(self.kind, self.settings | {"no_such_key": 1.0})
        assert "\n" not in str(refused.value)

    def test_every_key_says_what_it_means(self) -> None:
        assert all(field.description for field in type(self.configured()).model_fields.values())

    def test_every_column_says_what_it_means_and_numbers_have_a_unit(self) -> None:
        for name, kind, meaning in self.configured().table():
            assert meaning
            assert name.isidentifier()
            assert name == name.lower()
            assert kind != "float" or "_" in name, f"{name} has no unit"

    def test_a_drawing_fits_the_columns_and_survives_its_record(self) -> None:
        drawing = drawing_of(self.configured(), FUSION)
        if drawing is not None:
            assert from_dict(json.loads(json.dumps(to_dict(drawing)))) == drawing

    def test_what_is_drawn_lies_where_something_is(self) -> None:
        """From a car that is turned and away from the origin, so that a wrong frame shows."""
        drawing = drawing_of(self.configured(), FUSION)
        if drawing is None:
            return
        x, y, heading = 40.0, -15.0, 0.7
        turned, sensor, far = _turned(self.scene(), x, y, heading), self.guarded(), []
        names = [column.name for column in self.configured().table()]
        for tick in range(TICKS):
            columns = sensor.step(PERIOD * tick, rear_axle(x, y, heading), turned)
            if columns is None or not len(columns[0]):
                continue
            table = dict(zip(names, columns, strict=True))
            numbers = {name: np.asarray(table[name], float) for name in quantities(drawing).values()}
            shapes = placed(drawing, numbers, x, y, heading)
            whose = [""] * len(columns[0]) if drawing.actor is None else table[drawing.actor]
            for row, name in enumerate(whose):
                rows = [turned.ids.index(name)] if name in turned.ids else range(len(turned.ids))
                if name or drawing.actor is None:
                    far.append(min(_away(turned, one, shapes.x[row], shapes.y[row]) for one in rows))
        assert far, "nothing of the scene was drawn"
        assert np.median(far) < DRAWN_WITHIN

    # --- what it measures ---------------------------------------------------------------------------------------------

    def test_before_the_first_reading_the_output_is_empty_and_old(self) -> None:
        assert self.sensor().output.time == -math.inf

    def test_readings_are_dated_and_outputs_stay_between_them(self) -> None:
        sensor, readings, rows = self.guarded(), 0, 0
        for tick in range(TICKS):
            before = sensor.output
            columns = sensor.step(PERIOD * tick, rear_axle(), self.scene())
            assert sensor.faults == (), sensor.text
            if columns is None:
                assert sensor.output is before
                continue
            assert before.time < sensor.output.time <= PERIOD * tick
            readings, rows = readings + 1, rows + len(columns[0])
        assert readings > 10
        assert rows > 10, "nothing of the scene was seen"

    def test_what_it_looks_at_stays_as_it_is(self) -> None:
        scene = self.scene()
        before = {name: getattr(scene, name).copy() for name in ("x", "y", "heading", "speed", "length", "width")}
        self.steps(self.guarded(), scene)
        assert all(np.array_equal(getattr(scene, name), column) for name, column in before.items())

    def test_the_same_chance_measures_the_same(self) -> None:
        one, two = (self.steps(self.guarded(5), self.scene()) for _ in range(2))
        assert _told(one) == _told(two)

    def test_it_draws_from_its_own_generator_alone(self) -> None:
        one = self.steps(self.guarded(5), self.scene())
        np.random.seed(3)  # noqa: NPY002
        assert _told(self.steps(self.guarded(5), self.scene())) == _told(one)

    def test_an_empty_street_is_no_fault(self) -> None:
        faults = {fault for _columns, fault in self.steps(self.guarded(), actors([]))}
        assert faults == {()}

    def test_an_actor_that_is_no_number_is_counted_and_the_others_are_seen(self) -> None:
        scene = self.scene()
        broken = replace(scene, x=np.array([*scene.x[:-1], math.nan]))
        found = self.steps(self.guarded(), broken)
        assert {fault for _columns, fault in found} <= {(), ("actors_not_finite",)}
        assert ("actors_not_finite",) in {fault for _columns, fault in found}
        assert any(columns is not None and len(columns[0]) for columns, _fault in found)

    def test_ticks_that_are_skipped_are_no_failure(self) -> None:
        sensor, now = self.guarded(), 0.0
        for gap in (1, 1, 3, 1, 2, 5, 1) * 20:
            now += PERIOD * gap
            sensor.step(now, rear_axle(), self.scene())
            assert set(sensor.faults) <= {"sensor_late"}, sensor.text

    def test_a_step_leaves_the_tick_its_time(self) -> None:
        sensor, begun = self.guarded(), time.process_time()
        self.steps(sensor, self.scene())
        assert (time.process_time() - begun) / TICKS < MEAN_STEP


def _turned(scene: Actors, x: float, y: float, heading: float) -> Actors:
    """Return a scene as a car at another place sees it that looks along another heading."""
    cos, sin = math.cos(heading), math.sin(heading)
    return replace(
        scene,
        x=x + scene.x * cos - scene.y * sin,
        y=y + scene.x * sin + scene.y * cos,
        heading=scene.heading + heading,
    )


def _away(scene: Actors, row: int, x: float, y: float) -> float:
    """Return the distance of a point from an actor's box [m], 0 inside."""
    box = Box(*(float(getattr(scene, name)[row]) for name in ("x", "y", "heading", "length", "width")))
    cos, sin = math.cos(box.heading), math.sin(box.heading)
    along, across = (x - box.x) * cos + (y - box.y) * sin, (y - box.y) * cos - (x - box.x) * sin
    return math.hypot(max(abs(along) - 0.5 * box.length, 0.0), max(abs(across) - 0.5 * box.width, 0.0))


def _told(steps: Steps) -> list[Any]:
    return [(None if columns is None else [list(column) for column in columns], faults) for columns, faults in steps]
