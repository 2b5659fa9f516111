"""Whole certificates in lockstep over real sockets, with the shipped brains as processes of their own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.live.stage import free_ports

#: the parked car is near the start, so that a drive takes seconds
NEAR = "obstacles.parked_car.at_m=120"
#: brain, a case that it must pass, the cases that show its bug, the defect as it is named
BUGS = [
    ("bug_acts_on_invalid", "radar_drop_out", ("radar_invalid",), "acts on radar marked invalid"),
    ("bug_ignores_age", "radar_drop_out", ("radar_ageing",), "does not check the age of the radar"),
    ("bug_swaps_sign", "", ("nominal", "radar_ghost", "radar_ghost_receding"), "sign of range rate"),
]


def certified(brain: str, folder: Path, cases: str) -> tuple[int, dict[str, Any]]:
    """Certify a shipped brain; return the exit code and the certificate."""
    gnss, radar, setpoints = free_ports(3)
    rig = folder / "foreign.toml"
    rig.write_text(
        (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
        + f'\n[brain]\nkind = "setpoints"\nport = {setpoints}\n'
        + f'\n[[outputs]]\nkind = "ncom"\nudp = "127.0.0.1:{gnss}"\n'
        + f'\n[[outputs]]\nkind = "radar"\nudp = "127.0.0.1:{radar}"\n',
        encoding="utf-8",
    )
    program = REPOSITORY / "examples" / "brains" / f"{brain}.py"
    words = f"{sys.executable} {program} {REPOSITORY / 'routes' / 'linden_17th.csv'}"
    words += f" --gnss {gnss} --radar {radar} --setpoints {setpoints}"
    out = folder / brain
    options = ["--rig", str(rig), "--brain", words, "--set", NEAR, "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "vve_sumo.cli", "certify", *options, *(("--cases", cases) if cases else ())],
        cwd=REPOSITORY,
        check=False,
        capture_output=True,
        text=True,
        timeout=3600.0,
    )
    assert done.returncode in (0, 1), done.stderr
    return done.returncode, json.loads((out / "certificate.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("brain", "passes", "fails", "defect"), BUGS)
def test_a_planted_bug_is_caught_and_named(
    brain: str, passes: str, fails: tuple[str, ...], defect: str, tmp_path: Path
) -> None:
    code, certificate = certified(brain, tmp_path, ",".join(filter(None, (passes, *fails))))
    verdicts = {result["case"]: result["verdict"] for result in certificate["results"]}
    assert code == 1
    assert [one["name"] for one in certificate["defects"]] == [defect]
    assert {name for name, verdict in verdicts.items() if verdict == "FAILED"} == set(fails)
    page = (tmp_path / brain / "report.html").read_text(encoding="utf-8")
    assert defect in page
    assert (tmp_path / brain / "cases" / fails[0] / "seed_1" / "record" / "summary.json").is_file()


@pytest.mark.slow
def test_the_right_brain_passes_every_case(tmp_path: Path) -> None:
    code, certificate = certified("stop_for_parked", tmp_path, "")
    assert [result for result in certificate["results"] if result["verdict"] != "passed"] == []
    assert (code, certificate["defects"]) == (0, [])
