"""Reads CommonRoad files with commonroad-io and prints what it found as JSON; a process of its own runs this."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import commonroad.common
import lxml.etree
from commonroad.common.file_reader import CommonRoadFileReader

SCHEMA = Path(commonroad.common.__file__).parent / "xml_definition_files" / "XML_commonRoad_XSD.xsd"


def read(file: str) -> dict[str, Any]:
    scenario, problems = CommonRoadFileReader(file).open()
    schema = lxml.etree.XMLSchema(lxml.etree.parse(str(SCHEMA)))
    schema.validate(lxml.etree.parse(file))
    network = scenario.lanelet_network
    (problem,) = problems.planning_problem_dict.values()
    moving = {}
    for one in scenario.dynamic_obstacles:
        states = [one.initial_state, *one.prediction.trajectory.state_list]
        moving[one.obstacle_id] = {
            "type": one.obstacle_type.value,
            "size": [one.obstacle_shape.length, one.obstacle_shape.width],
            "states": [[s.time_step, *s.position.tolist(), s.orientation, s.velocity] for s in states],
            "on": [network.find_lanelet_by_position([s.position])[0] for s in states],
            "reaches_goal": bool(problem.goal.is_reached(states[-1])),
        }
    initial = problem.initial_state
    return {
        "id": str(scenario.scenario_id),
        "dt": scenario.dt,
        "lanelets": {
            one.lanelet_id: {
                "centre": one.center_vertices.tolist(),
                "width": float(((one.left_vertices[0] - one.right_vertices[0]) ** 2).sum() ** 0.5),
                "types": sorted(kind.value for kind in one.lanelet_type),
                "successor": one.successor,
                "predecessor": one.predecessor,
                "left": one.adj_left,
                "right": one.adj_right,
            }
            for one in network.lanelets
        },
        "moving": moving,
        "standing": [
            [one.obstacle_type.value, *one.initial_state.position.tolist(), one.initial_state.orientation]
            for one in scenario.static_obstacles
        ],
        "initial": [initial.time_step, *initial.position.tolist(), initial.orientation, initial.velocity],
        "departures": [error.message for error in schema.error_log],
    }


if __name__ == "__main__":
    print(json.dumps([read(file) for file in sys.argv[1:]]))
