"""Wraps a sensor so that its failures become reason codes instead of exceptions or invalid values.

Knows the port and no particular sensor. The output of a guarded sensor is finite, of the kinds that the sensor's class
declares, and read-only.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.coded_texts import CodedTexts
from vve_sumo.intersections import SignalPhase
from vve_sumo.ports import error_text
from vve_sumo.sensors.port import Column, Reading, Sensor, SensorColumn, SensorSettings
from vve_sumo.sensors.street import Street
from vve_sumo.values import Actors, Pose, SensorOutput, Vehicle

_NUMBERS: Final[dict[str, type[np.generic]]] = {
    "float": np.float64, "int": np.int64, "int8": np.int8, "bool": np.bool_
}  # fmt: skip

#: a street of which nothing is known
NO_STREET: Final = Street()

_NO_SIGNALS: Final[Mapping[str, SignalPhase]] = MappingProxyType({})

_PLAIN: Final = "biufU"  # numpy's kinds of arrays that hold truth values, numbers or texts, and no objects

_KINDS: Final = {np.dtype(number): kind for kind, number in _NUMBERS.items()}


class NotFiniteError(Exception):
    """A value of a sensor is NaN or infinite."""


class WrongTypeError(Exception):
    """A value is not of the kind that the sensor's class declares."""


class _Prepared(NamedTuple):
    """What a sensor prepared for the next tick."""

    columns: tuple[Column, ...]
    output: SensorOutput | None  #: None for no reading
    error: BaseException | None  #: why there is none


_NOTHING_PREPARED: Final = _Prepared((), None, None)


class GuardedSensor:
    """Steps a sensor, checks what it returns, and reports failures as reason codes.

    Codes: sensor_raised, sensor_wrong_type, sensor_not_finite, sensor_late, actors_not_finite.
    """

    def __init__(
        self,
        name: str,
        settings: SensorSettings,
        vehicle: Vehicle,
        generator: np.random.Generator,
        street: Street = NO_STREET,
    ) -> None:
        """Make the sensor; raises what its class raises, and TypeError where its output is invalid."""
        self._name = name
        self._sensor: Sensor = settings.sensor_along(street, vehicle, generator)
        self._preparing: Callable[[], Reading | None] | None = getattr(self._sensor, "prepare", None)
        self._show: Callable[[Mapping[str, SignalPhase]], None] | None = getattr(self._sensor, "show", None)
        self.sees_signals = self._show is not None  #: whether it is to be handed what the signals show
        self._prepared = _NOTHING_PREPARED
        self._stepped = False  # and not prepared since
        self._columns, self._max_age = settings.table(), float(settings.max_age())
        self._observation = settings.observation
        self._fields = tuple(field.name for field in dataclasses.fields(settings.observation) if field.name != "time")
        #: tables that this sensor's settings leave out: None from the beginning
        self._left_out = frozenset(name for name in self._fields if getattr(self._sensor.output, name, 0) is None)
        self._first = math.nan
        self.output: SensorOutput = self._sensor.output  #: the newest valid output, for the controller
        self.faults: tuple[str, ...] = ()  #: reason codes of the last step
        self.text = ""  #: text of the last failure, for the record
        if not self._max_age > 0.0:
            raise ValueError(f"max_age returned {self._max_age}, expected a positive time [s]")
        if self.output.time != -math.inf:
            raise ValueError(f"its output is dated {self.output.time} before the first reading, expected -inf")
        self._check(self.output)

    def step(
        self, time: float, pose: Pose, actors: Actors, signals: Mapping[str, SignalPhase] = _NO_SIGNALS
    ) -> tuple[Column, ...] | None:
        """Step at drive time `time` [s]; return the columns of the reading that comes out, None where none does."""
        self.prepare()
        self.faults, self._prepared, prepared = (), _NOTHING_PREPARED, self._prepared
        columns = None
        try:
            if prepared.error is not None:
                raise prepared.error
            if self._show is not None:
                self._show(signals)
            reading = self._sensor.step(time, pose, actors)
            self._stepped = True
            if self._sensor.refused:
                self.faults = ("actors_not_finite",)
            if prepared.output is not None:
                columns = self._dated(prepared.columns, prepared.output, time)
            elif reading is not None:
                output = self._sensor.output
                columns = self._dated(self._fit(reading.columns(), output), output, time)
        except KeyboardInterrupt:
            raise
        except NotFiniteError as not_finite:
            self._fail("sensor_not_finite", str(not_finite))
        except WrongTypeError as wrong_type:
            self._fail("sensor_wrong_type", str(wrong_type))
        except BaseException as error:
            self._fail("sensor_raised", error_text(error, __file__))
        if not self._first <= time:
            self._first = time
        if not time - max(self.output.time, self._first) <= self._max_age:
            self._fail("sensor_late", f"its newest output is older than {self._max_age:g} s")
        return columns

    def prepare(self) -> None:
        """Let a sensor that prepares do its work after a step, in the slack of the tick; a failure shows at the next.

        Does nothing where it has been called since the last step.
        """
        if self._preparing is None or not self._stepped:
            return
        self._stepped = False
        try:
            reading = self._preparing()
            if reading is not None:
                output = self._sensor.output
                self._prepared = _Prepared(self._fit(reading.columns(), output), output, None)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._prepared = _Prepared((), None, error)

    def _dated(self, columns: tuple[Column, ...], output: SensorOutput, now: float) -> tuple[Column, ...]:
        """Take a valid output, and return the columns of its reading; raises where its date is wrong."""
        if not self.output.time < output.time <= now:
            raise WrongTypeError(f"dated {output.time} at {now} after one of {self.output.time}")
        self.output = output
        return columns

    def _fit(self, columns: tuple[Column, ...], output: SensorOutput) -> tuple[Column, ...]:
        """Return a reading's columns as the record takes them; raises where one, or the output, is invalid."""
        if len(columns) != len(self._columns):
            raise WrongTypeError(f"{len(columns)} columns, expected {len(self._columns)}")
        sound = self._check(output)
        # Most arrays of the output are columns of the record too and need only one check.
        fit = tuple(
            column if sound.get(id(column)) == declared.kind else _column(column, declared)
            for column, declared in zip(columns, self._columns, strict=True)
        )
        if len({len(column) for column in fit}) != 1:
            raise WrongTypeError("its columns have different lengths")
        return fit

    def _check(self, output: object) -> dict[int, str]:
        """Raise unless an output is of the kind declared and every number in it finite; lock its arrays.

        Returns the kind of each array that a column of the record could be, by its `id`.
        """
        if not isinstance(output, self._observation):
            raise WrongTypeError(f"output is a {type(output).__name__}, expected a {self._observation.__name__}")
        sound: dict[int, str] = {}
        there = [name for name in self._fields if name not in self._left_out or getattr(output, name) is not None]
        self._check_fields(output, there, sound)
        return sound

    def _check_fields(self, output: object, names: Iterable[str], sound: dict[int, str]) -> None:
        """Check fields of an output, or of a table in it, and note in `sound` its arrays as `_check` returns them."""
        for name in names:
            value: Any = getattr(output, name)
            if isinstance(value, np.ndarray):
                if value.dtype.kind not in _PLAIN:
                    raise WrongTypeError(f"{name} of its output is an array of {value.dtype}, expected plain numbers")
                if value.dtype.kind == "f" and not _finite(value):
                    raise NotFiniteError(f"{name} of its output")
                value.setflags(write=False)
                if value.ndim == 1 and (kind := _KINDS.get(value.dtype)) is not None:
                    sound[id(value)] = kind
            elif isinstance(value, float | np.floating):
                if not math.isfinite(value):
                    raise NotFiniteError(f"{name} of its output is {value}")
            elif dataclasses.is_dataclass(value) and not isinstance(value, type):
                self._check_fields(value, [field.name for field in dataclasses.fields(value)], sound)
            elif not isinstance(value, int | np.integer | np.bool_ | str):
                # A list could hold a NaN at any depth.
                kind_of = type(value).__name__
                raise WrongTypeError(f"{name} of its output is a {kind_of}, expected a number, a text or an array")

    def _fail(self, code: str, text: str) -> None:
        self.faults += (code,)
        self.text = f"sensor {self._name}: {text}"


def _column(column: Column, declared: SensorColumn) -> Column:
    """Return a column as read-only values of the declared kind."""
    wanted = _NUMBERS.get(declared.kind)
    if wanted is None:
        texts: tuple[Any, ...] = column.texts if isinstance(column, CodedTexts) else tuple(column)
        if not all(issubclass(kind, str) for kind in set(map(type, texts))):
            raise WrongTypeError(f"{declared.name} holds what is no text")
        return column if isinstance(column, CodedTexts) else texts
    values = np.asarray(column)
    if values.ndim != 1 or (len(values) and not np.can_cast(values.dtype, wanted, "same_kind")):
        raise WrongTypeError(f"{declared.name} is a {values.dtype} of {values.ndim} dimensions, not {declared.kind}")
    fit = values.astype(wanted, copy=False)
    if wanted is np.float64 and not _finite(fit):
        raise NotFiniteError(declared.name)
    if fit.dtype != values.dtype and not (fit == values).all():
        raise WrongTypeError(f"{declared.name} holds more than {declared.kind} can")
    fit.setflags(write=False)
    return fit


def _finite(values: NDArray[Any]) -> bool:
    # A sum takes half as long as a check of each value, and is finite only where all are.
    return math.isfinite(np.add.reduce(values, axis=None)) or bool(np.isfinite(values).all())
