"""The operator's side of a live drive: asks for the names, draws the console, prints the messages."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.cli.console import notify
from vve_sumo.errors import ConfigError, RigError

if TYPE_CHECKING:
    from vve_sumo.cli.parser import Parser
    from vve_sumo.live.plan import DrivePlan

MAX_REASON_LENGTH: Final = 100  #: longest reason to override the doctor, one line of the screen [characters]


def override_argument(parser: Parser) -> None:
    """Add the option that arms a real car without a GO of the doctor."""
    parser.add_argument(
        "--override-doctor",
        metavar="REASON",
        help="live: arm a real car although the doctor's last verdict on its rig is not a recent GO; shown and "
        "recorded",
    )


def named(plan: DrivePlan, operator: str | None, driver: str | None) -> DrivePlan:
    """Return a plan with the names of the operator and of the safety driver.

    For a real car a missing name is asked for on the terminal, if there is one; drive time begins after the answers.
    Raises ConfigError for an invalid name.
    """
    from vve_sumo.live import session

    ask = plan.rig.car == "real" and sys.stdin.isatty()
    operator, driver = _name("operator", operator, ask=ask), _name("driver", driver, ask=ask)
    return session.named(plan, operator, driver)


def _name(role: str, name: str | None, *, ask: bool) -> str | None:
    """Return a person's name, with `ask` read from the terminal where none is given; None where there is none."""
    from vve_sumo.live.session import person_name

    if name is None and ask:
        print(f"name of the {role} (for the record; --{role} says it): ", end="", file=sys.stderr, flush=True)
        name = sys.stdin.readline()
    return None if name is None else person_name(role, name)


def examined(plan: DrivePlan, override: str | None) -> dict[str, Any]:
    """Return the doctor's last result on a plan's rig, for the record; call this before names are asked for.

    A real car is armed only on a GO for this version of the rig's file that is at most a day old, or with a reason to
    `override` the missing GO, which the result then contains. Raises RigError where there is neither, ConfigError for
    an invalid reason. A drive that commands no real car begins in any case.
    """
    from vve_sumo.commissioning import doctor_result

    reason = None if override is None else _reason(override)
    result = doctor_result.last(plan.rig_file, plan.working, datetime.datetime.now(datetime.UTC))
    obstacle = doctor_result.obstacle(result)
    if plan.rig.car != "real" or plan.shadow:
        if result["verdict"] == "NO-GO" and not result["caveats"]:
            notify(f"{obstacle}; no real car is commanded, so the drive begins anyway")
        return result
    if obstacle is None:
        return result
    if reason is None:
        raise RigError(
            f"{plan.rig_file}: {obstacle}; run vve-sumo doctor {plan.resolved.name} --rig {plan.rig_file} until "
            "it says GO, or give --override-doctor REASON"
        )
    return result | {"override": reason}


def _reason(typed: str) -> str:
    """Return the reason to override the doctor, without outer spaces; raises ConfigError for an invalid one."""
    reason = typed.strip()
    if not reason or len(reason) > MAX_REASON_LENGTH or not reason.isprintable():
        raise ConfigError(
            f"--override-doctor: expected 1 to {MAX_REASON_LENGTH} printable characters, got {reason[:80]!r}"
        )
    return reason


def drive(plan: DrivePlan, doctors: Mapping[str, Mapping[str, Any]] | None = None) -> dict[str, Any]:
    """Drive a plan to its end and return its summary; raises VveError where the drive did not begin.

    `doctors` are the results of `examined` for each real car, by the ids of their egos; None calls it here.
    """
    from vve_sumo.live import session

    results = {one.ego: examined(one, None) for one in plan.cars} if doctors is None else dict(doctors)
    return session.run(plan, results.pop(plan.ego), sys.stderr, notify, results)
