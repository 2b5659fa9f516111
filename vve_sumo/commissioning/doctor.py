"""The doctor: checks everything that a drive needs before it, and names what speaks against the drive.

The module puts the checks in order and turns errors into findings; the checks themselves are in other modules.
"""

from __future__ import annotations

import contextlib
import datetime
from collections.abc import Callable
from pathlib import Path

from vve_sumo import workspace
from vve_sumo.commissioning import brain_checks, doctor_result, machine_checks, people_checks, rig_checks
from vve_sumo.commissioning.findings import Check, CheckReport
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.errors import ConfigError
from vve_sumo.live import assembly
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.lock import rig_lock
from vve_sumo.rig.schema import Rig


def keep(report: CheckReport, scenario: str, rig: str, working: Path) -> None:
    """Keep the verdict on a rig for the records of later drives; nothing is kept for a rig that is not found.

    Raises OSError where it cannot be written.
    """
    with contextlib.suppress(ConfigError):
        rig_file = workspace.find("rig", rig, working)
        doctor_result.keep(rig_file, report.checks, scenario, working, datetime.datetime.now(datetime.UTC))


def examine(
    scenario: str, rig: str | None, working: Path, show: Callable[[Check], None] = lambda check: None
) -> CheckReport:
    """Make every possible check, each passed to `show` at once; on a real car's rig the checks only listen."""
    report = CheckReport(show)
    report.add(machine_checks.machine(working))
    advice = "correct the scenario, or name another one"
    resolved = report.attempt("scenario", advice, lambda: resolve_by_name(scenario, working))
    if resolved is not None:
        report.add(
            [Check("scenario", f"{resolved.name}: {resolved.path.length:.0f} m of {resolved.scenario.ego.path}")]
        )
    loaded = None
    if rig is not None:
        advice = "correct the rig file, or name another one"
        loaded = report.attempt("rig", advice, lambda: rigs.load(workspace.find("rig", rig, working), working))
    if loaded is not None:
        loaded = loaded if resolved is None else meaning.with_alignment_for(loaded, resolved.name)
        report.add([Check("rig", f"{loaded.title} ({loaded.car})")])
    _examine_dbc(report, resolved, loaded)
    if resolved is not None:
        _examine_scenario(report, resolved, loaded, working)
    if loaded is not None:
        with contextlib.ExitStack() as stack:
            hold = rig_lock(workspace.find("rig", str(rig), working), loaded)
            advice = "wait for its end; on a serial adapter a second look would close the first one's channel"
            if report.attempt("in use", advice, lambda: bool(stack.enter_context(hold))):
                rig_checks.examine(report, loaded, resolved, working)
                _examine_brain(report, loaded, working)
    return report


def _examine_dbc(report: CheckReport, resolved: ResolvedScenario | None, rig: Rig | None) -> None:
    """Check the DBC file of the interface that commands the car: the rig's, or without a rig the scenario's."""
    interface = meaning.interface_of(rig) if rig is not None else resolved.model.interface if resolved else None
    if interface is not None:
        advice = "correct the DBC file, or what names it in drive_by_wire"
        report.attempt("dbc", advice, lambda: report.add([machine_checks.dbc(interface)]))


def _examine_brain(report: CheckReport, rig: Rig, working: Path) -> None:
    """Make the checks of an external controller's setpoints and of the wires out, where the rig has them."""
    if rig.brain.kind == "setpoints":
        advice = "correct the table [brain] of the rig, or end the program that has the port"
        report.attempt("setpoints", advice, lambda: report.add([brain_checks.setpoints(rig, working)]))
    if rig.outputs:
        advice = "correct this table of the rig, or end the program that has the port or device"
        report.attempt("outputs", advice, lambda: report.add([brain_checks.outputs(rig)]))


def _examine_scenario(report: CheckReport, resolved: ResolvedScenario, rig: Rig | None, working: Path) -> None:
    """Make the checks of a scenario, with the rig's car where there is one."""
    advice = "build it again: vve-sumo network build"
    report.attempt("network", advice, lambda: report.add(machine_checks.network(resolved)))
    controller = report.attempt("controller", "correct it or its tuning", lambda: resolved.controller(working))
    if controller is not None:
        report.add([Check("controller", resolved.scenario.controller.name)])
    if rig is not None:
        fitted = report.attempt(
            "speed", "see limits.speed_mps of the rig", lambda: assembly.scenario_with_rig(resolved, rig, working)
        )
        if fitted is not None:
            resolved = fitted
            report.add([Check("speed", f"{fitted.scenario.ego.speed_mps:g} of {rig.limits.speed_mps:g} m/s allowed")])
            report.add(people_checks.people(fitted, rig))
    report.add([machine_checks.braking(resolved)])
    advice = "correct the scenario's street, traffic or obstacles"
    report.attempt("street", advice, lambda: report.add(machine_checks.virtual_road(resolved)))
