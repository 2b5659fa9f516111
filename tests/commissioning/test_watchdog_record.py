"""What a record tells of a stop without frames: closed forms, noise, and a live drive whose gateway is frozen."""

from __future__ import annotations

import dataclasses
import datetime
import math
import signal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.live.command_line import own_rig
from tests.live.matrix import MATRIX, Signal
from tests.live.stage import Stage
from tests.rig.test_load import EXAMPLE, ROLLED, WATCHDOG, real
from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.commissioning.watchdog_record import (
    NAME,
    WatchdogStop,
    checks,
    compared,
    day_of,
    read,
    watchdog_stop,
)
from vve_sumo.errors import ConfigError
from vve_sumo.rig.load import load, parse
from vve_sumo.rig.schema import Rig, WatchdogTest
from vve_sumo.values import Floats

STEP = 0.02  #: between two frames, and between two ticks [s]
STOPPED = 4.0  #: when the frames stop [s]


def speeds(time: Floats, start: float, delay: float, ramp: float, deceleration: float) -> Floats:
    """Speed of a car that brakes from `delay` after STOPPED on, its deceleration growing evenly for `ramp` [m/s]."""
    braking = np.maximum(time - STOPPED - delay, 0.0)
    setting_in = np.minimum(braking, ramp)
    lost = deceleration * (setting_in * setting_in / (2.0 * ramp) + np.maximum(braking - ramp, 0.0))
    return np.maximum(start - lost, 0.0)


def stop(start: float, delay: float, ramp: float, deceleration: float, noise: float = 0.0) -> WatchdogStop:
    time = np.arange(0.0, STOPPED + delay + ramp + start / deceleration + 2.0, STEP)
    speed = speeds(time, start, delay, ramp, deceleration)
    speed += np.random.default_rng(1).normal(0.0, noise, len(speed))
    return watchdog_stop(np.arange(0.0, STOPPED + 1e-9, STEP), time, speed)


@given(st.floats(4.0, 12.0), st.floats(0.0, 1.0), st.floats(0.01, 0.3), st.floats(1.0, 4.0))
def test_deceleration_and_delay_are_those_of_the_stop(
    start: float, delay: float, ramp: float, deceleration: float
) -> None:
    reported = stop(start, delay, ramp, deceleration)
    assert reported.speed == pytest.approx(start)
    assert reported.deceleration == pytest.approx(deceleration, rel=0.02 if ramp * deceleration < 0.4 * start else 0.2)
    assert reported.delay == pytest.approx(delay + 0.5 * ramp, abs=0.03 if ramp * deceleration < 0.4 * start else 0.2)
    # The fence's own reckoning covers the way that was driven.
    driven = float(
        np.trapezoid(speeds(t := np.arange(STOPPED, STOPPED + 20.0, 0.001), start, delay, ramp, deceleration), t)
    )
    assert start * reported.delay + start**2 / (2.0 * reported.deceleration) == pytest.approx(driven, rel=0.02)


def test_a_receiver_s_noise_hides_nothing() -> None:
    reported = stop(5.0, 0.2, 0.2, 2.6, noise=0.03)
    assert reported.deceleration == pytest.approx(2.6, abs=0.1)
    assert reported.delay == pytest.approx(0.3, abs=0.05)


def test_what_holds_no_such_stop_says_why() -> None:
    time = np.arange(0.0, 20.0, STEP)
    fast, stands = np.full(len(time), 5.0), np.zeros(len(time))
    cut_off = np.arange(0.0, STOPPED, STEP)
    with pytest.raises(ConfigError, match=r"its command frames never stopped for 0\.3 s while the car was driving"):
        watchdog_stop(time, time, fast)
    with pytest.raises(ConfigError, match="never stopped"):
        watchdog_stop(cut_off, time, stands)
    with pytest.raises(ConfigError, match="never stopped"):
        watchdog_stop(np.array([]), time, fast)
    with pytest.raises(ConfigError, match=r"stopped at 5\.0 m/s, but the car had not slowed to 1\.0 m/s before"):
        watchdog_stop(cut_off, time, fast)
    again = np.concatenate((cut_off, np.arange(STOPPED + 1.0, 20.0, STEP)))
    with pytest.raises(ConfigError, match="before they came again"):
        watchdog_stop(again, time, speeds(time, 5.0, 0.1, 0.1, 2.5))
    with pytest.raises(ConfigError, match="no speed"):
        watchdog_stop(cut_off, time, np.full(len(time), math.nan))


STATED = WatchdogTest(date=datetime.date(2026, 5, 1), armed=True, deceleration_mps2=2.6, delay_s=0.2)


@pytest.mark.parametrize(
    ("deceleration", "delay", "good"),
    [(2.6, 0.2, True), (3.0, 0.15, True), (2.56, 0.209, True), (2.54, 0.2, False), (3.0, 0.22, False)],
)
def test_the_rig_may_claim_no_more_than_was_measured(deceleration: float, delay: float, good: bool) -> None:
    check = compared(STATED, [WatchdogStop(5.0, deceleration, delay)])
    assert (check.finding is CheckResult.GO) == good


def test_the_weakest_and_the_latest_run_count() -> None:
    runs = [WatchdogStop(5.0, 2.61, 0.31), WatchdogStop(5.0, 3.0, 0.1), WatchdogStop(5.0, 2.8, 0.2)]
    check = compared(STATED.model_copy(update={"deceleration_mps2": 9.0, "delay_s": 0.12}), runs)
    assert check.finding is CheckResult.NO_GO
    assert check.observed == "measured 2.61 m/s2 after 0.31 s (the worst of 3 runs), the rig says 9 after 0.12"


def test_a_real_car_s_armed_watchdog_needs_a_record(tmp_path: Path) -> None:
    (check,) = checks(parse(real() | {"watchdog_test": WATCHDOG}, EXAMPLE), tmp_path)
    assert (check.name, check.finding) == (NAME, CheckResult.NO_GO)
    assert "watchdog_test.records" in check.advice
    for table in (real(), real() | {"watchdog_test": ROLLED}):
        assert list(checks(parse(table, EXAMPLE), tmp_path)) == []
    assert list(checks(load(own_rig(tmp_path)), tmp_path)) == [], "a simulated vehicle's need not have one"
    (check,) = checks(parse(real() | {"watchdog_test": WATCHDOG | {"records": ["nowhere"]}}, EXAMPLE), tmp_path)
    assert check.finding is CheckResult.NO_GO
    assert "nowhere" in check.observed


@pytest.mark.thorough
@pytest.mark.live
def test_the_doctor_reads_the_figures_of_a_live_test(tmp_path: Path) -> None:
    row = next(row for row in MATRIX if row.name == "gateway_paused")
    frozen = dataclasses.replace(row, signal=Signal("gateway", signal.SIGSTOP, continued=5.0))
    evidence = Stage(frozen, tmp_path / "run").run()
    reported, truth = read(evidence.folder), evidence.truth
    after = truth["time_s"] >= evidence.moment
    time, speed = truth["time_s"][after], truth["speed_mps"][after]
    upper, lower = (float(time[np.flatnonzero(speed <= share * speed[0])[0]]) for share in (0.8, 0.2))
    assert reported.speed == pytest.approx(speed[0], abs=0.2)
    assert reported.deceleration == pytest.approx(0.6 * speed[0] / (lower - upper), rel=0.05)
    assert 0.1 <= reported.delay <= 0.5

    # The rig as it was driven, and one that claims more; then what is no record of this test.
    records = ("armed = true", f'armed = true\nrecords = ["{evidence.folder.name}"]')
    rig = load(own_rig(tmp_path / "run", records))
    day = day_of(evidence.folder)
    assert day == datetime.datetime.now(datetime.UTC).date()

    def said(rig: Rig = rig, **test: object) -> Check:
        assert rig.watchdog_test is not None
        stated = {"deceleration_mps2": reported.deceleration - 0.01, "delay_s": reported.delay} | test
        rig = rig.model_copy(update={"watchdog_test": rig.watchdog_test.model_copy(update=stated)})
        (check,) = checks(rig, tmp_path / "run")
        return check

    assert said().finding is CheckResult.GO
    assert "(1 run)" in said().observed
    assert said(deceleration_mps2=9.0).finding is CheckResult.NO_GO
    assert said(delay_s=0.1 * reported.delay).finding is CheckResult.NO_GO
    assert said(date=day + datetime.timedelta(days=1)).finding is CheckResult.GO, "there it was that day already"
    for refused, words in (
        (said(date=day + datetime.timedelta(days=2)), f"was driven on {day}, watchdog_test.date says"),
        (said(rig.model_copy(update={"car": "real"})), "expected a live drive of a real car"),
        (said(with_vehicle(rig, wheelbase_m=2.9)), "is the record of another car than the rig's"),
    ):
        assert refused.finding is CheckResult.NO_GO
        assert words in refused.observed
    log = evidence.folder / "can.log"
    whole = log.read_text()
    log.write_text(whole.replace("060#", "061#", 1))
    assert "can.log is not as the drive left it" in said().observed
    log.write_text(whole)
    assert said().finding is CheckResult.GO
    for file in ("summary.json", "ticks.parquet"):
        (evidence.folder / file).unlink()
    assert "the drive that wrote it never finished it" in said().observed


def with_vehicle(rig: Rig, **values: float) -> Rig:
    return rig.model_copy(update={"vehicle": rig.vehicle.model_copy(update=values)})


@pytest.mark.parametrize("text", ["{}", '{"began_utc": 5}', '{"began_utc": "yesterday"}', "no JSON"])
def test_a_record_that_does_not_tell_its_day_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "provenance.json").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"provenance\.json"):
        day_of(tmp_path)
