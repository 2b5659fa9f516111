"""A live drive as its operator meets it: the names are asked for, the console drawn, the messages printed."""

from __future__ import annotations

import datetime
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.cli.console import notify
from vve_sumo.errors import ConfigError, RigError

if TYPE_CHECKING:
    from vve_sumo.cli.parser import Parser
    from vve_sumo.live.session import DrivePlan

MAX_REASON_LENGTH: Final = 100  #: characters of a reason to override the doctor: a line of the screen holds it


def override_argument(parser: Parser) -> None:
    """Add the option that arms a real car although the doctor did not say GO."""
    parser.add_argument(
        "--override-doctor",
        metavar="REASON",
        help="live: arm a real car although the doctor's last word on its rig is no fresh GO; shown and recorded",
    )


def named(plan: DrivePlan, operator: str | None, driver: str | None) -> DrivePlan:
    """Return a plan with who is at the console and who sits behind the wheel.

    Of a real car both are asked for where nobody has said so and there is a terminal to ask on; drive time begins
    after the answers. Raises ConfigError for what is no name.
    """
    from vve_sumo.live import session

    asks = plan.rig.car == "real" and sys.stdin.isatty()
    operator, driver = _name("operator", operator, asks=asks), _name("driver", driver, asks=asks)
    return session.named(plan, operator, driver)


def _name(role: str, name: str | None, *, asks: bool) -> str | None:
    """Return a person's name, asked for where none is given and `asks`; None where there is none."""
    from vve_sumo.live.session import person_name

    if name is None and asks:
        print(f"name of the {role} (for the record; --{role} says it): ", end="", file=sys.stderr, flush=True)
        name = sys.stdin.readline()
    return None if name is None else person_name(role, name)


def examined(plan: DrivePlan, override: str | None) -> dict[str, Any]:
    """Return the doctor's last result on a plan's rig, for the record; to be asked before anybody is asked for a name.

    A real car is armed only on a GO of this version of the rig's file, at most a day old, or with a reason to
    `override` what is against that, which the result then holds. Raises RigError where neither is there, ConfigError
    for what is no reason. A drive in which nobody is at risk is begun all the same.
    """
    from vve_sumo.commissioning import doctor_result

    reason = None if override is None else _reason(override)
    result = doctor_result.last(plan.rig_file, plan.working, datetime.datetime.now(datetime.UTC))
    obstacle = doctor_result.obstacle(result)
    if plan.rig.car != "real" or plan.shadow:
        if result["verdict"] == "NO-GO" and not result["caveats"]:
            notify(f"{obstacle}; no real car is commanded, so the drive begins all the same")
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
    """Return why the doctor is overridden, as record and screen say it; raises ConfigError for what says nothing."""
    reason = typed.strip()
    if not reason or len(reason) > MAX_REASON_LENGTH or not reason.isprintable():
        raise ConfigError(
            f"--override-doctor: expected 1 to {MAX_REASON_LENGTH} printable characters, got {reason[:80]!r}"
        )
    return reason


def drive(plan: DrivePlan, doctor: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Drive a plan to its end and return its summary; raises VveError where it never began.

    `doctor` is what `examined` returned; it is asked where nothing is given.
    """
    from vve_sumo.live import session

    return session.run(plan, examined(plan, None) if doctor is None else doctor, sys.stderr, notify)
