"""Arming machine that gateway and observer have: the arming state, why a drive ends, and what operator's commands do.

The table in `arming` says where an event leads; this module keeps what belongs to the state. It knows no car, setpoint
or clock: its owner finds what occurs, hands it in, and does with the car what follows from a change of state.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from typing import Final

from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING, ArmingEvent, transition
from vve_sumo.vehicle.setpoint_validation import Debounce

# Found once, for every step: looking them up in their class costs a call.
_ENGAGED, _STOPPING, _STOPPED, _FAULT = (
    ArmingState.ENGAGED, ArmingState.STOPPING, ArmingState.STOPPED, ArmingState.FAULT
)  # fmt: skip


class OperatorCommand(enum.StrEnum):
    """A deliberate command of the operator."""

    ENGAGE = "engage"  #: take the car over at rest, and hold it
    GO = "go"  #: let it move
    STOP = "stop"
    STOP_BY_PAGE = "stop_by_page"  #: whoever has the page in a browser asks to stop; nobody knows who that is
    END = "end"  #: the drive is over: bring the car to rest
    DISARM = "disarm"


#: Commands that stop the car, whoever gives them.
STOPS: Final = frozenset({OperatorCommand.STOP, OperatorCommand.STOP_BY_PAGE})

#: Commands that end a drive, and the reason code that each leaves.
ENDS: Final[dict[OperatorCommand, str]] = {
    OperatorCommand.STOP: "stop_asked",
    OperatorCommand.STOP_BY_PAGE: "stop_asked_by_page",
    OperatorCommand.END: "drive_over",
}


class ArmingMachine:
    """Arming state of one drive after another, with the causes and the notes that its status reports.

    A stopped car counts as parked once it has been reported so for `parked_time` [s] without a break. `changed` is
    called with the event after each change of state.
    """

    def __init__(self, parked_time: float, changed: Callable[[ArmingEvent], None] | None = None) -> None:
        self.state = ArmingState.DISARMED
        #: Reason codes of why the car is being stopped or no longer commanded: each once, first cause first.
        self.causes: dict[str, None] = {}
        self.notes: list[str] = []  #: what an operator should know of this step only
        self._changed = changed
        self._parked_long = Debounce(parked_time)
        self._has_been_engaged = False
        self._go = False  # the operator has said go
        self._before = self.state  # at the step's begin
        self._latched: frozenset[str] = frozenset()  # overrides of this step
        self._old_overrides: frozenset[str] = frozenset()  # those latched since before engaging

    @property
    def going(self) -> bool:
        """Whether the car may move: it is engaged, and the operator has said go."""
        return self.state is _ENGAGED and self._go

    @property
    def ended(self) -> bool:
        """Whether a drive was begun and ended: the car was engaged, and is no longer commanded."""
        return self._has_been_engaged and self.state not in COMMANDING

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reason codes of the status: the causes, then the notes, each once."""
        return tuple(dict.fromkeys([*self.causes, *self.notes])) if self.causes or self.notes else ()

    def begin_step(self, notes: Sequence[str], overrides: frozenset[str]) -> None:
        """Begin a step with its first `notes`; `overrides` names the modules whose driver override is latched."""
        self.notes = [*notes]
        self._latched = overrides
        self._before = self.state

    # What a step finds.

    def judge_idle(self, missing: Sequence[str]) -> None:
        """Judge a car that is not commanded by the reason codes of what is `missing` for engaging."""
        self.apply(ArmingEvent.CONDITIONS_LOST if missing else ArmingEvent.CONDITIONS_MET)
        self.notes += missing

    def new_overrides(self, settled: bool = False) -> frozenset[str]:
        """Modules whose override counts; to be asked once at each step of a commanded car.

        An override that was latched before engaging does not count until it was reset, or once all is `settled`.
        """
        self._old_overrides = frozenset() if settled else self._old_overrides & self._latched
        return self._latched - self._old_overrides

    def judge_pedals(self, signs: Sequence[str]) -> None:
        """Stop a car under way on whose pedals the driver's foot is, by these `signs`."""
        if signs and (self.state is _STOPPING or self.going):
            self.apply(ArmingEvent.DRIVER, signs)

    def judge(self, now: float, faults: Sequence[str], *, expired: bool, at_rest: bool, parked: bool) -> None:
        """Judge a commanded car by `faults`, whether its setpoint has `expired`, and whether it stands or is parked."""
        if faults:
            self.apply(ArmingEvent.FAULT, faults)
        if expired and self.state is _ENGAGED:
            self.apply(ArmingEvent.EXPIRED, ["setpoint_expired"])
        if at_rest:
            self.apply(ArmingEvent.AT_REST)
        if self._parked_long.step(now, parked and self.state is _STOPPED):
            self.apply(ArmingEvent.PARKED)

    def apply_command(self, command: OperatorCommand, may_go: bool, obstacles: Sequence[str] = ()) -> None:
        """Carry out an operator's command; where the car must not move, a GO is noted with what stands in its way."""
        if self.state is _FAULT and self._before is not _FAULT:
            return  # a command given in the state before must not acknowledge a fault that nobody has seen yet
        match command:
            case OperatorCommand.ENGAGE:
                self.apply(ArmingEvent.ENGAGE)
            case OperatorCommand.GO if self.going:
                pass
            case OperatorCommand.GO if may_go and self.state is _ENGAGED:
                self.apply(ArmingEvent.GO)
                self._go = True
            case OperatorCommand.GO:
                self.notes += ["go_too_early", *obstacles]
            case OperatorCommand.DISARM:
                self.apply(ArmingEvent.DISARM, ["disarm_asked"])
            case _:
                self.apply(ArmingEvent.STOP, [ENDS[command]])

    def apply(self, event: ArmingEvent, causes: Sequence[str] = ()) -> None:
        """Apply `event` to the arming state, and keep the causes of what ends the drive."""
        before, after = self.state, transition(self.state, event)
        self.state = after
        if after is _FAULT and before not in COMMANDING and before is not after:
            self.causes.clear()  # why the drive before ended is another story
        if before in COMMANDING or after is _FAULT:
            self.causes.update(dict.fromkeys(causes))
        if after is before:
            return
        if after is _ENGAGED:
            self._begin_drive()
        elif event is ArmingEvent.DISARM and after is ArmingState.DISARMED:
            self.causes.clear()
        if self._changed is not None:
            self._changed(event)

    def _begin_drive(self) -> None:
        self.causes.clear()
        self._has_been_engaged, self._go = True, False
        self._parked_long.reset()
        self._old_overrides = self._latched
