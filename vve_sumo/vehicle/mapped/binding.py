"""Holds a mapping against its DBC file, and makes numbers, conditions and layouts of the signals that it names.

Everything that is wrong raises ConfigError, one line that names the file and the key or the message, before any bus is
opened.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Final

from vve_sumo import dbc
from vve_sumo.errors import ConfigError, closest
from vve_sumo.values import identifier_text
from vve_sumo.vehicle.mapped import checksums, mapping
from vve_sumo.vehicle.mapped.frames import Condition, Layout, Number, Placed, Seal

MAX_SIZE: Final = 8  #: of a classic frame [bytes]
#: what a DBC file's editor keeps signals of no message in
_NO_MESSAGE: Final = "VECTOR__INDEPENDENT_SIG_MSG"
#: names of counts that say that a number is not known
_INVALID: Final = frozenset({"INVALID", "SNA", "NOT_AVAIL", "NOT_AVAILABLE", "ERROR", "RESERVED"})

_ANGLE: Final = {"rad": 1.0, "deg": math.pi / 180.0, "degree": math.pi / 180.0, "degrees": math.pi / 180.0}
_RATE: Final = {f"{unit}/{time}": factor for unit, factor in _ANGLE.items() for time in ("s", "sec")}
_TORQUE: Final = {"nm": 1.0, "n m": 1.0, "n*m": 1.0}
_SHARE: Final = {"": 1.0, "1": 1.0, "ratio": 1.0, "%": 0.01}
_ACCELERATION: Final = {"m/s2": 1.0, "m/s^2": 1.0, "m/s/s": 1.0, "m/s²": 1.0}
_SPEED: Final = frozenset({"m/s", "km/h", "kph", "kmh", "km/hr", "mph", "mi/h", "kn", "knots"})
_WHEEL: Final = {"rad/s": 1.0, "rad/sec": 1.0, "rpm": math.tau / 60.0, "1/min": math.tau / 60.0}

#: Units in which the DBC file may state a quantity without a `scale`, and the quantity's name in SI units.
UNITS: Final[Mapping[str, tuple[str, Mapping[str, float]]]] = {
    "steering_wheel_angle": ("rad", _ANGLE),
    "steering_wheel_rate": ("rad/s", _RATE),
    "acceleration": ("m/s2", _ACCELERATION),
    "brake_torque": ("N m", _TORQUE),
    "throttle": ("of full throttle", _SHARE),
    "wheel_angle": ("rad", _ANGLE),
    "driver_torque": ("N m", _TORQUE),
    "driver_opening": ("of full throttle", _SHARE),
    "actual": ("N m", _TORQUE),
    "yaw": ("rad/s", _RATE),
    "roll": ("rad/s", _RATE),
    "longitudinal": ("m/s2", _ACCELERATION),
    "lateral": ("m/s2", _ACCELERATION),
    "vertical": ("m/s2", _ACCELERATION),
    **{f"{axle}_{side}": ("rad/s", _WHEEL) for axle in ("front", "rear") for side in ("left", "right")},
}


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a mapping and its DBC file lie."""

    mapping: Path
    dbc: Path


class Binder:
    """The messages of a DBC file, asked for by the names of a mapping; it keeps what was asked for."""

    def __init__(self, wanted: mapping.Mapping, origin: Origin) -> None:
        self._wanted, self._origin = wanted, origin
        try:
            self._all = [one for one in dbc.read_all(origin.dbc) if one.name != _NO_MESSAGE]
        except OSError as error:
            raise ConfigError(f"{origin.mapping}: dbc: {origin.dbc} cannot be read: {error.strerror}") from None
        except ValueError as error:
            raise ConfigError(f"{origin.mapping}: dbc: {error}") from None
        self._messages = {one.name: one for one in self._all}
        self._refuse_clashes()
        self._used: dict[str, set[str]] = {}  # names of signals by their messages'

    @property
    def mapping_file(self) -> Path:
        """Return the file of the mapping, for messages."""
        return self._origin.mapping

    def identifiers(self) -> frozenset[int]:
        """Return every identifier of the DBC file."""
        return frozenset(one.id for one in self._all)

    def number(self, key: str, quantity: mapping.Quantity, kind: str = "") -> Number:
        """Return the number of a key; `kind` names a quantity of UNITS, by default the key's last part."""
        scaled = quantity if isinstance(quantity, mapping.Scaled) else None
        message, signal = self.signal(key, scaled.signal if scaled else str(quantity))
        scale = scaled.scale if scaled else None
        if scale is None:
            si, units = UNITS[kind or key.rpartition(".")[2]]
            if (scale := units.get(signal.unit.strip().lower())) is None:
                raise self._wrong(
                    key,
                    f"{self._origin.dbc.name} has {signal.name} in {signal.unit!r}: expected a scale, "
                    f"{si} for each unit",
                )
        invalid = frozenset(count for count, name in signal.choices.items() if name.upper() in _INVALID)
        low, high = sorted(scale * bound for bound in _range(signal, invalid))
        valid = None
        if scaled is not None and scaled.valid is not None:
            valid = self.condition(f"{key}.valid", scaled.valid)
            if valid.message != message.id:
                raise self._wrong(f"{key}.valid", f"expected a signal of message {message.name}")
        return Number(message.id, signal, scale, low, high, invalid, valid)

    def condition(self, key: str, wanted: mapping.Condition) -> Condition:
        """Return the condition of a key."""
        flag = wanted if isinstance(wanted, mapping.Flag) else None
        message, signal = self.signal(key, flag.signal if flag else str(wanted))
        if flag is None and signal.length > 1:
            raise self._wrong(
                key, f"{signal.name} has {signal.length} bits: expected {{ signal = ..., yes = [counts], no = count }}"
            )
        yes, no = (flag.yes, flag.no) if flag else ((1,), 0)
        for count in (*yes, no):
            self.require_count(key, signal, count)
        return Condition(message.id, signal, yes, no)

    def conditions(self, key: str, wanted: Iterable[mapping.Condition]) -> tuple[Condition, ...]:
        """Return the conditions of a key that holds several."""
        return tuple(self.condition(f"{key}.{number}", one) for number, one in enumerate(wanted))

    def signal(self, key: str, name: str) -> tuple[dbc.Message, dbc.Signal]:
        """Return message and signal of a name; what a used message must be, it is checked to be."""
        of, _, called = name.partition(".")
        where = self._origin.dbc.name
        message = self._messages.get(of)
        if message is None:
            raise self._wrong(key, f"{where} has no message {of}{_meant(of, self._messages)}")
        signal = message.signals.get(called)
        if signal is None:
            raise self._wrong(key, f"{where}: message {of} has no signal {called}{_meant(called, message.signals)}")
        if of not in self._used:
            self._refuse_layout(message)
        if self._wanted.byte_order not in ("mixed", signal.order):
            raise self._wrong(
                key,
                f"{where} has {name} in {signal.order} byte order, but byte_order says {self._wanted.byte_order!r}",
            )
        self._used.setdefault(of, set()).add(called)
        return message, signal

    def used(self) -> dict[int, str]:
        """Return the names of the messages that were asked for, by identifier."""
        return {self._messages[name].id: name for name in self._used}

    def layouts(self, constants: Mapping[str, int]) -> dict[int, Layout]:
        """Return the layouts of all messages that were asked for, by identifier."""
        counters = {name.partition(".")[0]: self._protection("counter", name) for name in self._wanted.counter}
        seals: dict[str, list[Seal]] = {}
        for number, one in enumerate(self._wanted.checksum):
            seals.setdefault(one.signal.partition(".")[0], []).append(self._seal(f"checksum.{number}", one))
        fixed: dict[str, list[Placed]] = {}
        for name, count in constants.items():
            key = f"command.constant.{name}"
            _message, signal = self.signal(key, name)
            self.require_count(key, signal, count)
            fixed.setdefault(name.partition(".")[0], []).append(Placed(signal, count))
        return {
            (message := self._messages[name]).id: Layout(
                message.id,
                name,
                message.size,
                counters.get(name),
                tuple(seals.get(name, ())),
                tuple(fixed.get(name, ())),
            )
            for name in self._used
        }

    def period(self, name: str) -> int:
        """Return the period of a report message in hundredths of a second, 2 where the mapping says none."""
        return self._wanted.period_ms.get(name, 20) // 10

    def refuse_multiplexed(self, key: str, name: str, constants: Mapping[str, int]) -> None:
        """Raise ConfigError for a signal that a frame holds only in a case which the mapping does not make constant."""
        message, signal = self.signal(key, name)
        if signal.case is None:
            return
        switch = next((one.name for one in message.signals.values() if one.switch), "a switch that is missing")
        if constants.get(f"{message.name}.{switch}") != signal.case:
            raise self._wrong(
                key,
                f"{name} is there only where {switch} is {signal.case}: expected command.constant with "
                f'"{message.name}.{switch}" = {signal.case}',
            )

    def refuse_speed(self, key: str, name: str) -> None:
        """Raise ConfigError for a signal that the DBC file has in a unit of speed, whatever its scale."""
        if self.signal(key, name)[1].unit.strip().lower() in _SPEED:
            raise self._wrong(key, f"{self._origin.dbc.name} has {name} as a speed; {mapping.SPEED}")

    def wrong_period(self) -> None:
        """Raise ConfigError for a period of a message that is not used."""
        for name in self._wanted.period_ms:
            if name not in self._used:
                raise self._wrong(f"period_ms.{name}", "no report of this mapping lies in such a message")

    def _protection(self, key: str, name: str) -> dbc.Signal:
        of = name.partition(".")[0]
        if of not in self._used:
            raise self._wrong(key, f"{name}: nothing else of this mapping lies in message {of}")
        return self.signal(key, name)[1]

    def _seal(self, key: str, wanted: mapping.Checksum) -> Seal:
        signal = self._protection(f"{key}.signal", wanted.signal)
        of = self._protection(f"{key}.of", wanted.of) if wanted.of is not None else None
        compute = checksums.function_of(wanted.kind, wanted.polynomial, wanted.initial, wanted.final_xor)
        return Seal(signal, compute, wanted.identifier, of)

    def require_count(self, key: str, signal: dbc.Signal, count: int) -> None:
        """Raise ConfigError for a count that a signal does not hold."""
        if not signal.min_count <= count <= signal.max_count:
            raise self._wrong(
                key,
                f"{signal.name} holds counts of {signal.min_count} to {signal.max_count}, expected one, got {count}",
            )

    def _refuse_clashes(self) -> None:
        for one, other in combinations(self._all, 2):
            if one.id == other.id:
                raise ConfigError(
                    f"{self._origin.dbc}: messages {one.name} and {other.name} share identifier "
                    f"{identifier_text(one.id)}"
                )
            if one.name == other.name:
                raise ConfigError(f"{self._origin.dbc}: two messages are called {one.name}")

    def _refuse_layout(self, message: dbc.Message) -> None:
        """Raise ConfigError for a message that is no classic frame, and for signals that have no room or overlap."""
        where = f"{self._origin.dbc}: message {message.name}"
        if not 1 <= message.size <= MAX_SIZE:
            raise ConfigError(f"{where} has {message.size} bytes, expected 1 to {MAX_SIZE}: CAN FD is not spoken")
        for signal in message.signals.values():
            if not 0 <= signal.shift <= 8 * message.size - signal.length:
                raise ConfigError(
                    f"{where}: signal {signal.name} of {signal.length} bits has no room in {message.size} bytes in "
                    f"{signal.order} byte order: is that its byte order?"
                )
        bits = {signal.name: frozenset(_bits(signal, message.size)) for signal in message.signals.values()}
        for one, other in combinations(message.signals.values(), 2):
            apart = None not in (one.case, other.case) and one.case != other.case
            if not apart and (shared := bits[one.name] & bits[other.name]):
                raise ConfigError(f"{where}: signals {one.name} and {other.name} overlap in byte {min(shared) // 8}")

    def _wrong(self, key: str, what: str) -> ConfigError:
        return ConfigError(f"{self._origin.mapping}: {key}: {what}")


def _bits(signal: dbc.Signal, size: int) -> Iterator[int]:
    """Yield the places of a signal's bits, counted from the least significant bit of the first byte."""
    for bit in range(signal.shift, signal.shift + signal.length):
        yield bit if signal.order == "little" else 8 * (size - 1 - bit // 8) + bit % 8


def _range(signal: dbc.Signal, invalid: frozenset[int]) -> tuple[float, float]:
    """Return the least and greatest value of a signal in its own unit; 0 and 0 in a DBC file is no statement."""
    least, greatest = signal.min_count, signal.max_count
    while least in invalid:
        least += 1
    while greatest in invalid:
        greatest -= 1
    low, high = sorted(count * signal.scale + signal.offset for count in (least, greatest))
    if signal.minimum < signal.maximum:
        low, high = max(low, signal.minimum), min(high, signal.maximum)
    return low, high


def _meant(name: str, known: Iterable[str]) -> str:
    meant = closest(name, list(known))
    return f", did you mean {meant}?" if meant else ""
