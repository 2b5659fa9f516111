"""The days of a rig: read on a day, commanded on a day, and as it was in a record of any age."""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.live.command_line import own_rig
from tests.rig.test_load import DAY, EXAMPLE, ROLLED, SIMULATED, WATCHDOG, put, real, simulated
from vve_sumo.errors import ConfigError
from vve_sumo.rig.dates import day_to_come, expired_day
from vve_sumo.rig.load import load, parse, parse_json
from vve_sumo.rig.validation import arming_obstacle

ONE = datetime.timedelta(days=1)
TESTED = real() | {"watchdog_test": WATCHDOG}
ALIGNED = {"kind": "stored", "network": "linden", "date": DAY, "origin": [40.0041, -83.0186], "rotation_deg": 0.0}
ALIGNED |= {"x_m": 0.0, "y_m": 0.0, "residual_m": 0.1}


def with_days(table: dict[str, Any], key: str, day: datetime.date) -> dict[str, Any]:
    """A rig on which everything is of `DAY` but one."""
    table = {name: dict(value) if isinstance(value, dict) else value for name, value in table.items()}
    table["alignment"] = dict(ALIGNED)
    table.setdefault("calibration", {})["date"] = table["mounting"]["calibrated"] = DAY
    table["lot"]["surveyed"] = table["watchdog_test"]["date"] = DAY
    put(key, day)(table)
    return table


KEYS = ("lot.surveyed", "watchdog_test.date", "calibration.date", "mounting.calibrated", "alignment.date")


@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("table", [TESTED, simulated()])
def test_no_day_lies_ahead_of_tomorrow(key: str, table: dict[str, Any]) -> None:
    rig = parse(with_days(table, key, datetime.date(2099, 1, 1)), EXAMPLE)
    words = f"{key}: 2099-01-01 is still to come, today is 2026-05-01"
    assert str(day_to_come(rig, DAY)).startswith(words)
    assert day_to_come(rig, datetime.date(2098, 12, 31)) is None, "there it is that day already"
    assert day_to_come(rig, datetime.date(2098, 12, 30)) is not None
    if rig.car == "real":
        assert str(arming_obstacle(rig, DAY)).startswith(words)


@pytest.mark.parametrize("key", KEYS)
def test_a_file_with_a_day_to_come_is_not_loaded(tmp_path: Path, key: str) -> None:
    import tomlkit

    file = tmp_path / "mine.toml"
    file.write_text(tomlkit.dumps(with_days(simulated(), key, datetime.date(2099, 1, 1))), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"^{file}: {key}: 2099-01-01 is still to come"):
        load(file)
    assert load(file, today=datetime.date(2099, 6, 1)).title


@pytest.mark.parametrize(
    ("change", "age", "key"),
    [
        ({}, 365, None),
        ({}, 366, "watchdog_test.date: the test of 2026-05-01 was 366 days ago, watchdog_test.valid_days allows 365"),
        ({"valid_days": 30}, 30, None),
        ({"valid_days": 30}, 31, "watchdog_test.date"),
        ({"valid_days": 3650}, 1095, None),
        ({"valid_days": 3650}, 1096, "lot.surveyed: the survey of 2026-05-01 was 1096 days ago, lot.valid_days allows"),
    ],
)
@pytest.mark.parametrize("test", [WATCHDOG, ROLLED])
def test_a_real_car_s_test_and_survey_expire(
    test: dict[str, Any], change: dict[str, Any], age: int, key: str | None
) -> None:
    rig = parse(real() | {"watchdog_test": test | change}, EXAMPLE)
    obstacle = arming_obstacle(rig, DAY + age * ONE)
    assert obstacle is None if key is None else str(obstacle).startswith(key)


@pytest.mark.thorough
@given(st.dates(datetime.date(1900, 1, 1), datetime.date(2026, 5, 1)), st.integers(0, 40000))
def test_nothing_of_a_simulated_vehicle_expires(day: datetime.date, age: int) -> None:
    rig = parse(with_days(simulated(), "watchdog_test.date", day), SIMULATED)
    assert expired_day(rig, DAY + age * ONE) is None
    assert arming_obstacle(rig, DAY + age * ONE) is None


@given(st.integers(-1, 5000), st.integers(1, 3650))
def test_a_real_car_is_armed_on_a_test_exactly_as_long_as_the_rig_says(age: int, valid: int) -> None:
    table = with_days(TESTED, "lot.valid_days", 3650)  # type: ignore[arg-type]
    table["watchdog_test"]["valid_days"] = valid
    expired = expired_day(parse(table, EXAMPLE), DAY + age * ONE)
    assert (expired is None) == (age <= min(valid, 3650))


@pytest.mark.parametrize("day", [datetime.date(1999, 1, 1), datetime.date(2099, 1, 1)])
def test_a_record_s_rig_is_read_whatever_the_day(day: datetime.date) -> None:
    rig = parse(with_days(TESTED, "watchdog_test.date", day), EXAMPLE)
    kept = json.loads(json.dumps(rig.model_dump(mode="json", exclude_unset=True)))
    assert parse_json(kept, EXAMPLE).watchdog_test == rig.watchdog_test


def test_the_shipped_rig_is_loaded_years_later(tmp_path: Path) -> None:
    assert load(own_rig(tmp_path), today=datetime.date(2126, 1, 1)).car == "simulated"
