"""Keeps the doctor's verdict on a rig in a small file, and tells a later drive whether it may still hold.

The module makes no check and reads no clock: the caller hands in the time.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.record.hashes import hash_file

#: folder of the verdicts in the folder that the commands are run from; one file for each rig
FOLDER: Final = Path("runs") / "doctor"
#: an older verdict is about the car of another day
MAX_AGE: Final = datetime.timedelta(days=1)
CHECK_KEYS: Final = ("name", "finding", "found")  #: of each check in the file


def file_of(rig_file: Path, working: Path) -> Path:
    """Return where the verdict on a rig is kept."""
    return working / FOLDER / f"{rig_file.stem}.json"


def keep(rig_file: Path, checks: Sequence[Check], scenario: str, working: Path, now: datetime.datetime) -> None:
    """Keep what the doctor found; raises OSError where it cannot be written."""
    against = any(check.finding is CheckResult.NO_GO for check in checks)
    data = {
        "verdict": "NO-GO" if against else "GO",
        "date_utc": now.isoformat(timespec="seconds"),
        "scenario": scenario,
        "rig_file_sha256": hash_file(rig_file),
        "checks": [
            dict(zip(CHECK_KEYS, (check.name, check.finding.value, check.observed), strict=True)) for check in checks
        ],
    }
    file = file_of(rig_file, working)
    file.parent.mkdir(parents=True, exist_ok=True)
    half = file.with_suffix(".half")
    half.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    half.replace(file)


def last(rig_file: Path, working: Path, now: datetime.datetime) -> dict[str, Any]:
    """Return the verdict on a rig as it was kept, with `caveats`: why it may not hold any more.

    Its `verdict` is "none" where none was kept or where it cannot be read.
    """
    try:
        data = json.loads(file_of(rig_file, working).read_text(encoding="utf-8"))
        age = now - datetime.datetime.fromisoformat(data["date_utc"])
        of_this = data["rig_file_sha256"] == hash_file(rig_file)
        data["verdict"] = str(data["verdict"])
        data["checks"] = [{key: str(check[key]) for key in CHECK_KEYS} for check in data["checks"]]
    except (OSError, ValueError, KeyError, TypeError):
        return {"verdict": "none", "caveats": []}
    caveats = [] if of_this else ["of another version of the rig file"]
    caveats += ["older than a day"] if age > MAX_AGE else []
    caveats += ["from the future: a clock was set"] if age < datetime.timedelta() else []
    return {**data, "caveats": caveats}


def obstacle(result: dict[str, Any]) -> str | None:
    """Return why a car may not be armed on what `last` returned, in words; None where the doctor said GO of it."""
    if result["verdict"] == "none":
        return "the doctor has not examined this rig"
    if result["caveats"]:
        return f"the doctor's {result['verdict']} is {' and '.join(result['caveats'])}"
    if result["verdict"] == "GO":
        return None
    checks = result.get("checks", ())
    against = [str(check["name"]) for check in checks if check["finding"] == CheckResult.NO_GO.value]
    return f"the doctor says NO-GO: {', '.join(against)}"
