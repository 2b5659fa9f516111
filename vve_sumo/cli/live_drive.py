"""A live drive as its operator meets it: the names are asked for, the console drawn, the messages printed."""

from __future__ import annotations

import datetime
import sys
from typing import TYPE_CHECKING, Any

from vve_sumo.cli.console import notify

if TYPE_CHECKING:
    from vve_sumo.live.session import Plan


def named(plan: Plan, operator: str | None, driver: str | None) -> Plan:
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


def drive(plan: Plan) -> dict[str, Any]:
    """Drive a plan to its end and return its summary; raises VveError where it never began."""
    from vve_sumo.commissioning import doctor_result
    from vve_sumo.live import session

    doctor = doctor_result.last(plan.rig_file, plan.working, datetime.datetime.now(datetime.UTC))
    return session.run(plan, doctor, sys.stderr, notify)
