"""The port of sensors: the interface of a kind of virtual sensor, and how a kind is found by its name.

A kind is one class: the keys that a scenario may set, the columns of its table in the record, how its rows are drawn,
the observation that the controller is handed, and how a sensor is made from all this. Knows neither SUMO nor the
controller, and names no sensor but in the table of shipped kinds. `tests/ports/sensor.py` tests any kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from vve_sumo.config_file import Table, complaint
from vve_sumo.errors import ConfigError
from vve_sumo.intersections import SignalPhase
from vve_sumo.ports import Port, error_text
from vve_sumo.sensors.drawing import Drawing, wrong
from vve_sumo.sensors.street import Street
from vve_sumo.values import (
    Actors,
    CameraObjects,
    Detections,
    PointCloud,
    Pose,
    SensorOutput,
    Stations,
    StopLines,
    Vehicle,
)

#: Every kind is found by a name of this table, as `file.py:function` or by entry point; `make()` returns its class.
PORT: Final = Port(
    "sensor",
    "vve_sumo.sensors",
    "()",
    {
        kind: f"vve_sumo.sensors.{kind}_settings"
        for kind in ("radar", "lidar", "camera", "v2x", "signals", "right_of_way")
    },
)
#: kind and name of the sensor that every scenario has; the scenario's table of that name sets it
STANDARD: Final = "radar"

Column = Sequence[Any] | NDArray[Any]
#: what of a sensor's output an outgoing wire can carry, by the name that a kind's `serves` has for it
Content = Literal["detections", "points", "objects", "stations", "stop_lines"]
#: the class of an output that serves a content
CONTENTS: Final[Mapping[Content, type]] = {
    "detections": Detections,
    "points": PointCloud,
    "objects": CameraObjects,
    "stations": Stations,
    "stop_lines": StopLines,
}
ColumnKind = Literal["float", "int", "int8", "bool", "str"]


class SensorColumn(NamedTuple):
    """A column of a sensor's table in the record."""

    name: str  #: with the unit at its end, such as `range_m`
    kind: ColumnKind  #: of its values
    meaning: str  #: in words, for readers of the record


class Reading(Protocol):
    """The output of a sensor at one tick, for the record."""

    def columns(self) -> tuple[Column, ...]:
        """Return the rows as the columns of the sensor's table, all of one length, which may be 0."""
        ...


class Sensor(Protocol):
    """A sensor that is fixed to the ego; its randomness comes from a generator of its own."""

    @property
    def output(self) -> SensorOutput:
        """The last measurement; before the first reading empty and dated -inf."""
        ...

    @property
    def refused(self) -> int:
        """Number of actors that the last step left out, because a value of theirs is not finite."""
        ...

    def step(self, time: float, pose: Pose, actors: Actors) -> Reading | None:
        """Measure at drive time `time` [s] from the rear axle's pose; return the reading that comes out, if any."""
        ...


class PreparingSensor(Sensor, Protocol):
    """A sensor whose work would delay the controller: it is done in the slack of the tick, after the command is out."""

    def prepare(self) -> Reading | None:
        """Do what the last step left to do; return the reading that comes out at the next tick, if any.

        Called once after each step, and before the next one.
        """
        ...


class SignalSensor(Sensor, Protocol):
    """A sensor that sees what the signals of the virtual road show."""

    def show(self, signals: Mapping[str, SignalPhase]) -> None:
        """Take what each signal shows, by SUMO's ids; called before each step, at the same tick."""
        ...


class SensorSettings(Table):
    """What a scenario says of a sensor: a kind's class adds its keys."""

    #: of the sensor's table in the record, after `tick`, whatever the settings say
    columns: ClassVar[tuple[SensorColumn, ...]]
    #: what outgoing wires can carry of its output, whatever their format
    serves: ClassVar[tuple[Content, ...]] = ()
    #: class of `Sensor.output`: a frozen dataclass of its date, numbers and arrays of numbers, all finite
    observation: ClassVar[type]

    def table(self) -> tuple[SensorColumn, ...]:
        """Return the columns of this sensor's table: those of the kind, and those that its settings add."""
        return self.columns

    def drawing(self, vehicle: Vehicle, /) -> Drawing | None:
        """Return how the rows are drawn on a vehicle; None, the default, where they have no place on the road."""
        return None

    def max_age(self) -> float:
        """Return how old the output may be at a tick [s]; with an older one the drive is stopped."""
        raise NotImplementedError

    def sensor(self, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a sensor on a vehicle, which draws from this generator alone; raises ConfigError."""
        raise NotImplementedError

    def sensor_along(self, street: Street, vehicle: Vehicle, generator: np.random.Generator, /) -> Sensor:
        """Return a sensor on a street; a kind that sees buildings or lanes overrides this."""
        return self.sensor(vehicle, generator)

    @classmethod
    def sees_signals(cls) -> bool:
        """Whether the kind needs the intersections of the street; its sensors then have a method `show`."""
        return False

    @classmethod
    def sees_junctions(cls) -> bool:
        """Whether the kind needs the junctions of the street, and who goes first there."""
        return False

    @classmethod
    def sees_street(cls) -> bool:
        """Whether the kind sees more than bodies."""
        return cls.sensor_along is not SensorSettings.sensor_along


def load(kind: str) -> type[SensorSettings]:
    """Return the class of a kind of sensor; raises ConfigError, which begins with the kind."""
    made = PORT.make(kind, PORT.find(kind))
    if not (isinstance(made, type) and issubclass(made, SensorSettings)):
        raise ConfigError(f"sensor {kind}: make returned {made!r}, expected a class derived from SensorSettings")
    if wrong := _wrong(made):
        raise ConfigError(f"sensor {kind}: {made.__name__}: {wrong}")
    return made


def configured(kind: str, settings: Mapping[str, Any]) -> SensorSettings:
    """Return the settings of a sensor of a kind; raises ConfigError naming the kind and the key that is wrong."""
    model = load(kind)
    try:
        return model.model_validate(dict(settings))
    except ValidationError as error:
        raise ConfigError(complaint(f"sensor {kind}", error, model)) from None


def drawing_of(settings: SensorSettings, vehicle: Vehicle) -> Drawing | None:
    """Return how a sensor's rows are drawn on a vehicle; raises ConfigError where that does not fit its columns."""
    try:
        drawing = settings.drawing(vehicle)
    except (Exception, SystemExit) as error:
        raise ConfigError(f"drawing raised {error_text(error, __file__)}") from error
    if drawing is not None and (why := wrong(drawing, settings.table())):
        raise ConfigError(f"drawing: {why}")
    return drawing


def _wrong(kind: type[SensorSettings]) -> str:
    """Return what is wrong with a kind's class in one phrase; empty where nothing is."""
    declared = ("columns", "observation")
    own = ("max_age", "sensor")
    missing = [name for name in declared if not hasattr(kind, name)]
    missing += [name for name in own if getattr(kind, name) is getattr(SensorSettings, name)]
    if missing:
        return f"lacks {', '.join(missing)}"
    try:
        columns = [SensorColumn(*column) for column in kind.columns]
    except TypeError:
        return "columns: expected a tuple of name, kind and meaning each"
    names = [column.name for column in columns]
    if not columns or len({*names, "tick"}) <= len(names):
        return "columns: expected one or more, each name once and none of them 'tick'"
    if strange := [column for column in columns if not all(isinstance(part, str) for part in column)]:
        return f"columns: expected texts, got {strange[0]!r}"
    if unknown := [content for content in kind.serves if content not in get_args(Content)]:
        return f"serves {unknown[0]!r}, expected {', '.join(get_args(Content))}"
    for content in kind.serves:
        if not issubclass(kind.observation, CONTENTS[content]):
            wanted, got = CONTENTS[content].__name__, kind.observation.__name__
            return f"serves {content!r} with an observation of {got}, expected {wanted}"
    kinds = get_args(ColumnKind)
    if strange := [column for column in columns if column.kind not in kinds]:
        return f"column {strange[0].name!r} is of kind {strange[0].kind!r}, expected {', '.join(kinds)}"
    return ""
