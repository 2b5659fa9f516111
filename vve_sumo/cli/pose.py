"""`vve-sumo pose`: decodes recordings of positioning receivers."""

from __future__ import annotations

import argparse
import csv
import signal
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import OF_FILES, Parser, add_command, add_subcommands

if TYPE_CHECKING:
    from vve_sumo.pose.receivers.port import Receiver

EXIT_CODES = OF_FILES

SUMMARY = "decode pose recordings"


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    commands = add_subcommands(parser)
    decode = add_command(
        commands,
        "decode",
        "convert a receiver's log to CSV",
        "Write one CSV row for every accepted fix of a receiver's log, and whether it is good enough to drive on. The "
        "format is found by the content: OXTS NCOM, u-blox UBX, Septentrio SBF, NovAtel OEM7 or NMEA 0183. With --rig "
        "the log is decoded as the rig's receiver would have decoded the same bytes: NMEA holds no accuracies of "
        "velocity and heading, the rig declares them.",
        EXIT_CODES,
    )
    decode.add_argument("file", type=Path, metavar="FILE", help="bytes as the receiver sent them")
    decode.add_argument("--csv", type=Path, required=True, metavar="OUT", help="CSV file to write")
    decode.add_argument("--rig", metavar="NAME", help="a name under rigs/ or a .toml file, whose [pose] decodes")
    decode.set_defaults(run=run)
    bag = add_command(
        commands,
        "bag",
        "convert a bag of ROS to CSV",
        "Write one CSV row for every fix (sensor_msgs/NavSatFix) of a bag that has a heading (sensor_msgs/Imu); the "
        "speed is that of nav_msgs/Odometry, or of the places where the bag has none. A bag is a folder of rosbag2, an "
        "MCAP file, or a .bag of ROS 1. `vve-sumo drive --pose OUT` plays it. Needs pip install 'vve-sumo[ros2]', and "
        "no ROS.",
        EXIT_CODES,
    )
    bag.add_argument("file", type=Path, metavar="BAG", help="folder or file")
    bag.add_argument("--csv", type=Path, required=True, metavar="OUT", help="CSV file to write")
    for key, kind in (("fix", "NavSatFix"), ("imu", "Imu"), ("odom", "Odometry")):
        bag.add_argument(f"--{key}", metavar="TOPIC", help=f"of {kind}, where the bag has several")
    bag.set_defaults(run=run_bag)
    ros2 = add_command(
        commands,
        "ros2",
        "hand a ROS 2 driver's fixes on to a rig's receiver",
        "Hear sensor_msgs/NavSatFix, sensor_msgs/Imu and nav_msgs/Odometry of a receiver's driver and send each fix as "
        'NCOM to the port of the rig, `pose.kind = "ncom_udp"` on 127.0.0.1. It runs beside the drive and stays for '
        "any number of drives. Needs pip install 'vve-sumo[ros2]', and no ROS; docs/ros2.md says more.",
        EXIT_CODES,
    )
    ros2.add_argument("--rig", metavar="NAME", required=True, help="of the drive: a name under rigs/ or a .toml file")
    for key, kind in (("fix", "NavSatFix"), ("imu", "Imu"), ("odom", "Odometry")):
        topic = f"/receiver/{key}"
        ros2.add_argument(f"--{key}", metavar="TOPIC", default=topic, help=f"of {kind} (default: {topic})")
    ros2.set_defaults(run=run_ros2)


def run(arguments: argparse.Namespace) -> int:
    """Write every accepted fix of a receiver's log as a CSV row; return the exit code, 0."""
    from vve_sumo.pose.table import write_csv

    log = write_csv(arguments.file, arguments.csv, None if arguments.rig is None else _receiver(arguments.rig))
    name, message, decoder = log.format.name, log.format.message, log.decoder
    counts = ", ".join(f"{count} {outcome}" for outcome, count in decoder.counts.items() if count)
    print(
        f"{arguments.file}: {name}, {decoder.recognised} {message}s ({counts}), {decoder.discarded} bytes outside any"
    )
    with arguments.csv.open(encoding="utf-8", newline="") as file:
        trusted = [row["trusted"] == "true" for row in csv.DictReader(file)]
    print(f"a car could drive on {sum(trusted)} of {len(trusted)} fixes; rows written to {arguments.csv}")
    return 0


def _receiver(rig: str) -> Receiver:
    """Return the receiver of a rig by its name or file; raises ConfigError."""
    from vve_sumo import workspace
    from vve_sumo.rig import load
    from vve_sumo.rig.resolve import receiver_of

    return receiver_of(load.load(workspace.find("rig", rig, Path.cwd()), Path.cwd()))


def run_bag(arguments: argparse.Namespace) -> int:
    """Write every fix of a bag with a heading as a CSV row; return the exit code, 0."""
    from vve_sumo.bridges.ros2.bag_poses import write_csv

    chosen = {"fix": arguments.fix, "imu": arguments.imu, "odom": arguments.odom}
    read = write_csv(arguments.file, arguments.csv, chosen)
    print(f"{arguments.file}: {', '.join(read.topics.values())}; {read.left_out} fixes without a heading or a speed")
    print(f"{read.rows} rows written to {arguments.csv}; vve-sumo drive --pose {arguments.csv} plays them")
    return 0


def run_ros2(arguments: argparse.Namespace) -> int:
    """Hand a ROS 2 driver's fixes on until told to end; return the exit code, 0."""
    from vve_sumo import workspace
    from vve_sumo.bridges.ros2.relay import FixRelay
    from vve_sumo.live.priority import DRIVE_NICE, raise_priority
    from vve_sumo.rig.load import load

    working = Path.cwd()
    rig = load(workspace.find("rig", arguments.rig, working), working)
    topics = {"fix": arguments.fix, "imu": arguments.imu, "odom": arguments.odom}
    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _frame: ended.append(got))
    relay = FixRelay(rig, topics)
    raise_priority(DRIVE_NICE)
    try:
        heard = ", ".join(topics.values())
        notify(f"pose ros2: domain {rig.ros2.domain_id}, this machine alone; {heard} to {relay.place}")
        relay.run(lambda: bool(ended))
        notify(f"pose ros2: {relay.report()}")
    finally:
        relay.close()
    return 0
