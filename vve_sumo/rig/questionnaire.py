"""The questions of a new rig, and the rig file that the answers make; what nobody knows yet is marked in it.

Knows the keys of a rig; reads and writes no file. A rig file with a mark is refused by `rig.load`, which names its key.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

import tomlkit

from vve_sumo.errors import ConfigError
from vve_sumo.rig.unknown import UNKNOWN

Kind = Literal["text", "number", "whole", "day", "corners"]


@dataclass(frozen=True, slots=True)
class Question:
    """One key of a rig that somebody is asked for."""

    key: str
    words: str  #: what is asked, with the unit
    kind: Kind = "text"
    default: str = ""  #: as it is typed; empty where only the car tells
    choices: tuple[str, ...] = ()
    only: tuple[str, tuple[str, ...]] | None = (
        None  #: a key that was asked before, and the answers to which this is asked
    )


_NCOM_AND_CAN: Final = ("ncom_udp", "oxts_can")
_OVER_UDP: Final = ("nmea_udp", "ubx_udp", "sbf_udp", "novatel_udp")
_OVER_TCP: Final = ("nmea_tcp", "sbf_tcp", "novatel_tcp")
_OVER_SERIAL: Final = ("nmea_serial", "ubx_serial", "sbf_serial", "novatel_serial")
_UDP: Final = ("pose.kind", ("ncom_udp", *_OVER_UDP))
_TCP: Final = ("pose.kind", _OVER_TCP)
_SERIAL: Final = ("pose.kind", _OVER_SERIAL)
_NMEA: Final = ("pose.kind", ("nmea_udp", "nmea_tcp", "nmea_serial"))
_SLOWER: Final = ("pose.kind", (*_OVER_UDP, *_OVER_TCP, *_OVER_SERIAL))
_DATASPEED: Final = ("drive_by_wire.interface", ("dataspeed_dbw1", "dataspeed_ulc"))
_PEDALS: Final = ("drive_by_wire.interface", ("pacmod3", "new_eagle_raptor"))
_OXTS_CAN: Final = ("pose.kind", ("oxts_can",))
#: not asked, but marked in the file, where nobody knows the controller
NOT_KNOWN: Final = ("drive_by_wire.interface", ())

QUESTIONS: Final = (
    Question("title", "what this car and lot are called"),
    Question(
        "pose.kind",
        "how the receiver is heard",
        default="ncom_udp",
        choices=(*_NCOM_AND_CAN, *_OVER_UDP, *_OVER_TCP, *_OVER_SERIAL),
    ),
    Question("pose.address", "this computer's address on the receiver's network", only=_UDP),
    Question("pose.source", "the receiver's own address", only=_UDP),
    Question("pose.port", "port of this computer that the receiver sends to", "whole", default="3000", only=_UDP),
    Question("pose.address", "the receiver's address", only=_TCP),
    Question("pose.port", "port that the receiver serves", "whole", default="3000", only=_TCP),
    Question("pose.device", "serial port of the receiver", only=_SERIAL),
    Question("pose.baud", "its speed [baud]; over USB any", "whole", default="115200", only=_SERIAL),
    Question("pose.interface", "CAN interface of the receiver, as python-can names it", only=_OXTS_CAN),
    Question("pose.channel", "CAN channel of the receiver", only=_OXTS_CAN),
    Question("pose.velocity_sigma_mps", "1 sigma of its velocity [m/s], data sheet", "number", only=_NMEA),
    Question("pose.heading_sigma_deg", "1 sigma of its heading [deg], data sheet", "number", only=_NMEA),
    Question("pose.rate_hz", "fixes a second that it is set to, 10 or more", "number", only=_SLOWER),
    Question("pose.minimum_delay_ms", "what a fix takes to arrive at best [ms]", "number"),
    Question("mounting.forward_m", "receiver's output point ahead of the rear axle [m]", "number"),
    Question("mounting.left_m", "receiver's output point left of the rear axle [m]", "number"),
    Question("bus.interface", "the car's CAN interface, as python-can names it", default="socketcan"),
    Question("bus.channel", "the car's CAN channel", default="can0"),
    Question("bus.bitrate", "its bit rate [bit/s]", "whole", default="500000"),
    Question(
        "drive_by_wire.interface",
        "the drive-by-wire controller",
        choices=("dataspeed_dbw1", "dataspeed_ulc", "pacmod3", "new_eagle_raptor", "generic"),
    ),
    Question(
        "drive_by_wire.settings.variant",
        "generation of its firmware, verified on the car",
        choices=("dbw1_2018", "dbw1_2024"),
        only=_DATASPEED,
    ),
    Question(
        "drive_by_wire.settings.brake_nm", "torque of the whole brake pedal, all wheels [N m]", "number", only=_PEDALS
    ),
    Question("drive_by_wire.settings.command_timeout_s", "after which it lets go [s]", "number", only=_PEDALS),
    Question(
        "drive_by_wire.settings.when_commands_stop",
        "what it does when commands stop",
        choices=("releases", "brakes"),
        only=_PEDALS,
    ),
    Question(
        "drive_by_wire.settings.mapping_file",
        "the mapping of its DBC file",
        only=("drive_by_wire.interface", ("generic",)),
    ),
    Question("drive_by_wire.settings", "what that controller needs: docs/vehicle.md", only=NOT_KNOWN),
    Question("vehicle.model", "vehicle model, a name under vehicles/"),
    Question("limits.speed_mps", "no drive may ask for more than this [m/s]", "number"),
    Question("lot.surveyed", "day of the survey, YYYY-MM-DD", "day"),
    Question("lot.outline", "corners of the lot, latitude longitude; latitude longitude; … [deg]", "corners"),
    Question("lot.margin_m", "kept free along every edge [m]", "number"),
    Question("lot.grade_percent", "worst slope [%]", "number"),
    Question("lot.friction", "lowest of tyre on ground (0.9 dry, 0.6 wet, 0.3 snow)", "number"),
)

HEAD: Final = f"""\
# Written by vve-sumo init --rig. What stands as "{UNKNOWN}" is refused when the file is read, the first key by name:
# find it out on this car and in this lot, and write it down. docs/rigs.md has every key.
"""
#: what cannot be answered before the first drives
TAIL: Final = """
# [watchdog_test]             # made on this car: docs/live.md tells how. Until then a drive runs with --shadow alone.
# date = 2026-05-01
# armed = true
# deceleration_mps2 = 2.5     # lowest measured
# delay_s = 0.2               # from the last frame on
# records = ["runs/watchdog_1"]

# [calibration]               # written by vve-sumo calibrate
"""

Answers = Mapping[str, Any]  #: by dotted keys; a key that is not there is unknown
Ask = Callable[[Question, str], str]  #: asks, with what was wrong with the answer before; an empty answer is none


def asked(ask: Ask) -> dict[str, Any]:
    """Ask every question that the answers before lead to; return the answers, without those that are not known."""
    answers: dict[str, Any] = {}
    for question in QUESTIONS:
        if question.only is NOT_KNOWN or not _applies(question, answers):
            continue
        wrong = ""
        while (said := ask(question, wrong).strip() or question.default) != "":
            try:
                answers[question.key] = value_of(question, said)
                break
            except ValueError as error:
                wrong = str(error)
    return answers


def taken(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the answers in a table of a file, in the shape of a rig's; raises ConfigError naming a wrong key."""
    given = dict(_flat(table))
    answers: dict[str, Any] = {}
    for question in QUESTIONS:
        if question.only is NOT_KNOWN or not _applies(question, answers):
            continue
        said = given.pop(question.key, question.default)
        if said not in ("", UNKNOWN):
            try:
                answers[question.key] = value_of(question, said)
            except ValueError as error:
                raise ConfigError(f"{question.key}: {error}") from None
    if given:
        raise ConfigError(f"key {next(iter(given))!r} answers no question of this rig")
    return answers


def _flat(table: Mapping[str, Any], stem: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{stem}{key}.")
        else:
            yield f"{stem}{key}", value


def _applies(question: Question, answers: Answers) -> bool:
    if question.only is None:
        return True
    key, wanted = question.only
    return answers[key] in wanted if key in answers else not wanted


def value_of(question: Question, said: Any) -> Any:
    """Return an answer, typed or of a file, as the rig holds it; raises ValueError that says what was expected."""
    value = _read(question.kind, said)
    if question.choices and value not in question.choices:
        raise ValueError(f"expected one of {', '.join(question.choices)}, got {value!r}")
    return value


def _read(kind: Kind, said: Any) -> Any:
    try:
        match kind:
            case "text":
                return _text(said)
            case "number":
                return _finite(float(said))
            case "whole":
                return int(said)
            case "day":
                return said if isinstance(said, datetime.date) else datetime.date.fromisoformat(said)
            case "corners":
                return _corners(said)
    except (TypeError, ValueError):
        expected = {"number": "a number", "whole": "a whole number", "day": "a day such as 2026-05-01"}
        corners = "three corners or more such as 40.0030 -83.0200; 40.0030 -83.0160; 40.0050 -83.0160"
        raise ValueError(
            f"expected {expected.get(kind, corners if kind == 'corners' else 'a text')}, got {said!r}"
        ) from None


def _text(said: Any) -> str:
    if not isinstance(said, str) or not said.isprintable():
        raise ValueError
    return said


def _finite(number: float) -> float:
    if not math.isfinite(number):
        raise ValueError
    return number


def _corners(said: Any) -> list[list[float]]:
    rows = [row.replace(",", " ").split() for row in said.split(";")] if isinstance(said, str) else said
    corners = [[_finite(float(latitude)), _finite(float(longitude))] for latitude, longitude in rows]
    if len(corners) < 3:
        raise ValueError
    return corners


def text_of(answers: Answers) -> str:
    """Return the rig file: every key that was asked for with its meaning, unknown ones marked."""
    lines, table = [HEAD], ""
    for question in QUESTIONS:
        if not _applies(question, answers):
            continue
        head, _, key = question.key.partition(".")
        if not key:
            head, key = "", head
        if head != table:
            lines += ["", f"[{head}]"]
            table = head
        value = tomlkit.item(answers.get(question.key, UNKNOWN)).as_string()
        lines.append(f"{key} = {value}  # {question.words}")
        if question.key == "title":
            lines.append('car = "real"')
    return "\n".join(lines) + "\n" + TAIL


def unknown_keys(answers: Answers) -> list[str]:
    """Return the keys of the file that nobody has answered, in its order."""
    return [one.key for one in QUESTIONS if _applies(one, answers) and one.key not in answers]
