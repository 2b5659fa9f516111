"""Paths that no car can travel are refused at load, with file and place; sparse and recorded ones are not."""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.drive.street import REPOSITORY, altered
from vve_sumo.drive.path_in_network import LoadedPath, read_path
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import find_reversal, refuse_tight_bend
from vve_sumo.rig.load import load as load_rig
from vve_sumo.vehicle.load import load as load_vehicle
from vve_sumo.world.network import read_network

LINDEN = read_network(REPOSITORY / "networks" / "linden.net.xml")
ROUTE = [
    (float(row["latitude_deg"]), float(row["longitude_deg"]))
    for row in csv.DictReader(
        line
        for line in (REPOSITORY / "routes" / "linden_17th.csv").read_text(encoding="utf-8").splitlines()
        if not line.startswith("#")
    )
]
VEHICLES = sorted((REPOSITORY / "vehicles").glob("*.toml"))
Write = Callable[[list[tuple[float, float]]], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(places: list[tuple[float, float]]) -> Path:
        file = tmp_path / "mine.csv"
        rows = "".join(f"{latitude:.10f},{longitude:.10f}\n" for latitude, longitude in places)
        file.write_text(f"latitude_deg,longitude_deg\n{rows}", encoding="utf-8")
        return file

    return written


def corner(spacing: float) -> list[tuple[float, float]]:
    """The last straight of the route, left by a right angle into the field beside it, by 40 m."""
    frame = LINDEN.frame()
    straight = [frame.to_map(math.radians(latitude), math.radians(longitude)) for latitude, longitude in ROUTE[300:700]]
    (ax, ay), (bx, by) = straight[-2:]
    cos, sin = -(by - ay), bx - ax
    aside = [(bx + n * spacing * cos, by + n * spacing * sin) for n in range(1, round(40.0 / spacing))]
    fine = [(bx - n * spacing * (bx - ax), by - n * spacing * (by - ay)) for n in range(round(40.0 / spacing), -1, -1)]
    return [tuple(map(math.degrees, frame.to_geodetic(x, y))) for x, y in [*straight[:-45], *fine, *aside]]


def lay(file: Path) -> LoadedPath:
    return read_path(file, LINDEN.frame(), LINDEN)


@pytest.mark.parametrize("vehicle", ["ford_fusion", "lincoln_mkz"])
def test_a_corner_tighter_than_the_car_turns_is_refused(write: Write, vehicle: str) -> None:
    file = write(corner(0.5))
    circle = 1.0 / load_vehicle(REPOSITORY / "vehicles" / f"{vehicle}.toml").vehicle.tightest_curvature
    with pytest.raises(ConfigError, match=rf"mine\.csv: at 39\d\.\d m along the path, .* {circle:.2f} m"):
        altered({"ego.path": str(file), "ego.vehicle": vehicle})


@pytest.mark.thorough
def test_a_rig_whose_car_turns_wider_refuses_a_path_that_another_car_can_travel() -> None:
    resolved = altered({"ego.path": "linden_leap"})
    rig = load_rig(REPOSITORY / "rigs" / "simulated.toml", REPOSITORY)
    resolved.with_rig(rig, REPOSITORY)
    wide = rig.vehicle.model_copy(update={"steering_wheel_limit_deg": 200.0})
    with pytest.raises(ConfigError, match=r"linden_leap\.csv: at .* the car's tightest circle, a radius of 11\.8"):
        resolved.with_rig(rig.model_copy(update={"vehicle": wide}), REPOSITORY)


@pytest.mark.parametrize("last", [400, 700])
def test_a_path_that_doubles_back_is_refused_at_its_line(write: Write, last: int) -> None:
    file = write([*ROUTE[: last + 1], *ROUTE[last - 1 : last - 100 : -1]])
    with pytest.raises(ConfigError, match=rf"mine\.csv.*line {last + 2}: .* turns back by 180 deg"):
        altered({"ego.path": str(file)})


def test_a_recording_that_rolls_back_is_refused(write: Write) -> None:
    (a, b), (c, d) = ROUTE[500:502]
    back = (0.6 * a + 0.4 * c, 0.6 * b + 0.4 * d)
    with pytest.raises(ConfigError, match=r"line 503: .* turns back"):
        lay(write([*ROUTE[:502], back, *ROUTE[502:]]))


def test_a_gap_in_a_recording_is_refused_at_its_line(write: Write) -> None:
    with pytest.raises(ConfigError, match=r"mine\.csv.*line 402: .* is 30\d m from the point before it.* most 250 m"):
        lay(write([*ROUTE[:400], *ROUTE[700:]]))


def test_a_gap_around_a_bend_is_refused_where_the_chord_leaves_the_streets(write: Write) -> None:
    frame = LINDEN.frame()
    placed = np.array([frame.to_map(*map(math.radians, place)) for place in ROUTE])
    first, last = 60, 230  # before the first bend of the route, and behind its second
    assert 50.0 < math.dist(placed[first - 1], placed[last]) < 250.0
    with pytest.raises(ConfigError, match=rf"line {first + 2}: .* at most 50 m where the path leaves the lanes"):
        lay(write([*ROUTE[:first], *ROUTE[last:]]))


@pytest.mark.parametrize("spacing", [20, 100, 200])
def test_few_points_along_a_straight_street_are_enough(write: Write, spacing: int) -> None:
    straight = ROUTE[320:321] + ROUTE[320 + spacing : 840 : spacing]
    assert lay(write(straight)).path.length == pytest.approx(spacing * (len(straight) - 1), rel=0.01)
    assert lay(write(straight[:2])).path.length == pytest.approx(spacing, rel=0.01)


def networks_of(path: str) -> set[str]:
    """Return the networks of the shipped scenarios in which an ego drives a path."""
    scenarios = [tomllib.loads(file.read_text(encoding="utf-8")) for file in (REPOSITORY / "scenarios").glob("*.toml")]
    return {
        one["road"]["network"]
        for one in scenarios
        if path in (one["ego"]["path"], *(ego.get("path") for ego in one.get("egos", ())))
    }


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda file: file.stem)
@pytest.mark.parametrize("route", sorted((REPOSITORY / "routes").glob("*.csv")), ids=lambda file: file.stem)
def test_every_shipped_route_suits_every_shipped_car(route: Path, vehicle: Path) -> None:
    (name,) = networks_of(route.stem)
    network = read_network(REPOSITORY / "networks" / f"{name}.net.xml")
    laid = read_path(route, network.frame(), network)
    refuse_tight_bend(laid.path, load_vehicle(vehicle).vehicle.tightest_curvature, route.name)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda file: file.stem)
@pytest.mark.parametrize(
    ("recording", "columns"),
    [
        ("comma2k19/tidy_pose_20hz.csv", ("east", "north")),
        ("boreas/boreas-2021-09-02-11-42_radar_poses.csv", ("easting", "northing")),
        ("boreas/boreas-2021-09-02-11-42_lidar_poses.csv", ("easting", "northing")),
    ],
)
def test_what_real_cars_have_driven_is_travelable(
    shared_data: Path, recording: str, columns: tuple[str, str], vehicle: Path
) -> None:
    """With the noise of their receivers, at a point every decimetre or more, stops included."""
    with (shared_data / "drives" / recording).open(encoding="utf-8", newline="") as file:
        driven = np.array([[float(row[column]) for column in columns] for row in csv.DictReader(file)])
    kept = [0]
    for number, place in enumerate(driven):
        if math.dist(place, driven[kept[-1]]) > 0.1:
            kept.append(number)
    points = driven[kept]
    assert find_reversal(points) is None
    path = ReferencePath.from_points(points[:, 0], points[:, 1])
    refuse_tight_bend(path, load_vehicle(vehicle).vehicle.tightest_curvature, recording)
