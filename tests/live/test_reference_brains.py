"""The reference brains drive to the parked car in lockstep, each by the wires that it sees by, and stop before it."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import shapely
from shapely.affinity import rotate, translate

from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.isolated import command
from tests.live.lockstep import running, write_rig
from tests.live.records import SHORTER
from tests.live.stage import free_port, rows
from tests.vehicles import FUSION

GAP, WITHIN = 5.0, 0.7  # at rest [m]


class Reference(NamedTuple):
    """A reference brain, and the wire that it needs besides NCOM and the radar datagrams."""

    program: str
    option: str = ""  #: of the program, for the wire
    output: str = ""  #: of the rig, for the wire
    sensor: str = ""  #: kind of a further sensor of the scenario, for the wire
    settings: str = ""  #: of that sensor


BRAINS = (
    Reference("stop_for_parked.py"),
    Reference("stop_by_esr.py", "--esr slcan:{folder}/esr.pty",
              'kind = "esr"\ninterface = "slcan"\nchannel = "pty:{folder}/esr.pty"\nhost = "bus"'),
    Reference("stop_by_osi.py", "--osi {port}", 'kind = "osi_data"\nudp = "127.0.0.1:{port}"'),
    Reference("stop_by_sense.py", "--camera slcan:{folder}/camera.pty",
              'kind = "mobileye"\nsensor = "other"\ninterface = "slcan"\nchannel = "pty:{folder}/camera.pty"',
              "camera"),
    Reference("stop_by_sense.py", "--lidar {port}",
              'kind = "vlp16"\nsensor = "other"\nudp = "127.0.0.1:{port}"', "lidar"),
    Reference("stop_by_sense.py", "--v2x {port}", 'kind = "v2x"\nsensor = "other"\nudp = "127.0.0.1:{port}"', "v2x",
              "settings = { position_sigma_m = 0.0 }\n"),
)  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("seed", with_slow([1, 2, 3], lambda seed: seed == 1))
@pytest.mark.parametrize(
    "brain",
    with_slow(BRAINS, lambda brain: brain.program == "stop_by_esr.py"),
    ids=lambda brain: f"{brain.program} {brain.sensor}".strip(),
)
def test_it_stops_before_the_parked_car(brain: Reference, seed: int, tmp_path: Path) -> None:
    if "osi" in brain.program and importlib.util.find_spec("osi3") is None:
        pytest.skip("needs osi-python")
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        assert old in scenario
        scenario = scenario.replace(old, new)
    if brain.sensor:
        scenario += f'\n[[sensors]]\nname = "other"\nkind = "{brain.sensor}"\n{brain.settings}'
    (tmp_path / "short.toml").write_text(scenario, encoding="utf-8")
    places = {"folder": tmp_path, "port": free_port()}
    wire = f"\n[[outputs]]\n{brain.output.format(**places)}\n" if brain.output else ""
    gnss, radar, setpoints = write_rig(tmp_path, more=wire)
    words = [sys.executable, str(REPOSITORY / "examples/brains" / brain.program)]
    words += [str(REPOSITORY / "routes" / "linden_17th.csv"), "--speed", "5.0", *brain.option.format(**places).split()]
    words += ["--gnss", str(gnss), "--radar", str(radar), "--setpoints", str(setpoints)]
    with running(words, radar):
        how = ("--rig", "foreign.toml", "--lockstep", "--quiet", "--seed", str(seed), "--out", "record")
        done = command("drive", "short.toml", *how, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert max(row["true_speed_mps"] for row in rows(tmp_path / "record", "ticks")) > 4.0
    assert gap_at_rest(tmp_path / "record") == pytest.approx(GAP, abs=WITHIN)


def gap_at_rest(record: Path) -> float:
    """Return the distance between the bodies of the ego and of the parked car at the last tick [m], by shapely."""
    ego, car = rows(record, "ticks")[-1], [one for one in rows(record, "actors") if one["actor"] == "parked_car"][-1]
    assert abs(ego["true_speed_mps"]) < 0.01
    vehicle = FUSION.vehicle
    ahead = vehicle.rear_axle_to_bumper - 0.5 * vehicle.length
    heading = ego["true_heading_rad"]
    x, y = ego["true_x_m"] + ahead * math.cos(heading), ego["true_y_m"] + ahead * math.sin(heading)
    body = _body(x, y, heading, vehicle.length, vehicle.width)
    parked = _body(car["x_m"], car["y_m"], car["heading_rad"], car["length_m"], car["width_m"])
    return float(body.distance(parked))


def _body(x: float, y: float, heading: float, length: float, width: float) -> shapely.Polygon:
    box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    return translate(rotate(box, heading, (0.0, 0.0), use_radians=True), x, y)
