"""`vve-sumo pose`: decodes recordings of positioning receivers."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import TYPE_CHECKING

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
    )
    bag.add_argument("file", type=Path, metavar="BAG", help="folder or file")
    bag.add_argument("--csv", type=Path, required=True, metavar="OUT", help="CSV file to write")
    for key, kind in (("fix", "NavSatFix"), ("imu", "Imu"), ("odom", "Odometry")):
        bag.add_argument(f"--{key}", metavar="TOPIC", help=f"of {kind}, where the bag has several")
    bag.set_defaults(run=run_bag)


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
