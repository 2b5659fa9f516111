"""The calibration drive with car, gateway and controller alone: no street, no SUMO, and a record of what was said.

The car is what it really is, the gateway and the controller know what is declared: here the two may differ in anything.
"""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import numpy as np

from tests import vehicles
from tests.setpoints import setpoint
from vve_sumo.bus import candump_lines
from vve_sumo.controller import load
from vve_sumo.frames import Alignment, MapFrame, Placement
from vve_sumo.path import ReferencePath
from vve_sumo.plant.car import Car, CarOutput, CarParameters
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.values import ArmingState, Detections, Frame, Observation, Setpoint
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway

REPOSITORY = Path(__file__).parent.parent.parent
PERIOD, EPOCH = 0.02, 1_451_260_818.0
SPEED = 8.0  # desired [m/s]
LONGEST = 120.0  # a drive that has not ended by then never will [s]
NOTHING = Detections(0.0, *(np.empty(0) for _ in range(3)), np.empty(0, np.int8))


class CalibrationDrive:
    """Drives `calibration_run` on a straight and writes pose.bin, can.log and scenario.json as it goes."""

    def __init__(self, parameters: CarParameters, seed: int, length: float = 300.0, part: str = "whole") -> None:
        lot = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-83 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
        heading = math.radians(20.0)
        along = np.array([0.0, length])
        self.path = ReferencePath.from_points(along * math.cos(heading), along * math.sin(heading))
        self.car = Car(parameters, (0.0, 0.0, heading), lot, EPOCH, np.random.SeedSequence(seed))
        self._decoder, self._predictor = Decoder(), Predictor()
        self._placement = Placement(lot, Alignment(), vehicles.FUSION.mounting, EPOCH)
        vehicle = vehicles.FUSION.vehicle
        self._gateway = Gateway(vehicle, vehicles.FUSION.calibration, period=PERIOD)
        self._controller = load("calibration_run", vehicle, {"part": part}, [REPOSITORY / "controllers"])
        self._act: OperatorCommand | None = None
        self._chunks: list[bytes] = []
        self._lines: list[str] = []
        self.notes: list[str] = []  #: one a tick
        self.d: list[float] = []  #: of the true rear axle from the path, one a tick [m]
        self.speeds: list[float] = []  #: true, one a tick [m/s]

    def run(self) -> float:
        """Drive until the car rests; return how long it took [s]."""
        heard, rested = CarOutput([], []), 0
        for tick in range(round(LONGEST / PERIOD)):
            frames = self._tick(tick, heard)
            heard = self.car.step((tick + 1) * PERIOD, frames)
            rested = rested + 1 if self.notes[-1] in ("stop", "hold") and self.speeds[-1] == 0.0 else 0
            if rested * PERIOD > 1.0:
                return tick * PERIOD
        raise AssertionError(f"no end: {self.notes[-1]}")

    @property
    def position(self) -> tuple[float, float]:
        """Where the rear axle really is [m]."""
        truth = self.car.truth()
        return truth.x, truth.y

    def write(self, folder: Path) -> Path:
        """Write the record."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "pose.bin").write_bytes(b"".join(self._chunks))
        (folder / "can.log").write_text("".join(self._lines))
        model = vehicles.FUSION.to_dict()
        declared = {"scenario": "calibration", "epoch_gnss_s": EPOCH, "vehicle": model.pop("vehicle")}
        (folder / "scenario.json").write_text(json.dumps(declared | {"vehicle_model": model}))
        return folder

    def _tick(self, tick: int, heard: CarOutput) -> tuple[Frame, ...]:
        now = tick * PERIOD
        for time, data in heard.packets:
            self._chunks.append(struct.pack("<dI", time, len(data)) + data)
            for fix in self._decoder.feed(data, time):
                self._predictor.update(self._placement.place(fix))
        for time, frame in heard.reports:
            self._lines.append(candump_lines(EPOCH + time, "can0", [frame]))
        reports = [frame for _time, frame in heard.reports]
        output = self._gateway.step(now, self._setpoint(tick, now), reports, self._act)
        status = output.status
        waiting = status.state is ArmingState.ENGAGED and "waiting_for_go" in status.reasons
        self._act = (
            OperatorCommand.ENGAGE if status.state is ArmingState.READY else OperatorCommand.GO if waiting else None
        )
        self._lines.append(candump_lines(EPOCH + now, "can0", output.frames))
        return output.frames

    def _setpoint(self, tick: int, now: float) -> Setpoint | None:
        pose, truth = self._predictor.at(now), self.car.truth()
        self.speeds.append(truth.speed)
        self.d.append(self.path.project(truth.x, truth.y).d)
        if pose is None:
            self.notes.append("")
            return None
        steering = self._gateway.monitor.measured_steering
        wish = self._controller.step(Observation(tick, now, pose, self.path, SPEED, {"radar": NOTHING}, steering))
        self.notes.append(wish.note)
        return setpoint(
            wish.steering,
            wish.acceleration,
            emergency=wish.emergency,
            note=wish.note,
            sequence=tick,
            time=now,
            expires=now + 0.1,
            **{name: getattr(pose, name) for name in ("x", "y", "heading", "speed", "yaw_rate", "grade")},
        )
