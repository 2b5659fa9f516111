"""The latency breakdown against the monitor's own summary and against legs set by hand."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tests.analysis.made import PERIOD, moving, put, write
from vve_sumo.analysis.latency import MEANINGS, latency_breakdown, legs_over_time
from vve_sumo.analysis.run import Run
from vve_sumo.live.latency_monitor import LatencyMonitor
from vve_sumo.record.latencies import LEGS, TOTAL
from vve_sumo.record.rows import LatencyRow
from vve_sumo.report.drive import report

TICKS = 400
#: what each leg takes at least [ms]
LEAST = dict(zip(LEGS, (0.4, 0.3, 0.2, 0.1, 0.05, 0.6), strict=True))
FIX_AGE, SIMULATE = 10.0, 3.0


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A record whose legs are drawn at random, kept by a monitor; every 50th tick is woken by its deadline."""
    folder = write(tmp_path_factory.mktemp("live") / "record", _ticks())
    monitor = LatencyMonitor(0.05, 3)
    generator = np.random.default_rng(4)
    for tick in range(TICKS):
        took = [1e-3 * (least + generator.exponential(0.5)) for least in LEAST.values()]
        row, framed = _row(tick, took, "deadline" if tick % 50 == 7 else "datagram")
        monitor.step(row)
        monitor.gateway_answered(row.sequence, math.nan if tick % 100 == 20 else framed)
    put(folder, "latency", (dataclasses.asdict(row) for row in monitor.close()))
    return folder, monitor.summary()


def _ticks() -> list[dict]:
    rows = moving(np.arange(TICKS) * PERIOD, np.arange(TICKS) * 0.2, np.full(TICKS, 10.0))
    return [row | {"pose_age_s": math.nan if tick < 3 else 0.01} for tick, row in enumerate(rows)]


def _row(tick: int, took: list[float], woken_by: str) -> tuple[LatencyRow, float]:
    received = tick * PERIOD
    moments = received + np.cumsum(took)
    row = LatencyRow(
        tick=tick,
        sequence=tick,
        due_s=received,
        epoch_s=-math.inf if tick == 0 else received - 1e-3 * FIX_AGE,
        received_s=received,
        **dict(zip(("woken_s", "decoded_s", "sensed_s", "decided_s", "handed_s"), moments, strict=False)),
        framed_s=math.nan,
        simulated_s=moments[4] + 1e-3 * SIMULATE,
        woken_by=woken_by,
        missed=int(tick == 9),
    )
    return row, float(moments[5])


def test_the_monitors_legs_are_exactly_what_the_summary_says(live: tuple[Path, dict]) -> None:
    folder, summary = live
    table = latency_breakdown(Run(folder))
    for leg in (*LEGS, TOTAL):
        assert {which: table.loc[leg, f"{which}_ms"] for which in ("p50", "p95", "p99", "max")} == summary["legs_ms"][
            leg
        ]
    assert table.loc["frame", "n"] == summary["ticks"] - summary["without_frame"] == TICKS - 4
    assert table.attrs["units"]["p99_ms"] == "ms"


def test_the_other_legs_are_what_was_set(live: tuple[Path, dict]) -> None:
    table = latency_breakdown(Run(live[0]))
    for leg, took in (("fix_age", FIX_AGE), ("simulate", SIMULATE), ("pose_age", 10.0)):
        assert table.loc[leg, ["p50_ms", "p99_ms", "max_ms"]].to_list() == pytest.approx([took] * 3, abs=1e-3)
    # Neither the ticks that the deadline woke nor the one before the first fix.
    assert table["n"].to_dict() | {"fix_age": TICKS - 8 - 1, "pose_age": TICKS - 3} == table["n"].to_dict()
    assert table.loc["end_to_end", "p50_ms"] > FIX_AGE + sum(LEAST.values())


def test_over_time_every_leg_of_a_tick_adds_up_to_its_total(live: tuple[Path, dict]) -> None:
    table = legs_over_time(Run(live[0]))
    assert list(table.index) == list(range(TICKS))
    framed = table[table["total_ms"].notna() & (table["woken_by"] == "datagram")]
    assert len(framed) == TICKS - 8 - 4
    np.testing.assert_allclose(framed[[f"{leg}_ms" for leg in LEGS]].sum(axis=1), framed["total_ms"], atol=1e-9)
    np.testing.assert_allclose(framed["end_to_end_ms"][1:], framed["total_ms"][1:] + FIX_AGE, atol=1e-9)
    assert table["missed"].sum() == 1


def test_lockstep_has_the_poses_age_alone(tmp_path: Path) -> None:
    run = Run(write(tmp_path / "record", _ticks()))
    table = latency_breakdown(run)
    assert table.loc["pose_age", ["p50_ms", "n"]].to_list() == [10.0, TICKS - 3]
    others = table.drop(index="pose_age")
    assert others.drop(columns="n").isna().all(axis=None)
    assert (others["n"] == 0).all()
    assert len(legs_over_time(run)) == TICKS


@pytest.mark.thorough
def test_the_report_says_beneath_each_leg_what_it_is(live: tuple[Path, dict]) -> None:
    page = report(Run(live[0])).page()
    for leg, meaning in MEANINGS.items():
        words = f'<summary>{leg.replace("_", " ")}</summary><div class="about">{meaning}'
        assert words.replace("'", "&#39;") in page
    assert "&lt;" not in page
