"""Writes the functions that turn tuples of values into CAN frames and back, by the layout of a DBC file.

Each is written as source once, as `dataclasses` does it, so that a frame costs what it costs with shifts and scales
written by hand. Values are in SI units. Signals are in Intel order, and have no offset.

`signals` names the signal of each field of a tuple in their order, or of one flag several signals, joined by `|`.
Signals that are multiplexed are named without their ending, which is the name of their case: `PI` for `PI_PEDAL` and
`PI_TORQUE`. A field's type says what it is: a flag, an enumeration with the names that the DBC file has, a count, or a
number; the count that the DBC file names INVALID is NaN. A signal that a layout may lack has a `?`, and is zero then.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Mapping
from enum import IntEnum
from functools import partial
from typing import Any, Final, NamedTuple, get_type_hints

from vve_sumo.dbc import Message, Signal
from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import Malformed

#: From a unit to SI units; what has another unit is in SI units.
_SI: Final[Mapping[str, Callable[[float], float]]] = {
    "deg": math.radians,
    "deg/s": math.radians,
    "km/h": lambda speed: speed / 3.6,
}
_CODES: Final = {1: "B", 2: "H", 4: "I", 8: "Q"}  # of `struct`, by the number of bytes


class FrameReading(NamedTuple):
    """How a frame is read in two steps: one that repeats the counts of the one before need not be understood again."""

    signals: struct.Struct  #: takes the bytes that are read out of a frame of this length
    decode: Callable[..., Any]  #: from their counts to the tuple, or to `Malformed`


def maximum_of(signal: Signal) -> float:
    """Return the largest value that a signal may have, in SI units."""
    return _in_si(signal, signal.maximum)


def encoder(
    message: Message,
    made: type,
    signals: str,
    rounding: Mapping[str, Callable[[float], int]] | None = None,
    case: str = "",
) -> Callable[[Any], Frame]:
    """Return a function from a tuple of class `made` to its frame.

    It raises ValueError for a number outside its signal's range, and for NaN where the signal has no INVALID.
    `rounding` holds functions that round the counts of a field; the others are rounded to the nearest. A function for
    one `case` of the multiplexed signals alone, by its name, is quicker: its tuple lacks the field that says the case.
    """
    source = _Source(message, made, signals, case)
    source.lines.append(f"({', '.join(source.fields)},) = values")
    source.known |= {f"round_{field}": function for field, function in (rounding or {}).items()}
    source.known["Frame"] = Frame
    return source.function("values", f"new(Frame, ({message.id}, {source.packed()}))")


def reading(
    message: Message,
    made: type,
    signals: str,
    converters: Mapping[str, Any] | None = None,
    named: Iterable[str] = (),
    zero: Mapping[str, str] | None = None,
) -> FrameReading:
    """Return how a frame is read as a tuple of class `made`.

    `converters` holds functions that the number of a field goes through, for multiplexed signals one for each count of
    their switch. A frame is malformed where a count of an enumeration or of a signal of `named` has no name ("value"),
    and where a signal of `zero` is not zero, for the reason that stands there.
    """
    source = _Source(message, made, signals)
    values = [source.value(field, (converters or {}).get(field)) for field in source.fields]
    for name in named:
        source.refuse_unnamed(message.signals[name])
    for name, reason in (zero or {}).items():
        source.known[f"not_{name}"] = Malformed(message.id, reason)
        source.lines.append(f"if {source.flag([name])}: return not_{name}")
    words = [word for word in source.words if word in source.used]
    source.known |= {"made": made, "no_value": Malformed(message.id, "value"), "nan": math.nan}
    decode = source.function(", ".join(word.name for word in words), f"new(made, ({', '.join(values)},))")
    return FrameReading(_struct(words, message.size), decode)


class _Word(NamedTuple):
    """Bytes of a frame that are one number, because no signal lies in them and outside."""

    name: str
    start: int
    size: int
    code: str


def _words(message: Message) -> list[_Word]:
    if message.order != "little" or any(signal.offset for signal in message.signals.values()):
        raise ValueError(f"{message.name}: expected signals in Intel order and without an offset")
    runs: list[tuple[int, int, list[Signal]]] = []  # first byte, the one after the last, signals in them
    for signal in sorted(message.signals.values(), key=lambda signal: signal.shift):
        start, end, within = signal.shift // 8, (signal.shift + signal.length + 7) // 8, [signal]
        if runs and start < runs[-1][1]:
            start, before, others = runs.pop()
            end, within = max(end, before), others + within
        runs.append((start, end, within))
    words = []
    for start, end, within in runs:
        code, whole = _CODES[end - start], within[0].signed and within[0].length == 8 * (end - start)
        words.append(_Word(f"word_{start}", start, end - start, code.lower() if whole else code))
    return words


def _struct(words: list[_Word], size: int) -> struct.Struct:
    text, end = "<", 0
    for word in words:
        text += "x" * (word.start - end) + word.code
        end = word.start + word.size
    return struct.Struct(text + "x" * (size - end))


class _Source:
    """Source of one function, and the names that it knows."""

    def __init__(self, message: Message, made: type, signals: str, case: str = "") -> None:
        self._message = message
        self._made = made.__name__
        self._types = get_type_hints(made)
        self._signals = dict(zip(self._types, signals.split(), strict=True))
        self._switch = next((signal for signal in message.signals.values() if signal.switch), None)
        self._only = case  # name of the only case
        self._case = ""  # what holds the count of the switch, once something does
        self.fields = [field for field in self._types if not (case and self._says_case(field))]
        self.words = _words(message)
        self.used: set[_Word] = set()
        self.lines: list[str] = []
        self.known: dict[str, Any] = {"new": tuple.__new__}

    def function(self, arguments: str, result: str) -> Callable[..., Any]:
        """Return the function."""
        text = "\n ".join((f"def function({arguments}):", *self.lines, f"return {result}"))
        exec(text, self.known)  # of the names and numbers in the package's own tables and DBC files
        function: Callable[..., Any] = self.known["function"]
        return function

    def flag(self, names: Iterable[str]) -> str:
        """Whether any of these signals, which lie in one word, is not zero."""
        signals = [self._message.signals[name] for name in names]
        (word,) = {self._word(signal) for signal in signals}
        mask = sum(signal.mask << signal.shift - 8 * word.start for signal in signals)
        return f"{word.name} & {mask} != 0"

    def refuse_unnamed(self, signal: Signal) -> None:
        """Make frames malformed in which the count of a signal has no name."""
        self.known[f"names_{signal.name}"] = frozenset(signal.choices)
        self.lines.append(f"if {self._count(signal)} not in names_{signal.name}: return no_value")

    def value(self, field: str, converter: Any) -> str:
        """Return the value of a field."""
        kind, name = self._types[field], self._signals[field]
        if "|" in name:
            return self.flag(name.split("|"))
        cases = self._cases(field)
        if not cases:
            self.known[f"none_{field}"] = kind(0)
            return f"none_{field}"
        if kind is bool:
            return self.flag([cases[None].name])
        if kind is float:
            return self._number(field, cases, converter)
        (signal,) = cases.values()
        return self._member(field, kind, signal) if _is_enumeration(kind) else self._count(signal)

    def packed(self) -> str:
        """Return the data that holds all fields."""
        parts: dict[_Word, list[str]] = {word: [] for word in self.words}
        for field in filter(self._says_case, self._types):
            self._case = field
        for field in self._types:
            if not (cases := self._cases(field)):
                self.known[f"refuse_{field}"] = partial(_refuse, f"{self._made}.{field}", None, 0.0, 0.0)
                self.lines.append(f"if {field}: refuse_{field}({field})")
                continue
            signal = next(iter(cases.values()))
            word = self._word(signal)
            count, shift = self._counted(field, cases), signal.shift - 8 * word.start
            if signal.signed and signal.length < 8 * word.size:
                count = f"({count} & {signal.mask})"
            parts[word].append(f"{count} << {shift}" if shift else count)
        self.known["pack"] = _struct(self.words, self._message.size).pack
        return f"pack({', '.join(' | '.join(parts[word]) or '0' for word in self.words)})"

    def _says_case(self, field: str) -> bool:
        return self._switch is not None and self._signals[field].removesuffix("?") == self._switch.name

    def _word(self, signal: Signal) -> _Word:
        word = max((word for word in self.words if 8 * word.start <= signal.shift), key=lambda word: word.start)
        self.used.add(word)
        return word

    def _count(self, signal: Signal) -> str:
        word = self._word(signal)
        if signal.length == 8 * word.size:
            return word.name
        shift, least = signal.shift - 8 * word.start, signal.min_count
        text = f"({word.name}{f' >> {shift}' if shift else ''} & {signal.mask})"
        return f"(({text} ^ {-least}) + {least})" if signal.signed else text

    def _cases(self, field: str) -> dict[int | None, Signal]:
        """Signals of a field by the count of the switch with which a frame holds them; none if the layout lacks it."""
        signals, name = self._message.signals, self._signals[field].removesuffix("?")
        if name in signals:
            return {None: signals[name]}
        if self._only:
            return {None: signals[f"{name}_{self._only}"]}
        endings = self._switch.choices if self._switch else {}
        found = {case: signals.get(f"{name}_{ending}") for case, ending in endings.items()}
        cases: dict[int | None, Signal] = {case: one for case, one in found.items() if one and one.case == case}
        if not cases and name == self._signals[field]:
            raise ValueError(f"{self._message.name} has no signal {name}")
        return cases

    def _member(self, field: str, kind: type[IntEnum], signal: Signal) -> str:
        if {int(member): member.name for member in kind} != signal.choices:
            raise ValueError(f"{self._message.name}.{signal.name}: the DBC file has other names than {kind.__name__}")
        members = tuple(kind(count) if count in signal.choices else None for count in range(signal.mask + 1))
        self.known[f"members_{field}"] = members
        text = f"members_{field}[{self._count(signal)}]"
        if None not in members:
            return text
        self.lines += [f"{field} = {text}", f"if {field} is None: return no_value"]
        if signal.switch:
            self._case = field
        return field

    def _number(self, field: str, cases: Mapping[int | None, Signal], converter: Any) -> str:
        signal = next(iter(cases.values()))
        count, invalid = self._count(signal), _invalid(signal)
        if invalid is not None and not count.isidentifier():
            self.lines.append(f"count_{field} = {count}")
            count = f"count_{field}"
        operator, factors = _factors(cases)
        text = f"{count} {operator} {self._of_case(f'factor_{field}', factors)}"
        if invalid is not None:
            text = f"{text} if {count} != {invalid} else nan"
        if converter is not None:
            self.known[f"convert_{field}"] = converter
            text = f"convert_{field}{'' if None in cases else f'[{self._case}]'}({text})"
        return text

    def _counted(self, field: str, cases: Mapping[int | None, Signal]) -> str:
        """Return the count that stands for the value of a field."""
        signal, kind = next(iter(cases.values())), self._types[field]
        if signal.switch and self._only:
            return repr(next(count for count, name in signal.choices.items() if name == self._only))
        if kind is not float:
            return field
        low = self._of_case(f"low_{field}", {case: _in_si(each, each.minimum) for case, each in cases.items()})
        high = self._of_case(f"high_{field}", {case: _in_si(each, each.maximum) for case, each in cases.items()})
        operator, factors = _factors(cases)
        count = f"{field} {'*' if operator == '/' else '/'} {self._of_case(f'factor_{field}', factors)}"
        self.known[f"refuse_{field}"] = partial(_refuse, f"{self._made}.{field}", _invalid(signal))
        rounding = f"round_{field}" if f"round_{field}" in self.known else "round"
        self.lines += [
            f"if {low} <= {field} <= {high}: count_{field} = {rounding}({count})",
            f"else: count_{field} = refuse_{field}({low}, {high}, {field})",
        ]
        return f"count_{field}"

    def _of_case(self, name: str, values: Mapping[int | None, float]) -> str:
        """Return the value in a frame's case, or of a signal that is not multiplexed."""
        if None in values or self._switch is None:
            return repr(values[None])
        if not self._case:
            self.refuse_unnamed(self._switch)
            self.lines.append(f"case = {self._count(self._switch)}")
            self._case = "case"
        self.known[name] = tuple(values.get(case, math.nan) for case in range(self._switch.mask + 1))
        return f"{name}[{self._case}]"


def _is_enumeration(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, IntEnum)


def _in_si(signal: Signal, value: float) -> float:
    return _SI.get(signal.unit, float)(value)


def _factors(cases: Mapping[int | None, Signal]) -> tuple[str, dict[int | None, float]]:
    """Return how counts become values, by `*` or `/`, and the factors.

    They are divided where a unit is a whole number of counts: a fraction of 65535 counts is exact then.
    """
    steps = {case: _in_si(signal, signal.scale) for case, signal in cases.items()}
    if all(not cases[case].signed and (1.0 / step).is_integer() for case, step in steps.items()):
        return "/", {case: 1.0 / step for case, step in steps.items()}
    return "*", steps


def _invalid(signal: Signal) -> int | None:
    return next((count for count, name in signal.choices.items() if name == "INVALID"), None)


def _refuse(what: str, invalid: int | None, low: float, high: float, value: float) -> int:
    if value != value and invalid is not None:
        return invalid
    raise ValueError(f"{what} must be {low:g} to {high:g}, got {value:g}")
