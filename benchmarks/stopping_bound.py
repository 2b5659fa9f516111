"""Counts false alarms of the stopping-bound check on nominal stops, and faults of brakes or road that it misses.

`python -m benchmarks.stopping_bound FOLDER [--nominal N] [--planted N] [--processes N]`, or `--smoke` without a folder:
1,000 nominal drives and 20 of each fault take about an hour of one processor. What FOLDER has already is not driven
again, so a run that was killed goes on. Every drive is drawn from its own number: scenario, speed, controller, tuning,
seed, and for half of the nominal ones an error of mass, brake gain and grade that a sound car may have. Prints; changes
nothing but FOLDER.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

REPOSITORY = Path(__file__).parent.parent
#: what a sound car may differ by from its declaration in a nominal drive, either way
MASS, BRAKE_GAIN, GRADE_PERCENT = 0.03, 0.02, 1.0
#: of the drives' speeds [m/s]
SLOWEST, FASTEST = 3.0, 20.0
#: what is planted: changes of the scenario, further dead time [s] and further lag [s] of the brakes
FAULTS: dict[str, tuple[dict[str, float], float, float]] = {
    "nominal": ({}, 0.0, 0.0),
    "brakes that give 60 %": ({"ego.car.brake_gain_factor": 0.6}, 0.0, 0.0),
    "friction 0.3": ({"weather.friction": 0.3}, 0.0, 0.0),
    "100 ms of dead time": ({}, 0.1, 0.0),
    "200 ms of dead time": ({}, 0.2, 0.0),
    "100 ms of lag": ({}, 0.0, 0.1),
}
#: drives of `--smoke`, which are short: what is planted, and the number
SMOKE = (("nominal", 0), ("200 ms of dead time", 0))
LAWS = ("preview", "pure_pursuit", "stanley", "lqr")


class Case(NamedTuple):
    """A drive: what is planted in which scenario, and what of that scenario is changed."""

    fault: str
    number: int
    scenario: str
    changes: dict[str, Any]

    @property
    def key(self) -> str:
        """Name of the drive."""
        return f"{self.fault} {self.number}"


def case(fault: str, number: int) -> Case:
    """Draw a drive from its number."""
    random = np.random.default_rng((number, *fault.encode()))
    hard = fault == "friction 0.3"  # nothing is slippery to a gentle stop
    scenario = str(random.choice(["delay_probe"] if hard else list(SCENARIOS), p=None if hard else SHARES))
    speed = float(random.uniform(10.0 if hard else SLOWEST, FASTEST))
    changes: dict[str, Any] = {"seed": number + 1, **FAULTS[fault][0]}
    changes |= SCENARIOS[scenario](random, speed, hard)
    if fault == "nominal" and number % 2:
        changes |= {
            "ego.car.mass_factor": 1.0 + float(random.uniform(-MASS, MASS)),
            "ego.car.brake_gain_factor": 1.0 + float(random.uniform(-BRAKE_GAIN, BRAKE_GAIN)),
            "ego.car.grade_percent": float(random.uniform(-GRADE_PERCENT, GRADE_PERCENT)),
        }
    return Case(fault, number, scenario, changes)


def _follower(random: np.random.Generator) -> dict[str, Any]:
    """The shipped controller, of any steering law, from a very gentle stop to a hard one."""
    tuning = {
        "steering": str(random.choice(LAWS)),
        "stop_deceleration_m_s2": float(random.uniform(0.5, 3.3)),
        "gap_m": float(random.uniform(2.0, 8.0)),
        "time_headway_s": float(random.uniform(0.8, 2.0)),
        "comfort": bool(random.random() > 0.15),
    }
    return {"controller": {"name": "follow_and_stop", "tuning": tuning}}


def _standing(random: np.random.Generator, speed: float, hard: bool) -> dict[str, Any]:
    """A straight street; regulated, open-loop and proportional stops, or the emergency layer's."""
    kind = "brake_at" if hard else str(random.choice(["brake_at", "follow_and_stop", "hunting"], p=[0.3, 0.5, 0.2]))
    changes = {"brake_at": _probe, "follow_and_stop": _regulated, "hunting": _proportional}[kind](random, speed, hard)
    gentlest = 0.5 * speed * speed / 0.5 if kind == "follow_and_stop" else 0.0
    at = 60.0 + 0.5 * speed * speed / 1.3 + min(140.0, gentlest) + 8.0 * speed
    street = {"obstacles": [{"id": "parked_car", "at_m": min(at, 640.0)}], "ego.speed_mps": speed}
    return {**street, "ego.car.noise": True, "radar.ideal": bool(random.random() < 0.3), **changes}


def _probe(random: np.random.Generator, speed: float, hard: bool) -> dict[str, Any]:
    deceleration = float(random.uniform(3.2, 3.5) if hard else random.uniform(0.8, 3.5))
    way = 5.0 + 0.5 * speed + 0.5 * speed * speed / deceleration
    tuning = {"trigger_m": min(way, 140.0), "deceleration_m_s2": deceleration}
    return {"controller": {"name": "brake_at", "tuning": tuning}}


def _regulated(random: np.random.Generator, _speed: float, _hard: bool) -> dict[str, Any]:
    return _follower(random)


def _proportional(random: np.random.Generator, _speed: float, _hard: bool) -> dict[str, Any]:
    """The tests' controller: from a smooth stop through one that ripples to one that hunts, as gain and delay go."""
    tuning = {"gain_per_s": float(random.uniform(1.0, 8.0)), "gap_m": float(random.uniform(3.0, 8.0))}
    late = float(random.choice([0.0, 0.05, 0.1, 0.15]))
    controller = {"name": "tests/controllers/hunting.py:make", "tuning": tuning}
    return {"controller": controller, "ego.car.gnss_hidden_delay_s": late}


def _bends(random: np.random.Generator, speed: float, _hard: bool) -> dict[str, Any]:
    """The paper's street without its traffic: to 120 m, before its first bends, or to behind them."""
    far = speed > 7.0
    at = 340.0 + 0.5 * speed * speed / 1.3 + speed * speed + 6.0 * speed if far else 120.0
    return {
        "road.demand": [],
        "ego.speed_mps": speed,
        "obstacles": [{"id": "parked_car", "at_m": min(at, 690.0)}],
        **_follower(random),
    }


def _leader(random: np.random.Generator, speed: float, _hard: bool) -> dict[str, Any]:
    """A leader that brakes to a stop, more or less hard."""
    speed = min(max(speed, 5.0), 15.0)
    return {
        "ego.speed_mps": speed,
        "actors.lead.speed_mps": speed,
        "actors.lead.ahead_m": float(random.uniform(1.2, 3.0)) * speed,
        "actors.lead.events.0.acceleration_mps2": float(random.uniform(1.0, 5.0)),
        **_follower(random),
    }


def _revealed(random: np.random.Generator, speed: float, _hard: bool) -> dict[str, Any]:
    """A leader that moves over and reveals a standing car."""
    speed = min(max(speed, 6.0), 14.0)
    reveal = float(random.uniform(145.0, 171.0))
    changes = {"ego.speed_mps": speed, "actors.lead.speed_mps": speed, "actors.lead.events.0.when.ego_at_m": reveal}
    return {**changes, **_follower(random)}


def _gateway(random: np.random.Generator, speed: float, _hard: bool) -> dict[str, Any]:
    """The gateway's own stop, of a car that leaves its path."""
    return {"ego.speed_mps": min(speed, 6.0), "ego.deviation_limit_m": float(random.uniform(0.04, 0.06))}


SCENARIOS = {
    "delay_probe": _standing,
    "parked_car": _bends,
    "lead_braking": _leader,
    "cut_out": _revealed,
    "leap_hard_stop": _gateway,
}
SHARES = (0.5, 0.2, 0.12, 0.08, 0.1)


def drive(this: Case) -> dict[str, Any]:
    """Drive a case, in a process of its own, and return its row."""
    with tempfile.TemporaryDirectory() as scratch:
        return row_of(this, drive_into(this, Path(scratch) / "record"))


def drive_into(this: Case, folder: Path) -> Path:
    """Drive a case into a new record folder and return it; what the gateway believes of the car is as declared."""
    from vve_sumo.drive import lockstep
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse
    from vve_sumo.scenario.overrides import apply_overrides

    file = REPOSITORY / "scenarios" / f"{this.scenario}.toml"
    table = apply_overrides(tomllib.loads(file.read_text(encoding="utf-8")), this.changes)
    _changes, delay, lag = FAULTS[this.fault]
    as_declared = lockstep.car_parameters

    def planted(resolved: Any) -> Any:
        parameters = as_declared(resolved)
        brakes = parameters.vehicle
        brakes = replace(brakes, brake_delay=brakes.brake_delay + delay, brake_lag=brakes.brake_lag + lag)
        return replace(parameters, vehicle=brakes)

    lockstep.car_parameters = planted
    drives.run(resolve_scenario(this.scenario, parse(table, file), file, REPOSITORY), folder, REPOSITORY)
    return folder


def row_of(this: Case, folder: Path) -> dict[str, Any]:
    """Return what the check says of a record."""
    from vve_sumo.analysis.run import Run
    from vve_sumo.analysis.stopping_bound import stopping_bound_check

    run = Run(folder)
    check, approach = stopping_bound_check(run), run.data.approach
    return {
        "fault": this.fault,
        "number": this.number,
        "scenario": this.scenario,
        "controller": this.changes.get("controller", {}).get("name", "follow_and_stop"),
        "outcome": (run.summary or {}).get("outcome"),
        "hunting": approach is not None and approach.hunting,
        "reversals": approach.reversals if approach else 0,
        "speed_mps": check.onset_speed,
        "demand_mps2": check.demand,
        "distance_m": check.distance,
        "excess_m": check.excess,
        "tolerance_m": check.tolerance,
        "missed": list(check.missed),
        "checked": check.held or check.broken,
        "reaction_low_s": check.answer.reaction.low - check.brake_delay,
        "build_up_low_s": check.answer.build_up.low - check.brake_lag,
    }


def rows_in(file: Path) -> list[dict[str, Any]]:
    """Return the rows that a file holds, the last line left out where it was cut short."""
    if not file.is_file():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines(keepends=True) if line[-1] == "\n"]


def drive_all(cases: Sequence[Case], file: Path, processes: int) -> None:
    """Drive what a file does not hold yet, and add a line to it for each drive."""
    done = {(row["fault"], row["number"]) for row in rows_in(file)}
    waiting = [one for one in cases if (one.fault, one.number) not in done]
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["vve_sumo.drive.run", "libsumo", "vve_sumo.analysis.stopping_bound"])
    with context.Pool(processes, maxtasksperchild=1) as pool, file.open("a", encoding="utf-8") as lines:
        for row in pool.imap_unordered(drive, waiting, chunksize=1):
            lines.write(json.dumps(row) + "\n")
            lines.flush()


def reported(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the table: a line for each fault, of nominal drives one for each kind of stop, and then what is wrong."""
    groups = {fault: [row for row in rows if row["fault"] == fault] for fault in FAULTS}
    nominal = groups.pop("nominal")
    names = sorted({(row["scenario"], row["controller"]) for row in nominal})
    kinds = {f"{s}, {c}": [r for r in nominal if (r["scenario"], r["controller"]) == (s, c)] for s, c in names}
    yield f"{'drives':60} {'all':>5} {'check':>5} {'found':>5} {'hunt':>4} {'excess over tolerance':>22}"
    for name, some in {"nominal": nominal, **kinds, **groups}.items():
        checked = [row for row in some if row["checked"]]
        shares = [row["excess_m"] / row["tolerance_m"] for row in checked]
        most = f"{min(shares):8.2f} to {max(shares):6.2f}" if shares else ""
        found, hunting = (sum(bool(row[what]) for row in some) for what in ("missed", "hunting"))
        yield f"{name:60} {len(some):5d} {len(checked):5d} {found:5d} {hunting:4d} {most:>22}"
    for row in rows:
        if row["checked"] and bool(row["missed"]) is (row["fault"] == "nominal"):
            figures = f"excess {row['excess_m']:.3f} m, tolerance {row['tolerance_m']:.3f} m, missed {row['missed']}"
            yield f"WRONG: {row['fault']} {row['number']}: {row['scenario']}, {row['controller']}: {figures}"


def main() -> None:
    """Drive what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--nominal", type=int, default=1000)
    parser.add_argument("--planted", type=int, default=20, help="drives of each fault")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--smoke", action="store_true", help="two drives, only to see that it runs")
    asked = parser.parse_args()
    if asked.smoke:
        with tempfile.TemporaryDirectory() as scratch:
            measure([case(*one) for one in SMOKE], Path(scratch), 2)
        return
    if asked.folder is None:
        parser.error("expected a folder for the rows")
    counts = {fault: asked.nominal if fault == "nominal" else asked.planted for fault in FAULTS}
    cases = [case(fault, number) for fault, count in counts.items() for number in range(count)]
    measure(cases, asked.folder, asked.processes)


def measure(cases: Sequence[Case], folder: Path, processes: int) -> None:
    """Drive what a folder does not hold of these cases and print their table."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "rows.jsonl"
    drive_all(cases, file, processes)
    wanted = {(one.fault, one.number) for one in cases}
    print("\n".join(reported([row for row in rows_in(file) if (row["fault"], row["number"]) in wanted])))


if __name__ == "__main__":
    main()
