"""Reads from the records of a watchdog test how hard and how soon the car stopped when its frames stopped.

A doctor's check compares that with what the rig states. It opens no bus and changes no file.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from vve_sumo import bus
from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.config_file import read_json
from vve_sumo.drive.resolved_scenario import recorded_model
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError
from vve_sumo.record.reader import read_table
from vve_sumo.rig.dates import TIME_ZONES
from vve_sumo.rig.resolve import model_of
from vve_sumo.rig.schema import Rig, WatchdogTest
from vve_sumo.values import Floats
from vve_sumo.vehicle.interface import load

NAME: Final = "watchdog record"  #: of the doctor's check
MIN_SPEED: Final = 3.0  #: at which the frames must have stopped [m/s]; below it creeping hides the brakes
MIN_GAP: Final = 0.3  #: without a command frame, that is no late step of the gateway [s]
FROM_SHARE, TO_SHARE = 0.8, 0.2  #: of the speed, between which the deceleration counts
#: by which the rig's figures may look better than those read from the records: somebody rounded them
DECELERATION_TOLERANCE: Final = 0.05  # [m/s2]
DELAY_TOLERANCE: Final = 0.01  # [s]


class WatchdogStop(NamedTuple):
    """How a car stopped after the last command frame.

    A car that goes on at its speed for `delay` and then slows by `deceleration` comes to rest after the same distance.
    """

    speed: float  #: at the last frame [m/s]
    deceleration: float  #: mean, between four fifths and one fifth of that speed [m/s2]
    delay: float  #: from the last frame [s]


def watchdog_stop(sent: Floats, time: Floats, speed: Floats) -> WatchdogStop:
    """Return how a car stopped by itself, from the times of the commands and its speed over time [s], [m/s].

    Raises ConfigError where the frames never stopped in a moving car, and where they came again, or the record ended,
    before a fifth of the speed.
    """
    known = np.isfinite(speed)
    time, speed = time[known], speed[known]
    if not len(time):
        raise ConfigError("no speed in its ticks")
    last, again = _last_frame(sent, time, speed)
    start = float(np.interp(last, time, speed))
    upper, lower = (_first_below(time, speed, share * start, last) for share in (FROM_SHARE, TO_SHARE))
    if not lower < again:
        raise ConfigError(
            f"the frames stopped at {start:.1f} m/s, but the car had not slowed to {TO_SHARE * start:.1f} m/s before "
            "they came again or the record ended"
        )
    deceleration = (FROM_SHARE - TO_SHARE) * start / (lower - upper)
    between = time[(time > last) & (time < lower)]
    times = np.concatenate(([last], between, [lower]))
    driven = float(np.trapezoid(np.interp(times, time, speed), times))
    braking = (1.0 - TO_SHARE * TO_SHARE) * start * start / (2.0 * deceleration)
    return WatchdogStop(start, deceleration, (driven - braking) / start)


def _last_frame(sent: Floats, time: Floats, speed: Floats) -> tuple[float, float]:
    """Return when the frames stopped while the car was driving, and when they came again, or else the record's end."""
    ends = np.append(sent[1:], max(time[-1], sent[-1]) if len(sent) else 0.0)
    driving = np.interp(sent, time, speed) >= MIN_SPEED
    gaps = np.flatnonzero((ends - sent > MIN_GAP) & driving)
    if not len(gaps):
        raise ConfigError(
            f"its command frames never stopped for {MIN_GAP:g} s while the car was driving at {MIN_SPEED:g} m/s or more"
        )
    return float(sent[gaps[0]]), float(ends[gaps[0]])


def _first_below(time: Floats, speed: Floats, target_speed: float, begin: float) -> float:
    """Return when the speed first falls to a value after `begin` [s], between two samples; infinity for never."""
    found = np.flatnonzero((time > begin) & (speed <= target_speed))
    if not len(found):
        return float("inf")
    at = int(found[0])
    if at == 0 or speed[at - 1] <= speed[at]:
        return float(time[at])
    share = (speed[at - 1] - target_speed) / (speed[at - 1] - speed[at])
    return float(max(time[at - 1] + share * (time[at] - time[at - 1]), begin))


def read(folder: Path) -> WatchdogStop:
    """Return how the car of a record stopped; raises ConfigError naming the folder where the record holds no such stop.

    A record that is not as its drive left it holds none.
    """
    resolved = _of_a_drive(folder)
    altered = alterations(folder)
    if altered is None or altered:
        raise ConfigError(f"{folder}: {altered[0] if altered else 'the drive that wrote it never finished it'}")
    commands = load(recorded_model(resolved).interface).facts.commands
    epoch = float(resolved["epoch_gnss_s"])
    frames = bus.read_log(folder / "can.log")
    sent = sorted(time - epoch for time, _channel, frame in frames if frame.id in commands)
    ticks = read_table(folder, "ticks")
    try:
        return watchdog_stop(np.array(sent), ticks["time_s"].to_numpy(), ticks["speed_mps"].to_numpy())
    except ConfigError as error:
        raise ConfigError(f"{folder}: {error}") from None


def _of_a_drive(folder: Path) -> dict[str, Any]:
    return read_json(folder / "scenario.json", "a drive", "epoch_gnss_s")


def day_of(folder: Path) -> datetime.date:
    """Return the day on which a record was begun, UTC; raises ConfigError where it does not tell."""
    file = folder / "provenance.json"
    begun = read_json(file, "a drive's origin", "began_utc")["began_utc"]
    try:
        return datetime.datetime.fromisoformat(begun).date()
    except (TypeError, ValueError):
        raise ConfigError(f"{file}: began_utc: expected a time, got {begun!r}") from None


def checks(rig: Rig, working: Path) -> Iterator[Check]:
    """Compare the rig's watchdog test with its records, whose folders are looked up from `working`.

    No check for a watchdog that did not brake, nor for a simulated vehicle's without records.
    """
    test = rig.watchdog_test
    if test is None or not test.armed:
        return
    if not test.records:
        if rig.car == "real":
            advice = "name the records of the test's runs in watchdog_test.records; docs/live.md tells how"
            yield Check(NAME, "none: nobody can read the two figures again", CheckResult.NO_GO, advice)
        return
    try:
        folders = [working / name for name in test.records]
        for folder in folders:
            _refuse_another(rig, test, folder)
        yield compared(test, [read(folder) for folder in folders])
    except ConfigError as error:
        yield Check(NAME, str(error), CheckResult.NO_GO, "correct watchdog_test.records, or make the test again")


def _refuse_another(rig: Rig, test: WatchdogTest, folder: Path) -> None:
    """Raise ConfigError for a record of another car, or of a run that is older than the test is said to be."""
    resolved = _of_a_drive(folder)
    driven, declared = recorded_model(resolved), model_of(rig)
    kind = resolved["rig"].get("car") if isinstance(resolved.get("rig"), dict) else None
    if kind != rig.car:
        raise ConfigError(f"{folder}: expected a live drive of a {rig.car} car")
    if (driven.vehicle.wheelbase, driven.interface.name) != (declared.vehicle.wheelbase, declared.interface.name):
        raise ConfigError(f"{folder}: is the record of another car than the rig's")
    begun = day_of(folder)
    if test.date > begun + TIME_ZONES:
        raise ConfigError(f"{folder}: was driven on {begun}, watchdog_test.date says {test.date}")


def compared(test: WatchdogTest, stops: Sequence[WatchdogStop]) -> Check:
    """Judge what the rig states of its watchdog by the weakest and by the latest of the measured stops."""
    deceleration, delay = min(stop.deceleration for stop in stops), max(stop.delay for stop in stops)
    runs = "1 run" if len(stops) == 1 else f"the worst of {len(stops)} runs"
    found = (
        f"measured {deceleration:.2f} m/s2 after {delay:.2f} s ({runs}), "
        f"the rig says {test.deceleration_mps2:g} after {test.delay_s:g}"
    )
    too_hard = test.deceleration_mps2 > deceleration + DECELERATION_TOLERANCE
    too_soon = test.delay_s < delay - DELAY_TOLERANCE
    if too_hard or too_soon:
        advice = "write what was measured into [watchdog_test]: the fence counts on it"
        return Check(NAME, found, CheckResult.NO_GO, advice)
    return Check(NAME, found)
