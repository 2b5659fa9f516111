"""`vve-sumo ros2`: shows a drive as ROS 2 topics, and lets a node drive."""

from __future__ import annotations

import argparse
import os
import shlex
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.rig.schema import Rig

EXIT_CODES = """exit codes:
  0  it ended with Ctrl-C, SIGTERM or the node that it had started
  2  wrong use or configuration, or the packages of the extra are missing
  3  a port or the domain cannot be opened
  70  a defect of vve_sumo; its traceback says where
"""

SUMMARY = "show a drive as ROS 2 topics, and let a ROS 2 node drive"
TEXT = """\
The bridge runs beside the drive, in a terminal of its own, and stays for any number of drives. It hears the rig's wires
`ncom`, `scene`, `radar` and `sense` and publishes clock, transforms, odometry, fix, IMU, what the sensors measured,
bodies, path and diagnostics, on this machine alone. With `brain.kind = "setpoints"` a node's velocity commands go to
the gateway as setpoints, under the same checks as any external controller's. Needs pip install 'vve-sumo[ros2]', and no
ROS; docs/ros2.md says more.

examples:
  vve-sumo ros2 parked_car --rig ros2
  vve-sumo ros2 parked_car --rig ros2 --node 'python examples/ros2/follow_and_stop.py'
  vve-sumo drive parked_car --rig ros2 --lockstep      in another terminal; or live, without --lockstep
"""

#: keeps a node that the bridge starts to this machine, as the bridge is
LOCALHOST: Final = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "scenario", nargs="?", default="parked_car", help="that is driven: a name or .toml file (default: parked_car)"
    )
    parser.add_argument("--rig", metavar="NAME", required=True, help="of the drive: a name under rigs/ or a .toml file")
    parser.add_argument(
        "--node",
        metavar="COMMAND",
        help="start a node in the rig's domain, kept to this machine; the bridge ends with it, and it with the bridge",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the bridge until it is told to end; return the exit code."""
    from vve_sumo import workspace
    from vve_sumo.bridges.ros2.process import BridgeProcess, Node
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.live.priority import DRIVE_NICE, raise_priority
    from vve_sumo.rig.load import load

    working = Path.cwd()
    rig = load(workspace.find("rig", arguments.rig, working), working)
    command = [] if arguments.node is None else shlex.split(arguments.node)
    if arguments.node is not None and not command:
        raise ConfigError("--node: expected the command that starts the node, got nothing")
    resolved = resolve_by_name(arguments.scenario, working, rig=arguments.rig)
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _frame: ended.append(got))
    bridge = BridgeProcess(rig, resolved, working)
    raise_priority(DRIVE_NICE)  # of the node, too: a setpoint that comes late stops the car
    try:
        node = Node(command, working, _environment(rig)) if command else None
        try:

            def over() -> bool:
                return bool(ended) or (node is not None and node.ended)

            if node is not None:
                bridge.await_node(over)
            bridge.listen()
            notify(f"ros2: domain {rig.ros2.domain_id}, this machine alone; {_takes(rig)}")
            bridge.run(over)
        finally:
            if node is not None:
                node.close()
        notify(f"ros2: {bridge.report()}")
    finally:
        bridge.close()
    return 0


def _takes(rig: Rig) -> str:
    from vve_sumo.bridges.ros2.bridge import COMMANDS

    topic, kind = COMMANDS[rig.ros2.commands]
    return f"commands on {topic} ({kind})" if rig.brain.kind == "setpoints" else "it takes no commands"


def _environment(rig: Rig) -> dict[str, Any]:
    return {**os.environ, **LOCALHOST, "ROS_DOMAIN_ID": str(rig.ros2.domain_id)}
