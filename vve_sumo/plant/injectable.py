"""Which faults can be injected into a car, by what its drive-by-wire interface reports and its simulated end can do.

A fault that cannot be injected is refused, so that no drive counts as a test of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.plant.injected_faults import KINDS, InjectedFault
from vve_sumo.plant.sensor_faults import SENSOR_KINDS
from vve_sumo.pose.receivers.port import MinuteEncoder, Receiver, standard
from vve_sumo.vehicle.interface import INTERFACE_KINDS, InterfaceConfig, load

#: fault of a receiver whose messages hold the minute apart from the rest of the time
MINUTE_WRONG: Final = "pose_minute_wrong"
#: of the simulated end that is asked what it can inject; it is never stepped [s]
_STEP: Final = 0.005


def injectable_kinds(config: InterfaceConfig) -> frozenset[str]:
    """Return the kinds of fault and of driver's action that can be injected into a car with this interface.

    Raises ConfigError where the interface cannot be made or has no simulated end.
    """
    interface = load(config)
    reported = {kind for kinds in interface.facts.reports.values() for kind in kinds}
    simulated = interface.simulated(_STEP)
    # An interface of one's own may have been written before its simulated end had to say this.
    if (injectable := getattr(simulated, "injectable", None)) is None:
        raise ConfigError(
            f"interface {config.name}: {type(simulated).__name__} has no `injectable`, expected the kinds of "
            "fault that it injects: docs/vehicle.md#another-drive-by-wire-interface"
        )
    claimed = frozenset(injectable).intersection(INTERFACE_KINDS)
    shown = {kind for kind, report in SENSOR_KINDS.items() if report in reported}
    return claimed | shown | KINDS.keys() - INTERFACE_KINDS.keys() - SENSOR_KINDS.keys()


def require_injectable(
    faults: Iterable[InjectedFault], config: InterfaceConfig, receiver: Receiver | None = None
) -> None:
    """Raise ConfigError, naming fault and interface or receiver, for the first of the faults that cannot be injected.

    Without a receiver it is the standard one.
    """
    wanted = tuple(faults)
    if not wanted:
        return
    encoder = (receiver or standard()).encoder()
    if any(fault.kind == MINUTE_WRONG for fault in wanted) and not isinstance(encoder, MinuteEncoder):
        raise ConfigError(
            f"fault {MINUTE_WRONG}: it cannot be injected: no message of the receiver holds a minute alone"
        )
    injectable = injectable_kinds(config)
    for fault in wanted:
        if fault.kind in injectable:
            continue
        if fault.kind in SENSOR_KINDS:
            why = f"the interface reports no {SENSOR_KINDS[fault.kind].__name__}"
        else:
            claimed = ", ".join(sorted(injectable & INTERFACE_KINDS.keys())) or "none"
            why = f"of the kinds that an interface injects itself it can: {claimed}"
        raise ConfigError(f"fault {fault.kind}: it cannot be injected through interface {config.name}: {why}")
