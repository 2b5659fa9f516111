"""Resolves a scenario's names to everything a drive needs: finds and hashes files, lays the path in the network's map.

Reads files and keeps none open; starts neither SUMO nor a car.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo import workspace
from vve_sumo.controller import Controller, load
from vve_sumo.drive import plugged_in
from vve_sumo.drive.actor_paths import Speeds, find_actor_paths
from vve_sumo.drive.path_in_network import MAX_DISTANCE_FROM_PATH, LoadedPath, read_path
from vve_sumo.drive.persons import find_walks, setups_of, setups_with_rig
from vve_sumo.drive.several_egos import further_ego, refuse_overlap
from vve_sumo.drive.standstill_cause import DeclaredBodies
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.lot.corridor import CorridorStretch, DeclaredCorridor
from vve_sumo.metrics.own import OwnMetrics, load_own
from vve_sumo.network_tools.buildings import buildings_file, buildings_near
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import refuse_tight_bend
from vve_sumo.people.setup import PersonSetup
from vve_sumo.people.walk import WalkPoint
from vve_sumo.record import drawings
from vve_sumo.record.layout import LAYOUT
from vve_sumo.rig.car_parameters import imperfections_of
from vve_sumo.scenario.egos import alone
from vve_sumo.scenario.load import check_criteria
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sensors.port import STANDARD, SensorSettings, configured
from vve_sumo.sensors.port import load as load_sensor
from vve_sumo.sensors.street import Building, LaneStrip, Street
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, Vehicle
from vve_sumo.vehicle.effective_deceleration import limited_to, of_model
from vve_sumo.vehicle.load import load as load_vehicle
from vve_sumo.vehicle.model import VehicleModel
from vve_sumo.version import __version__
from vve_sumo.wire.outputs import KINDS
from vve_sumo.world.intersections import intersections
from vve_sumo.world.junctions import junctions
from vve_sumo.world.network import Network, NetworkLane, read_network

if TYPE_CHECKING:
    from vve_sumo.plant.injected_faults import InjectedFault
    from vve_sumo.rig.schema import Rig

#: GNSS second of drive time 0 where no receiver gives one: 2026-01-01 00:00 UTC, with 18 leap seconds
DEFAULT_EPOCH = 1_451_260_818.0
#: libraries whose version is recorded beside our own, because a drive may go differently with another version
DECISIVE_LIBRARIES = ("libsumo", "numpy", "scipy", "pyproj")
#: role of the file of the buildings
BUILDINGS = "buildings"
#: prefix of the role of a file that the controller's tuning names; the key follows
TUNING = "tuning_"


ReadNetwork = Callable[[Path], Network]
ReadPath = Callable[[Path, MapFrame, Network], LoadedPath]


@dataclass(frozen=True, slots=True)
class ResolvedScenario:
    """A scenario with all its names resolved."""

    name: str  #: of the scenario
    scenario: Scenario
    network: Network
    demand: tuple[Path, ...]
    map_frame: MapFrame  #: of the network
    path: ReferencePath  #: of the rear axle, on the virtual road's map
    route: tuple[str, ...]  #: edges that the path runs along; empty where its file does not say
    lanes: tuple[NetworkLane, ...]  #: that come within MAX_DISTANCE_FROM_PATH of the path
    model: VehicleModel  #: of the car that drives
    files: dict[str, Path]  #: what was read, by role
    actor_paths: dict[str, ReferencePath]  #: paths of actors, by the names that they use, on the virtual road's map
    recordings: dict[str, Speeds]  #: speeds that actors replay, by the names that they use
    file: Path  #: the scenario's own
    faults: tuple[InjectedFault, ...] = ()  #: that are injected into the simulated vehicle
    people: tuple[PersonSetup, ...] = ()  #: real people on the virtual road
    walks: dict[str, tuple[WalkPoint, ...]] = field(default_factory=dict)  #: of who stands in for them, by their ids
    note: str = ""  #: what brakes the car less than declared, in one line; empty where nothing does
    ego_id: str = EGO  #: whose vehicle, path and settings these are
    others: tuple[ResolvedScenario, ...] = ()  #: the scenario of each further ego, alone, in the order of their ids
    declared: DeclaredBodies | None = None  #: of a further ego: whom the drive's scenario puts on the virtual road
    #: the scenario's metrics once they are loaded, so that those that are recorded are those that measure
    _own: dict[tuple[str, ...], OwnMetrics] = field(default_factory=dict, repr=False, compare=False)

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle as declared, braking no harder than its brakes, wire, gateway and tyres allow."""
        return self.model.vehicle

    @property
    def egos(self) -> tuple[ResolvedScenario, ...]:
        """The scenario of every ego of the drive, that of [ego] first."""
        return (self, *self.others)

    @property
    def where(self) -> str:
        """The ego's table and its file, for messages."""
        return f"{self.file}: ego" if self.ego_id == EGO else f"{self.file}: egos.{self.ego_id}"

    @property
    def corridor(self) -> DeclaredCorridor:
        """The corridor that the scenario declares beside its path; empty for none."""
        return tuple(
            CorridorStretch(one.from_m, math.inf if one.to_m is None else one.to_m, one.left_m, one.right_m)
            for one in self.scenario.ego.corridor
        )

    def to_dict(self, working: Path) -> dict[str, Any]:
        """Return what the record keeps: scenario, path, car, hashes of the files, and versions.

        The hashed code of a plug-in is that of the instance made last. Raises ConfigError as `sensors` and
        `own_metrics` do.
        """
        sensors = self.sensors()
        parts = [*plugged_in.of_scenario(self.scenario, working)]
        parts.append(plugged_in.vehicle_interface(self.model.interface.name))
        noted: dict[str, Any] = {"braking_note": self.note} if self.note else {}
        if own := self.own_metrics().declared:
            noted["metrics"] = own.to_dict()
        files = self.files | {role: file for part in parts for role, file in part.files().items()}
        files |= plugged_in.wire_files(self.model.interface)
        model = self.model.to_dict()
        return {
            "layout": LAYOUT,
            "scenario": self.name,
            "settings": self.scenario.model_dump(mode="json"),
            "period_s": PERIOD,
            "path_m": [f"{x} {y}" for x, y in self.path.points],
            "vehicle": model.pop("vehicle"),
            "vehicle_model": model,
            "sensors": {name: [*map(list, settings.table())] for name, settings in sensors.items()},
            **self._drawings(sensors),
            "files_sha256": plugged_in.digests(files),
            "versions": versions(),
            **({"faults": [fault.to_dict() for fault in self.faults]} if self.faults else {}),
            **({"people": [person.to_dict() for person in self.people]} if self.people else {}),
            **({"further_ego": further_ego(self.ego_id, self.declared)} if self.declared else {}),
        } | noted

    def controller(self, working: Path) -> Controller:
        """Make the system under test; raises ConfigError as `controller.load` does."""
        control = self.scenario.controller
        return load(control.name, self.vehicle, dict(control.tuning), workspace.controller_folders(working))

    def sensors(self) -> dict[str, SensorSettings]:
        """Return the settings of every sensor by its name, that of every scenario first.

        Raises ConfigError, naming the sensor, for an unknown kind of sensor and for a key that its kind does not have.
        """
        made: dict[str, SensorSettings] = {STANDARD: self.scenario.radar}
        for sensor in self.scenario.sensors:
            try:
                made[sensor.name] = configured(sensor.kind, sensor.settings)
            except ConfigError as error:
                raise ConfigError(f"{self.file}: sensors.{sensor.name}: {error}") from None
        return made

    def street(self) -> Street:
        """Return what the sensors may see of the street near the path; buildings where there is a file of them.

        Raises ConfigError where the file cannot be read.
        """
        lanes = [
            LaneStrip(lane.shape[:, 0], lane.shape[:, 1], lane.width)
            for lane in self.lanes
            if lane.kind in ("lane", "junction")
        ]
        signals = any(settings.sees_signals() for settings in self.sensors().values())
        crossings = intersections(self.network.path) if signals else ()
        yields = any(settings.sees_junctions() for settings in self.sensors().values())
        priorities = junctions(self.network.path, self._around_path()) if yields else ()
        return Street(self._buildings(), lanes, self.map_frame, crossings, priorities)

    def _buildings(self) -> tuple[Building, ...]:
        file = self.files.get(BUILDINGS)
        if file is None:
            return ()
        return tuple(buildings_near(file, self._around_path()))

    def _around_path(self) -> tuple[float, float, float, float]:
        """Return the box around all that is no farther from the path than MAX_DISTANCE_FROM_PATH, map [m]."""
        points = np.array(self.path.points)
        low, high = points.min(axis=0) - MAX_DISTANCE_FROM_PATH, points.max(axis=0) + MAX_DISTANCE_FROM_PATH
        return low[0], low[1], high[0], high[1]

    def own_metrics(self) -> OwnMetrics:
        """Return the metrics that the scenario's `metrics` name, loaded once, and make them known by name.

        Raises ConfigError naming the file that is wrong, and for a criterion that no metric brings.
        """
        named = self.scenario.metrics
        if named not in self._own:
            try:
                own = load_own(named)
            except ConfigError as error:
                raise ConfigError(f"{self.file}: metrics: {error}") from None
            check_criteria(self.scenario, own.declared, self.file)
            own.declared.enter()
            self._own[named] = own
        return self._own[named]

    def _check_outputs(self, rig: Rig) -> None:
        sensors = self.sensors() if any(output.sensor is not None for output in rig.outputs) else {}
        for number, output in enumerate(rig.outputs):
            contents, name = KINDS[output.kind].contents, output.sensor
            if name is None or not contents:
                continue
            if name not in sensors:
                raise ConfigError(
                    f"outputs.{number}.sensor: the scenario has no sensor {name!r}, expected {' or '.join(sensors)}"
                )
            if not {*contents} & {*sensors[name].serves}:
                carried = " or ".join(contents)
                raise ConfigError(
                    f"outputs.{number}.sensor: {name!r} serves no {carried}, which {output.kind!r} carries"
                )
            if why := KINDS[output.kind].refuses(sensors[name]):
                raise ConfigError(f"outputs.{number}: {output.kind!r} cannot carry sensor {name!r}: {why}")

    def _drawings(self, sensors: Mapping[str, SensorSettings]) -> dict[str, Any]:
        kinds = {STANDARD: STANDARD} | {sensor.name: sensor.kind for sensor in self.scenario.sensors}
        try:
            return drawings.recorded(kinds, sensors, self.vehicle)
        except ConfigError as error:
            raise ConfigError(f"{self.file}: {error}") from None

    def with_controller(self, name: str) -> ResolvedScenario:
        """Return the same scenario with another controller of its ego and default tuning, which belongs to one."""
        control = self.scenario.controller
        if name == control.name:
            return self
        other = control.model_copy(update={"name": name, "tuning": {}})
        files = {role: file for role, file in self.files.items() if not role.startswith(TUNING)}
        return replace(self, scenario=self.scenario.model_copy(update={"controller": other}), files=files)

    def with_rig(self, rig: Rig, working: Path, *, live: bool = False) -> ResolvedScenario:
        """Return the same scenario with a rig's car, the faults that are injected into it, and its people's fields.

        Raises ConfigError where the rig's vehicle model is not found, where the car cannot follow the path, where an
        outgoing wire is of a sensor that the scenario does not have or that does not serve it, and as `setups_with_rig`
        does.
        """
        # Imported here: it loads the lot's geometry, which only rigs need.
        from vve_sumo.rig.resolve import faults_of, model_of

        self._check_outputs(rig)
        file, model = workspace.find("vehicle", rig.vehicle.model, working), model_of(rig)
        refuse_tight_bend(self.path, model.vehicle.tightest_curvature, str(self.files["path"]))
        ego = self.scenario.ego.model_copy(update={"vehicle": rig.vehicle.model})
        scenario = self.scenario.model_copy(update={"ego": ego})
        model, note = with_effective_deceleration(model)
        files = self.files | {"vehicle": file}
        people = setups_with_rig(scenario, self.path, rig, live=live)
        return replace(
            self, scenario=scenario, model=model, note=note, files=files, faults=faults_of(rig), people=people
        )


def load_vehicle_model(file: Path) -> tuple[VehicleModel, str]:
    """Return a vehicle file's model, braking no harder than it can, and the line that says so where it matters.

    Raises ConfigError naming the file, also where its drive-by-wire interface cannot be made.
    """
    model = load_vehicle(file)
    try:
        return with_effective_deceleration(model)
    except ConfigError as error:
        raise ConfigError(f"{file}: drive_by_wire: {error}") from None


def with_effective_deceleration(model: VehicleModel) -> tuple[VehicleModel, str]:
    """Return a model braking no harder than it can, and the line that says so; raises ConfigError as `of_model`."""
    braking = of_model(model)
    return limited_to(model, braking), braking.shortfall_text()


@cache
def versions() -> dict[str, str]:
    """Return the versions of vve-sumo and of DECISIVE_LIBRARIES."""
    return {"vve-sumo": __version__} | {name: version(name) for name in DECISIVE_LIBRARIES}


def recorded_model(resolved: Mapping[str, Any]) -> VehicleModel:
    """Return the vehicle model from a record's `scenario.json`; raises ConfigError where it holds none."""
    try:
        return VehicleModel.from_dict({**resolved["vehicle_model"], "vehicle": resolved["vehicle"]})
    except (KeyError, TypeError) as error:
        raise ConfigError(f"scenario.json: no vehicle model of this version: {error!r}") from None


def recorded_faults(resolved: Mapping[str, Any]) -> tuple[InjectedFault, ...]:
    """Return the injected faults in a record's `scenario.json`; raises ConfigError for what is no fault."""
    from vve_sumo.plant.injected_faults import InjectedFault

    try:
        return tuple(map(InjectedFault.from_dict, resolved.get("faults", ())))
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"scenario.json: faults: none of this version: {error!r}") from None


def resolve_scenario(
    name: str,
    scenario: Scenario,
    file: Path,
    working: Path,
    *,
    network_in: ReadNetwork | None = None,
    path_in: ReadPath | None = None,
) -> ResolvedScenario:
    """Find and read what a scenario names; relative names count from the folder of the scenario's own `file`.

    `network_in` and `path_in` replace the readers of network and path, so that a caller can cache what was read.
    Raises ConfigError naming what is missing or wrong.
    """
    resolved = _resolve_ego(name, scenario, file, working, "ego", network_in or read_network, path_in or read_path)
    if not scenario.egos:
        return resolved
    paths: dict[Path, LoadedPath] = {}

    def path_once(of: Path, map_frame: MapFrame, network: Network) -> LoadedPath:
        if of not in paths:
            paths[of] = (path_in or read_path)(of, map_frame, network)
        return paths[of]

    declared = DeclaredBodies.of(scenario)
    others = tuple(
        replace(
            _resolve_ego(
                name, alone(scenario, one), file, working, f"egos.{one.id}", lambda _file: resolved.network, path_once
            ),
            ego_id=one.id,
            declared=declared,
        )
        for one in sorted(scenario.egos, key=lambda one: one.id)
    )
    refuse_overlap((resolved, *others))
    return replace(resolved, others=others)


def _resolve_ego(
    name: str,
    scenario: Scenario,
    file: Path,
    working: Path,
    table: str,
    network_in: ReadNetwork,
    path_in: ReadPath,
) -> ResolvedScenario:
    """Return what `resolve_scenario` does of a scenario's one ego, whose `table` messages name."""

    def find(kind: str, name: str, key: str) -> Path:
        try:
            return workspace.find(kind, name, working, beside=file.parent)
        except ConfigError as error:
            raise ConfigError(f"{file}: {key}: {error}") from None

    network = network_in(find("network", scenario.road.network, "road.network"))
    demand = tuple(find("demand", wanted, "road.demand") for wanted in scenario.road.demand)
    path_file = find("path", scenario.ego.path, f"{table}.path")
    vehicle_file = find("vehicle", scenario.ego.vehicle, f"{table}.vehicle")
    try:
        map_frame = network.frame()
    except ConfigError as error:
        raise ConfigError(f"{network.path}: {error}") from None
    laid = path_in(path_file, map_frame, network)
    path = laid.path
    model = load_vehicle(vehicle_file)
    refuse_tight_bend(path, model.vehicle.tightest_curvature, str(path_file))
    for obstacle in scenario.obstacles:
        if obstacle.at_m > path.length:
            raise ConfigError(
                f"{file}: obstacles: {obstacle.id}: at_m {obstacle.at_m:g} lies beyond the path's {path.length:.1f} m"
            )

    for number, stretch in enumerate(scenario.ego.corridor):
        for key, at in (("from_m", stretch.from_m), ("to_m", stretch.to_m)):
            if at is not None and at > path.length:
                raise ConfigError(
                    f"{file}: {table}.corridor.{number}.{key}: {at:g} lies beyond the path's {path.length:.1f} m"
                )

    def read(of: Path) -> ReferencePath:
        return path_in(of, map_frame, network).path

    model, note = load_vehicle_model(vehicle_file)
    try:
        imperfections_of(model, scenario.ego.car)
    except ConfigError as error:
        raise ConfigError(f"{file}: {table}.car.{error}") from None
    followed = find_actor_paths(scenario.actors, file, path, find, read)
    walks = find_walks(scenario.people, find)
    files = {"network": network.path, "path": path_file, "vehicle": vehicle_file, **followed.files, **walks.files}
    files |= {f"demand_{number}": found for number, found in enumerate(demand)}
    if (buildings := _seen_buildings(scenario, network)) is not None:
        files |= {BUILDINGS: buildings}
    files |= _tuning_files(scenario, working)
    return ResolvedScenario(
        name=name,
        scenario=scenario,
        network=network,
        demand=demand,
        map_frame=map_frame,
        path=path,
        route=laid.edges,
        lanes=laid.lanes,
        model=model,
        note=note,
        files=files,
        actor_paths=followed.lines,
        recordings=followed.recordings,
        file=file,
        people=setups_of(scenario, path, file),
        walks=walks.points,
    )


def _tuning_files(scenario: Scenario, working: Path) -> dict[str, Path]:
    """Return the files that texts of the controller's tuning name, such as an FMU, by role."""
    texts = {key: value for key, value in scenario.controller.tuning.items() if isinstance(value, str)}
    files = {f"{TUNING}{key}": working / text for key, text in texts.items() if Path(text).suffix}
    return {role: file for role, file in files.items() if file.is_file()}


def _seen_buildings(scenario: Scenario, network: Network) -> Path | None:
    """Return the file of the buildings beside a network, where there is one and a sensor sees them."""
    file = buildings_file(network.path)
    if file is None or not any(load_sensor(one.kind).sees_street() for one in scenario.sensors):
        return None
    return file
