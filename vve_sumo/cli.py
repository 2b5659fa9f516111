"""The face of the package: parses, calls, prints. Everything heavy is imported by the command that needs it."""

from __future__ import annotations

import argparse
import csv
import io
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from vve_sumo import __version__
from vve_sumo.errors import ConfigError, VveError

EXIT_CODES = """exit codes:
  0  good
  1  the drive ran and failed its criteria
  2  wrong use or configuration; nothing was written
  3  the rig is not ready
  4  the simulation broke
  130  interrupted from the keyboard before the drive began
"""

SUITE_CODES = """exit codes:
  0  no row failed that physics allowed
  1  one did, or was not driven as the standard wants it
  2  wrong use or configuration; nothing was written
  130  interrupted from the keyboard; there is no table then
"""

SWEEP_CODES = """exit codes:
  0  every run is a row, passed or not; of --rerun: the record is the same
  1  of --rerun: it is not
  2  wrong use or configuration; nothing was driven
  4  every run broke, or the disk is full
  130  interrupted from the keyboard; --resume goes on
"""

STUDY_CODES = """exit codes:
  0  every run is a row, passed or not
  2  wrong use or configuration; nothing was driven
  4  every run broke, or the disk is full
  130  interrupted from the keyboard; --resume goes on
"""

COMPARE_CODES = """exit codes:
  0  compared, however far apart they are
  2  wrong use, or not the records of two drives
"""

NOTEBOOK_CODES = """exit codes:
  0  the notebooks are there
  2  wrong use, or the folder holds one of them; nothing was written
"""

REPORT_CODES = """exit codes:
  0  the report was written, also of a drive that failed
  2  wrong use, or no record and no sweep; nothing was written
"""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, then where to read on."""

    def error(self, message: str) -> None:  # type: ignore[override]
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="vve-sumo",
        description="Vehicle in Virtual Environment testing on SUMO: a real drive-by-wire car, a virtual street.",
        epilog="Start with `vve-sumo drive`: it drives the hardware-free car towards a parked car in Linden.\n\n"
        + EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"vve-sumo {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    _add_drive(commands)
    _add_scenarios(commands)
    _add_suite(commands)
    _add_sweep(commands)
    _add_study(commands)
    _add_doctor(commands)
    _add_align(commands)
    _add_calibrate(commands)
    _add_replay(commands)
    _add_redrive(commands)
    _add_report(commands)
    _add_compare(commands)
    _add_pose(commands)
    _add_path(commands)
    _add_network(commands)
    _add_design(commands)
    _add_init(commands)
    _add_notebooks(commands)
    return parser


Commands = "argparse._SubParsersAction[_Parser]"


def _add(
    commands: Commands,  # type: ignore[valid-type]
    name: str,
    summary: str,
    text: str,
    codes: str = EXIT_CODES,
) -> argparse.ArgumentParser:
    added: argparse.ArgumentParser = commands.add_parser(  # type: ignore[attr-defined]
        name, help=summary, description=text, epilog=codes, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    return added


def _add_drive(commands: Commands) -> None:  # type: ignore[valid-type]
    drive = _add(
        commands,
        "drive",
        "drive a scenario: in lockstep, live on a rig, or with a recorded drive",
        "Drive a scenario in lockstep with the hardware-free car: NCOM bytes in, drive-by-wire CAN frames out,\n"
        "traffic by SUMO. With --rig, drive it live: real time, real buses, a real car. Leaves a record folder with\n"
        "summary.json and drive.png.\n\n"
        "examples:\n"
        "  vve-sumo drive                                the paper's drive: a car parked in the middle of the road\n"
        "  vve-sumo drive parked_car --seed 7 --out a    another seed, record in folder a\n"
        "  vve-sumo drive --controller mine.py:make      your own controller\n"
        "  vve-sumo drive --vehicle lincoln_mkz          another car\n"
        "  vve-sumo drive --rig rigs/ours.toml --lockstep   the simulated vehicle as the rig calibrates it\n"
        "  vve-sumo drive --pose drive.csv               a recorded drive through the same chain; nothing obeys\n"
        "  vve-sumo drive --rig twin                     live, with the hardware-free car as a process of its own\n"
        "  vve-sumo drive parked_car --rig rigs/ours.toml --shadow   live, with every enable bit off\n\n"
        "live keys: e engages, g goes, any other key, Ctrl-C or closing the terminal stops. The emergency stop is the\n"
        "driver's brake.",
    )
    drive.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    drive.add_argument("--out", type=Path, metavar="DIR", help="record folder, absent or empty (default: under runs/)")
    drive.add_argument("--seed", type=int, metavar="N", help="instead of the scenario's seed")
    drive.add_argument("--controller", metavar="NAME", help="shipped name, file.py:make or entry point")
    drive.add_argument("--vehicle", metavar="NAME", help="instead of the scenario's: under vehicles/, or a .toml file")
    drive.add_argument(
        "--pose",
        type=Path,
        metavar="FILE",
        help="send a recorded drive through the chain, laid on the street by matched start: NCOM bytes, or CSV with "
        "time_s,latitude_deg,longitude_deg,heading_deg,speed_mps; commands are computed and logged, nobody obeys",
    )
    drive.add_argument("--rig", metavar="NAME", help="drive live on this rig: a name under rigs/ or a .toml file")
    drive.add_argument(
        "--lockstep",
        action="store_true",
        help="with --rig: not live, but with the simulated vehicle as the rig declares and calibrates it",
    )
    drive.add_argument("--shadow", action="store_true", help="live, with everything but the enable bits")
    drive.add_argument("--operator", metavar="NAME", help="live, for the record: who is at the console")
    drive.add_argument("--driver", metavar="NAME", help="live, for the record: who sits behind the wheel")
    drive.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    drive.set_defaults(run=_drive)


def _add_suite(commands: Commands) -> None:  # type: ignore[valid-type]
    suite = _add(
        commands,
        "suite",
        "drive a standard's tests on the test track: a pass/fail table",
        "Drive every row of a standard's table with the hardware-free car on a long straight track, and say which are\n"
        "passed, which failed, and whether the brakes could have done it at all. Without a name: list the suites.\n\n"
        "examples:\n"
        "  vve-sumo suite                            the list\n"
        "  vve-sumo suite r152 --out r152            the table, also as CSV, JSON and Markdown\n"
        "  vve-sumo suite r152 --seeds 10 --out r152 ten drives a row; a row is passed where all of them are\n"
        "  vve-sumo suite r152 --seeds 10 --out r152 --resume   go on after a kill\n"
        "  vve-sumo suite fmvss127 --out a --keep    with the full record of every drive\n"
        "  vve-sumo suite r152 --controller mine.py:make",
        SUITE_CODES,
    )
    suite.add_argument("name", nargs="?", help="of the suite")
    suite.add_argument("--out", type=Path, metavar="DIR", help="folder for the table, absent or empty")
    suite.add_argument("--seeds", type=int, default=1, metavar="N", help="drives of each row, by seed (default: 1)")
    suite.add_argument("--workers", type=int, metavar="N", help="drives at a time (default: as many as processors)")
    suite.add_argument("--controller", metavar="NAME", help="shipped name, file.py:make or entry point, untuned")
    suite.add_argument(
        "--vehicle",
        default="ford_fusion",
        metavar="NAME",
        help="under vehicles/, or a .toml file (default: ford_fusion)",
    )
    suite.add_argument("--keep", action="store_true", help="keep every drive's record under DIR/records")
    suite.add_argument("--resume", action="store_true", help="go on with the suite in DIR; finished drives stay")
    suite.set_defaults(run=_suite)


def _add_sweep(commands: Commands) -> None:  # type: ignore[valid-type]
    sweep = _add(
        commands,
        "sweep",
        "drive a scenario many times, its parameters varied, into one dataset",
        "Drive every run that a sweep's file asks for, each in a process of its own, and leave a row for each in a\n"
        "Parquet dataset. A run that crashes, hangs or eats memory is a row with its reason. Ctrl-C, a kill or a full\n"
        "disk lose nothing finished.\n\n"
        "examples:\n"
        "  vve-sumo sweep parked_car_speeds --out speeds            a file under sweeps/\n"
        "  vve-sumo sweep mine.toml --out mine --keep failed        with full records of what failed\n"
        "  vve-sumo sweep mine.toml --out mine --resume             go on after a kill\n"
        "  vve-sumo sweep seen_late_speed --search --out found      where a criterion flips, or the worst case\n"
        "  vve-sumo sweep --rerun mine 0f3a9c1b5d7e2a48             one run again: is its record the same?",
        SWEEP_CODES,
    )
    sweep.add_argument("spec", nargs="?", help="name or .toml file")
    sweep.add_argument("--out", type=Path, metavar="DIR", help="folder of the dataset; of --rerun: of the record")
    sweep.add_argument("--workers", type=int, metavar="N", help="runs at a time (default: as many as processors)")
    sweep.add_argument("--resume", action="store_true", help="go on with the sweep in DIR; finished runs stay")
    sweep.add_argument("--search", action="store_true", help="insist that the file has a [search], and look for that")
    sweep.add_argument("--yes", action="store_true", help="drive 100,000 runs or more")
    sweep.add_argument(
        "--keep", metavar="WHOSE", help="full records: none, failed, all or KEY,KEY (default: the file's)"
    )
    sweep.add_argument("--vehicle", metavar="NAME", help="instead of the scenario's: under vehicles/, or a .toml file")
    sweep.add_argument("--cluster", metavar="ADDRESS", help="drive on the workers of a Dask scheduler")
    sweep.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    sweep.add_argument("--rerun", nargs=2, metavar=("DIR", "KEY"), help="drive one run of a dataset again and compare")
    sweep.set_defaults(run=_sweep)


def _add_study(commands: Commands) -> None:  # type: ignore[valid-type]
    study = _add(commands, "study", "standard studies of a scenario", "Standard studies of a scenario.", STUDY_CODES)
    inner = study.add_subparsers(dest="what", metavar="WHAT", required=True, parser_class=_Parser)
    cliff = _add(
        inner,
        "cliff",
        "how much delay and noise a scenario bears before its margin is gone",
        "Drive a scenario again and again while the pose gets later and noisier, step by step, and say where its\n"
        "margin goes to zero. The delay is hidden: fixes are older than their epoch says, so that nothing can predict\n"
        "it away, as when a clock is wrong. Beside what happened stand the closed form, speed times delay, which is\n"
        "what an open-loop brake loses, and the delay that the steering bears by its design. The folder is a sweep's\n"
        "dataset with the picture cliff.png.\n\n"
        "The margin is the gap at rest, the least gap of a drive that goes on, zero or less after a contact. A car\n"
        "that its gateway stopped far off (unstable steering, wheels and pose at odds) has none.\n\n"
        "examples:\n"
        "  vve-sumo study cliff parked_car --out cliff               0 to 500 ms, noise x 0, 1, 4, three seeds\n"
        "  vve-sumo study cliff seen_late --out late --delays-ms 0,100,200,300 --noise 1 --seeds 5\n"
        "  vve-sumo study cliff delay_probe --out probe              nothing regulates: speed times delay, exactly\n"
        "  vve-sumo study cliff parked_car --out cliff --resume      go on after a kill",
        STUDY_CODES,
    )
    cliff.add_argument("scenario", help="name or .toml file")
    cliff.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the dataset, absent or empty")
    cliff.add_argument(
        "--delays-ms", type=_numbers, metavar="MS,MS", help="hidden delays, 0 to 1000 (default: 0 to 500 by 50)"
    )
    cliff.add_argument(
        "--noise",
        type=_numbers,
        metavar="X,X",
        help="factors on the receiver's noise (default: 0,1,4; 0 where the scenario turns it off)",
    )
    cliff.add_argument(
        "--seeds", type=int, metavar="N", help="drives of each step (default: 3; 1 where nothing is left to chance)"
    )
    cliff.add_argument("--workers", type=int, metavar="N", help="runs at a time (default: as many as processors)")
    cliff.add_argument("--resume", action="store_true", help="go on with the study in DIR; finished runs stay")
    cliff.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")
    cliff.set_defaults(run=_study_cliff)


def _add_scenarios(commands: Commands) -> None:  # type: ignore[valid-type]
    scenarios = _add(
        commands,
        "scenarios",
        "list the scenarios, draw one as a picture, write their schema",
        "List every scenario with a line: what it is, who is there, what a drive must come to.\n\n"
        "examples:\n"
        "  vve-sumo scenarios                            the list\n"
        "  vve-sumo scenarios show cut_in --out cut.png  a picture: the street, who moves how, what fires when\n"
        "  vve-sumo scenarios schema --out scenario.schema.json   for editors that complete and check",
    )
    scenarios.set_defaults(run=_scenarios_listed)
    inner = scenarios.add_subparsers(dest="what", metavar="WHAT", required=False, parser_class=_Parser)
    show = _add(
        inner,
        "show",
        "draw a scenario as a PNG file",
        "Draw the street from above, the ego's path, everybody's line of motion, and where and when triggers fire if\n"
        "the ego never braked. Nothing is driven.",
    )
    show.add_argument("scenario", nargs="?", help="name or .toml file")
    show.add_argument("--out", type=Path, metavar="PNG", help="picture to write (default: NAME.png here)")
    show.add_argument("--all", dest="every", type=Path, metavar="DIR", help="draw every scenario into a folder")
    show.set_defaults(run=_scenarios_shown)
    schema = _add(
        inner, "schema", "print the JSON Schema of a scenario file", "Print the JSON Schema of a scenario file."
    )
    schema.add_argument("--out", type=Path, metavar="FILE", help="write it into a file instead")
    schema.set_defaults(run=_scenarios_schema)


def _add_doctor(commands: Commands) -> None:  # type: ignore[valid-type]
    doctor = _add(
        commands,
        "doctor",
        "go or no-go before a drive: machine, scenario, and with --rig the rig",
        "Look at everything that a drive needs, say what was found, and what to do about what is not good enough.\n"
        "With --rig it listens to the receiver and to the car's bus for some seconds; it sends nothing to a real car.\n"
        "Ends with GO (exit code 0) or NO-GO (3).",
    )
    doctor.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    doctor.add_argument("--rig", metavar="NAME", help="a name under rigs/ or a .toml file")
    doctor.set_defaults(run=_doctor)


def _add_align(commands: Commands) -> None:  # type: ignore[valid-type]
    align = _add(
        commands,
        "align",
        "lay a scenario's path into a rig's lot and store how",
        "Find how the lot lies on the virtual street, say whether the path fits, and write it into the rig file.\n\n"
        "examples:\n"
        "  vve-sumo align --rig ours                     the car stands at the path's start: make that the start\n"
        "  vve-sumo align --rig ours --pairs places.csv  by places that were surveyed in the lot and on the street\n"
        "  vve-sumo align --rig ours --fit --picture lot.png   no car needed: where the path has most room\n"
        "  vve-sumo align --rig ours --fit --cut short.csv     and where it does not fit, the part of it that does",
    )
    align.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    align.add_argument("--rig", metavar="NAME", required=True, help="a name under rigs/ or a .toml file")
    how = align.add_mutually_exclusive_group()
    how.add_argument(
        "--pairs",
        type=Path,
        metavar="FILE",
        help="CSV with lot_latitude_deg, lot_longitude_deg and street_x_m, street_y_m (or street_latitude_deg, "
        "street_longitude_deg), two rows or more",
    )
    how.add_argument("--fit", action="store_true", help="search the turn and shift that leave most room")
    align.add_argument("--cut", type=Path, metavar="CSV", help="with --fit: write what fits of a path too long")
    align.add_argument("--picture", type=Path, metavar="FILE", help="draw lot, path and start as a PNG file")
    align.add_argument(
        "--store", "--yes", dest="store", action="store_true", help="store without asking; --fit stores only with this"
    )
    align.set_defaults(run=_align)


def _add_replay(commands: Commands) -> None:  # type: ignore[valid-type]
    replay = _add(
        commands,
        "replay",
        "run a record through the chain again and find the first difference",
        "Feed a record's pose bytes, car reports and actors to the same chain and the same gateway, without SUMO and\n"
        "without a car, and compare every setpoint and every CAN frame, bit for bit. The record is verified before:\n"
        "one that was altered is not replayed, nor is a controller run whose code has changed. Exit code 1 names what\n"
        "was altered, or the first tick of the drive, or step of the gateway, that differs.",
    )
    replay.add_argument("record", type=Path, metavar="DIR", help="folder of a drive, in lockstep or live, or cut off")
    replay.set_defaults(run=_replay)


def _add_calibrate(commands: Commands) -> None:  # type: ignore[valid-type]
    calibrate = _add(
        commands,
        "calibrate",
        "find brakes, throttle, steering and delays of a car by a short drive",
        "Drive the calibration run on a rig (about 270 m straight ahead, 70 s) and fit brake and throttle maps,\n"
        "steering ratio and bias, delays and the receiver's misalignment; each with its uncertainty and a verdict.\n\n"
        "examples:\n"
        "  vve-sumo calibrate --rig twin                       drive, fit, show\n"
        "  vve-sumo calibrate --rig ours --write               and put what was found, dated, into rigs/ours.toml\n"
        "  vve-sumo calibrate --rig ours --record runs/DIR     fit a record that is there already",
    )
    calibrate.add_argument("--rig", metavar="NAME", required=True, help="a name under rigs/ or a .toml file")
    calibrate.add_argument("--record", type=Path, metavar="DIR", help="of a drive, instead of driving")
    calibrate.add_argument(
        "--out", type=Path, metavar="DIR", help="record folder, absent or empty (default: under runs/)"
    )
    calibrate.add_argument("--write", action="store_true", help="change the rig file; comments stay")
    calibrate.add_argument(
        "--leave",
        type=_names,
        default=(),
        metavar="KEY,KEY",
        help="poor numbers that the rig file keeps as they are",
    )
    calibrate.set_defaults(run=_calibrate)


def _add_redrive(commands: Commands) -> None:  # type: ignore[valid-type]
    redrive = _add(
        commands,
        "redrive",
        "ask another controller on a record's inputs, open loop",
        "Feed a record's pose bytes, car reports and actors to another controller and compare its answers with those\n"
        "recorded, tick by tick. Open loop: the car did what the recorded controller said. Leaves redrive.png in DIR.",
    )
    redrive.add_argument("record", type=Path, metavar="DIR", help="folder of a drive, in lockstep or live, or cut off")
    redrive.add_argument(
        "--controller", metavar="NAME", required=True, help="shipped name, file.py:make or entry point"
    )
    redrive.add_argument("--out", type=Path, metavar="FILE", help="both answers of every tick, as .parquet or .csv")
    redrive.set_defaults(run=_redrive)


def _add_compare(commands: Commands) -> None:  # type: ignore[valid-type]
    compare = _add(
        commands,
        "compare",
        "compare two records: a real drive and its virtual twin, or any two",
        "Lay two records together at first motion and say how far apart they are: RMSE, correlation, Theil's U and\n"
        "time shift of each signal, and what each drive came to.\n\n"
        "examples:\n"
        "  vve-sumo compare runs/lot runs/lockstep               a live drive and its twin in lockstep\n"
        "  vve-sumo compare runs/a runs/b --out difference.png   two of anything, and a picture",
        COMPARE_CODES,
    )
    compare.add_argument("one", type=Path, metavar="ONE", help="folder of a drive")
    compare.add_argument("other", type=Path, metavar="OTHER", help="folder of another; differences are other minus one")
    compare.add_argument("--out", type=Path, metavar="PNG", help="picture to write")
    compare.set_defaults(run=_compare)


def _add_report(commands: Commands) -> None:  # type: ignore[valid-type]
    report = _add(
        commands,
        "report",
        "one page on a drive or a sweep that anybody can read",
        "Write report.html into a record's or a sweep's folder: what was asked, what happened, passed or failed,\n"
        "plots, versions, hashes, how to do it again. The page is one file that opens offline; its plots lie in\n"
        "report/ too. An earlier report is replaced. A drive that was killed and a sweep that goes on are told as far\n"
        "as they came.\n\n"
        "examples:\n"
        "  vve-sumo report runs/mine      of a drive's record\n"
        "  vve-sumo report speeds         of a sweep's, a search's or a study's folder",
        REPORT_CODES,
    )
    report.add_argument("folder", type=Path, metavar="DIR", help="folder of the record or of the sweep")
    report.set_defaults(run=_report)


def _add_pose(commands: Commands) -> None:  # type: ignore[valid-type]
    pose = _add(commands, "pose", "look into pose recordings", "Look into what a positioning receiver said.")
    inner = pose.add_subparsers(dest="what", metavar="WHAT", required=True, parser_class=_Parser)
    decode = _add(
        inner,
        "decode",
        "write what an NCOM file holds as CSV",
        "Write one CSV row for every accepted fix of an OXTS NCOM file, and whether a car could drive on it.",
    )
    decode.add_argument("file", type=Path, metavar="FILE", help="raw NCOM bytes as received")
    decode.add_argument("--csv", type=Path, required=True, metavar="OUT", help="CSV file to write")
    decode.set_defaults(run=_pose_decode)


def _add_path(commands: Commands) -> None:  # type: ignore[valid-type]
    path = _add(commands, "path", "record the ego's path", "Record paths in the virtual world.")
    inner = path.add_subparsers(dest="what", metavar="WHAT", required=True, parser_class=_Parser)
    record = _add(
        inner,
        "record",
        "drive from edge to edge and write the way as latitude and longitude",
        "Let a SUMO car drive through the network and write its smoothed track as CSV for the ego's rear axle.\n"
        "An edge whose name begins with a minus is given as --from=-21405924#2.",
    )
    record.add_argument("network", help="name or .net.xml file")
    record.add_argument("--from", dest="start", required=True, metavar="EDGE", help="edge to start on")
    record.add_argument("--to", dest="end", required=True, metavar="EDGE", help="edge to end on")
    record.add_argument("--via", type=_names, default=(), metavar="EDGE,EDGE", help="edges to pass, in order")
    record.add_argument(
        "--from-position", type=float, default=0.0, metavar="M", help="on the first edge, from its start (default: 0)"
    )
    record.add_argument("--to-position", type=float, metavar="M", help="on the last edge (default: its end)")
    record.add_argument(
        "--tolerance",
        type=float,
        default=0.3,
        metavar="M",
        help="how far the smooth path may leave the middle of the lanes (default: 0.3)",
    )
    record.add_argument(
        "--vehicle", default="ford_fusion", metavar="NAME", help="that shall drive it (default: ford_fusion)"
    )
    record.add_argument("--out", type=Path, required=True, metavar="CSV", help="file to write")
    record.set_defaults(run=_path_record)


def _add_network(commands: Commands) -> None:  # type: ignore[valid-type]
    network = _add(commands, "network", "build networks and their traffic", "Build networks and their traffic.")
    inner = network.add_subparsers(dest="what", metavar="WHAT", required=True, parser_class=_Parser)
    build = _add(
        inner,
        "build",
        "turn an OpenStreetMap extract into a SUMO network",
        "Turn an OpenStreetMap extract into a SUMO network with a projection of its own centre and US rules.\n"
        "Needs netconvert: pip install eclipse-sumo==1.28.0.",
    )
    build.add_argument("extract", type=Path, metavar="OSM", help=".osm.xml or .osm.xml.gz, already cut to the area")
    build.add_argument("--out", type=Path, required=True, metavar="NET", help="network file to write (.net.xml)")
    build.add_argument(
        "--origin",
        type=_latitude_longitude,
        metavar="LAT,LON",
        help="centre of the projection in degrees (default: the middle of the extract)",
    )
    build.add_argument(
        "--signals",
        type=_names,
        default=(),
        metavar="NODE,NODE",
        help="OpenStreetMap nodes that carry a traffic signal although the extract does not say so",
    )
    build.add_argument("--speeds", type=Path, metavar="TYP", help="SUMO type map of speed limits (default: US ones)")
    build.set_defaults(run=_network_build)
    edges = _add(
        inner,
        "edges",
        "list the edges of streets, to choose a path's from",
        "List the edges whose street's name holds a text: name, length, lanes, and from where to where in the map [m].",
    )
    edges.add_argument("network", help="name or .net.xml file")
    edges.add_argument("street", nargs="?", default="", help="part of a street's name (default: all)")
    edges.set_defaults(run=_network_edges)
    demand = _add(
        inner,
        "demand",
        "write seeded traffic for a network",
        "Write a SUMO route file with seeded random traffic that starts at once and lasts.",
    )
    demand.add_argument("network", help="name or .net.xml file")
    demand.add_argument("--level", choices=("light", "moderate", "heavy"), required=True, help="how much traffic")
    demand.add_argument("--seed", type=int, default=43211, metavar="N", help="of the random choice (default: 43211)")
    demand.add_argument(
        "--clear",
        type=_names,
        default=(),
        metavar="EDGE,EDGE",
        help="edges where no vehicle comes out of nothing or vanishes: those of the ego's path",
    )
    demand.add_argument("--path", metavar="NAME", help="path whose edges stay clear, a name under routes/ or a file")
    demand.add_argument(
        "--unhindered",
        metavar="NAME",
        help="path over which nobody has the right of way: others go around the junctions where the ego would have to "
        "give way, at signals too",
    )
    demand.add_argument("--out", type=Path, required=True, metavar="ROU", help="route file to write (.rou.xml)")
    demand.set_defaults(run=_network_demand)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name for name in text.split(",") if name)


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected numbers such as 0,100,200, got {text!r}") from None


def _latitude_longitude(text: str) -> tuple[float, float]:
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected degrees such as 40.004,-82.971, got {text!r}") from None
    return latitude, longitude


def _add_design(commands: Commands) -> None:  # type: ignore[valid-type]
    design = _add(
        commands,
        "design",
        "margins of the steering loop over speed; refuses what the latency would eat",
        "Print gain, phase and delay margin of the shipped steering gains over the speed range, by python-control.\n"
        "Refuses (exit 2) a design whose delay margin is below the stated latency.",
    )
    design.add_argument("scenario", nargs="?", default="parked_car", help="whose tuning (default: parked_car)")
    design.add_argument("--latency-ms", type=float, default=100.0, metavar="MS", help="end to end (default: 100)")
    design.set_defaults(run=_design)


def _add_init(commands: Commands) -> None:  # type: ignore[valid-type]
    init = _add(
        commands,
        "init",
        "lay out a workspace of your own",
        "Copy the shipped controllers, networks, notebooks, rigs, routes, scenarios, sweeps and vehicles into a\n"
        "folder. Run vve-sumo from there: your files win over shipped ones of the same name.",
    )
    init.add_argument("folder", type=Path, metavar="DIR", help="folder to lay out; existing files are never replaced")
    init.set_defaults(run=_init)


def _add_notebooks(commands: Commands) -> None:  # type: ignore[valid-type]
    notebooks = _add(
        commands,
        "notebooks",
        "copy out four Jupyter notebooks to begin an analysis with",
        "Copy four notebooks into a folder: the paper's drive, stopping over a sweep of speeds, the latency cliff, a\n"
        "recording through the chain. Each makes its own records, under runs/ beside it, and explains what it shows.",
        NOTEBOOK_CODES,
    )
    notebooks.add_argument(
        "folder", type=Path, metavar="DIR", help="folder for them; existing files are never replaced"
    )
    notebooks.set_defaults(run=_notebooks)


def _drive(arguments: argparse.Namespace) -> int:
    if arguments.rig is not None and arguments.vehicle is not None:
        raise ConfigError("--vehicle: a rig brings its own vehicle; leave out one of --vehicle and --rig")
    if arguments.rig is not None and not arguments.lockstep:
        return _drive_live(arguments)
    if arguments.rig is None and arguments.lockstep:
        raise ConfigError(
            "--lockstep: every drive without a rig is one; name the rig whose car is simulated with --rig"
        )
    if arguments.shadow:
        raise ConfigError("--shadow: only a live drive has enable bits to leave off; name the rig with --rig")
    for who in ("operator", "driver"):
        if getattr(arguments, who) is not None:
            raise ConfigError(f"--{who}: only a live drive has one; name the rig with --rig")
    from vve_sumo.drive.command import drive

    return drive(
        arguments.scenario,
        out=arguments.out,
        seed=arguments.seed,
        controller=arguments.controller,
        pose=arguments.pose,
        quiet=arguments.quiet,
        vehicle=arguments.vehicle,
        rig=arguments.rig,
    )


def _drive_live(arguments: argparse.Namespace) -> int:
    if arguments.pose is not None:
        raise ConfigError("--pose: a live drive has its pose from the rig; leave out one of --pose and --rig")
    from vve_sumo.live.command import drive_live

    return drive_live(
        arguments.scenario,
        arguments.rig,
        out=arguments.out,
        seed=arguments.seed,
        controller=arguments.controller,
        shadow=arguments.shadow,
        operator=arguments.operator,
        driver=arguments.driver,
    )


def _suite(arguments: argparse.Namespace) -> int:
    from vve_sumo.suite.command import Asked, suite

    asked = Asked(
        out=arguments.out,
        seeds=arguments.seeds,
        workers=arguments.workers,
        controller=arguments.controller,
        vehicle=arguments.vehicle,
        keep=arguments.keep,
        resume=arguments.resume,
    )
    return suite(arguments.name, asked)


def _sweep(arguments: argparse.Namespace) -> int:
    from vve_sumo.sweep.command import rerun, sweep

    if arguments.rerun is not None:
        if arguments.spec is not None:
            raise ConfigError("--rerun: its folder knows what was driven; leave out the sweep's name")
        return rerun(Path(arguments.rerun[0]), arguments.rerun[1], arguments.out)
    if arguments.spec is None or arguments.out is None:
        from vve_sumo.workspace import known

        there = ", ".join(known("sweep", Path.cwd()))
        raise ConfigError(
            f"sweep: expected a sweep's name or file and --out DIR (see vve-sumo sweep --help); known: {there}"
        )
    return sweep(
        arguments.spec,
        out=arguments.out,
        workers=arguments.workers,
        resume=arguments.resume,
        yes=arguments.yes,
        keep=arguments.keep,
        cluster=arguments.cluster,
        quiet=arguments.quiet,
        search=arguments.search,
        vehicle=arguments.vehicle,
    )


def _study_cliff(arguments: argparse.Namespace) -> int:
    from vve_sumo.study import cliff

    return cliff(
        arguments.scenario,
        out=arguments.out,
        delays_ms=arguments.delays_ms,
        factors=arguments.noise,
        seeds=arguments.seeds,
        workers=arguments.workers,
        resume=arguments.resume,
        quiet=arguments.quiet,
    )


def _scenarios_listed(arguments: argparse.Namespace) -> int:
    from vve_sumo.drive.library import listed

    return listed()


def _scenarios_shown(arguments: argparse.Namespace) -> int:
    from vve_sumo.drive.library import shown

    return shown(arguments.scenario, arguments.out, arguments.every)


def _scenarios_schema(arguments: argparse.Namespace) -> int:
    from vve_sumo.drive.library import schema

    return schema(arguments.out)


def _doctor(arguments: argparse.Namespace) -> int:
    from vve_sumo.commissioning.doctor import doctor

    return doctor(arguments.scenario, arguments.rig)


def _align(arguments: argparse.Namespace) -> int:
    from vve_sumo.commissioning.align import align

    return align(
        arguments.scenario,
        arguments.rig,
        pairs=arguments.pairs,
        search=arguments.fit,
        cut_to=arguments.cut,
        picture=arguments.picture,
        agreed=arguments.store,
    )


def _replay(arguments: argparse.Namespace) -> int:
    from vve_sumo.live.review import replayed

    return replayed(arguments.record)


def _calibrate(arguments: argparse.Namespace) -> int:
    from vve_sumo.commissioning.calibration_drive import calibrate

    return calibrate(
        arguments.rig, record=arguments.record, out=arguments.out, write=arguments.write, leave=arguments.leave
    )


def _redrive(arguments: argparse.Namespace) -> int:
    from vve_sumo.live.review import redriven

    return redriven(arguments.record, arguments.controller, arguments.out)


def _report(arguments: argparse.Namespace) -> int:
    from vve_sumo.report.command import report

    return report(arguments.folder)


def _pose_decode(arguments: argparse.Namespace) -> int:
    from vve_sumo.pose.table import write_csv

    decoder = write_csv(arguments.file, arguments.csv)
    counts = ", ".join(f"{count} {outcome}" for outcome, count in decoder.counts.items() if count)
    print(f"{arguments.file}: {decoder.packets} packets ({counts}), {decoder.discarded} bytes outside any packet")
    with arguments.csv.open(encoding="utf-8", newline="") as file:
        trusted = [row["trusted"] == "true" for row in csv.DictReader(file)]
    print(f"a car could drive on {sum(trusted)} of {len(trusted)} fixes; rows written to {arguments.csv}")
    return 0


def _path_record(arguments: argparse.Namespace) -> int:
    from vve_sumo.vehicle.load import load
    from vve_sumo.workspace import find
    from vve_sumo.world.survey import record_path

    tightest = load(find("vehicle", arguments.vehicle, Path.cwd())).vehicle.tightest_curvature
    survey = record_path(
        find("network", arguments.network, Path.cwd()),
        arguments.start,
        arguments.end,
        arguments.out,
        via=arguments.via,
        start_position=arguments.from_position,
        end_position=arguments.to_position,
        tolerance=arguments.tolerance,
    )
    radius = f"{1.0 / survey.curvature:.1f} m" if survey.curvature > 1e-6 else "none"
    print(f"{survey.length:.0f} m of path ({survey.points} points, tightest bend {radius}) written to {arguments.out}")
    if survey.curvature > tightest:
        print(
            f"warning: {arguments.vehicle} turns no tighter than {1.0 / tightest:.1f} m; take other edges (a U-turn?)",
            file=sys.stderr,
        )
    return 0


def _network_build(arguments: argparse.Namespace) -> int:
    from vve_sumo.workspace import shared_file
    from vve_sumo.world.build import build_network

    speeds = arguments.speeds or shared_file("networks", "us_speeds.typ.xml", Path.cwd())
    built = build_network(
        arguments.extract, arguments.out, speeds=speeds, origin=arguments.origin, signals=arguments.signals
    )
    for warning in built.warnings:
        print(f"netconvert: {warning}", file=sys.stderr)
    print(f"network written to {arguments.out}; it keeps the attribution and licence of its map data")
    return 0


def _network_demand(arguments: argparse.Namespace) -> int:
    from vve_sumo.workspace import find
    from vve_sumo.world.demand import write_demand

    drawn = write_demand(
        find("network", arguments.network, Path.cwd()),
        arguments.out,
        level=arguments.level,
        seed=arguments.seed,
        clear=(*arguments.clear, *_edges_of(arguments.path)),
        unhindered=_edges_of(arguments.unhindered),
    )
    print(f"{arguments.level} traffic of {drawn.vehicles} vehicles written to {arguments.out}")
    return 0


def _edges_of(path: str | None) -> tuple[str, ...]:
    """The edges that a path's file says it runs along."""
    if path is None:
        return ()
    from vve_sumo.drive.resolved_scenario import EDGES
    from vve_sumo.workspace import find

    file = find("path", path, Path.cwd())
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    edges = next((tuple(line[len(EDGES) :].split()) for line in lines if line.startswith(EDGES)), ())
    if not edges:
        raise ConfigError(f"{file}: no line {EDGES!r} that names the edges of the path")
    return edges


def _network_edges(arguments: argparse.Namespace) -> int:
    from vve_sumo.workspace import find
    from vve_sumo.world.network import Roads

    roads = Roads(find("network", arguments.network, Path.cwd()))
    wanted = [edge for edge in roads.edges if arguments.street.lower() in edge.getName().lower()]
    for edge in sorted(wanted, key=lambda edge: (edge.getName(), edge.getID())):
        (x, y), (end_x, end_y) = edge.getShape()[0][:2], edge.getShape()[-1][:2]
        way = f"({x:.0f}, {y:.0f}) to ({end_x:.0f}, {end_y:.0f})"
        print(
            f"{edge.getID():<16} {edge.getName():<28} {edge.getLength():7.1f} m  {edge.getLaneNumber()} lane(s)  {way}"
        )
    if not wanted:
        print(f"no street of {arguments.network} has {arguments.street!r} in its name", file=sys.stderr)
    return 0 if wanted else 1


def _design(arguments: argparse.Namespace) -> int:
    from vve_sumo.drive.command import design

    return design(arguments.scenario, arguments.latency_ms / 1000.0)


def _compare(arguments: argparse.Namespace) -> int:
    from vve_sumo.analysis.command import compare

    return compare(arguments.one, arguments.other, arguments.out)


def _init(arguments: argparse.Namespace) -> int:
    from vve_sumo.workspace import lay_out

    written = lay_out(arguments.folder)
    print(f"{len(written)} files laid out in {arguments.folder}; next: cd {arguments.folder} && vve-sumo drive")
    return 0


def _notebooks(arguments: argparse.Namespace) -> int:
    from vve_sumo.workspace import lay_out_notebooks

    written = lay_out_notebooks(arguments.folder)
    print(f"{len(written)} notebooks in {arguments.folder}; next:")
    print(f"  pip install 'vve-sumo[notebooks]' && jupyter lab {shlex.quote(str(arguments.folder))}")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; an error of ours is one line on the screen."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    parsed = _parser().parse_args(arguments)
    try:
        code: int = parsed.run(parsed)
    except VveError as error:
        print(f"vve-sumo: {error}", file=sys.stderr)
        return error.exit_code
    except BrokenPipeError:
        return 1
    except OSError as error:
        print(f"vve-sumo: {error.filename or 'a file'}: {error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("vve-sumo: interrupted", file=sys.stderr)
        return 130
    return code


if __name__ == "__main__":
    sys.exit(main())
