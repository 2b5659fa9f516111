"""Controllers that go wrong under way: the shipped one, until the car is fast enough.

When it goes wrong it says so once, as a monotonic second, in the file that the environment names.
"""

import math
import os
import resource
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from vve_sumo.controller import Controller, Maker, Tuning, load
from vve_sumo.values import ControlCommand, Observation, Vehicle
from vve_sumo.workspace import shipped_root

MOMENT = "VVE_TEST_MOMENT"  # environment variable: name of the file
SPEED = 4.4  # [m/s]
WANDER = 0.04  # road-wheel angle [rad]: 1 m aside after 12 m

WEAVE, WEAVES_IN = 0.06, 3.0  # road-wheel angle [rad] to both sides, in a period of so long [s]
BRAKES = 2.0  # [m/s2]

Spoiling = Callable[[ControlCommand], ControlCommand]


class Spoilt:
    """Answers as the shipped controller does, and from some moment on what `spoil` makes of that."""

    def __init__(self, inner: Controller, spoil: Spoiling, speed: float) -> None:
        self._inner, self._spoil, self._speed = inner, spoil, speed
        self._spoilt = False

    def step(self, observation: Observation) -> ControlCommand:
        """Answer an observation."""
        answer = self._inner.step(observation)
        if not self._spoilt and observation.pose.speed > self._speed:
            self._spoilt = True
            say_when()
        return self._spoil(answer) if self._spoilt else answer


def say_when() -> None:
    """Say that something goes wrong now."""
    Path(os.environ[MOMENT]).write_text(f"{time.monotonic()}\n")


def _maker(spoil: Spoiling, speed: float = SPEED) -> Maker:
    def make(vehicle: Vehicle, tuning: Tuning) -> Controller:
        return Spoilt(load("follow_and_stop", vehicle, tuning, [shipped_root() / "controllers"]), spoil, speed)

    return make


def _raise(answer: ControlCommand) -> ControlCommand:
    raise RuntimeError("spoilt on purpose")


def _hang(answer: ControlCommand) -> ControlCommand:
    while True:
        pass


def _busy(duration: float) -> Spoiling:
    def spoil(answer: ControlCommand) -> ControlCommand:
        end = time.monotonic() + duration
        while time.monotonic() < end:
            pass
        return answer

    return spoil


class _Limp:
    """Takes its time for every third tick."""

    def __init__(self) -> None:
        self._number = 0

    def __call__(self, answer: ControlCommand) -> ControlCommand:
        self._number += 1
        return _busy(0.030)(answer) if self._number % 3 == 0 else answer


def _weave(answer: ControlCommand) -> ControlCommand:
    return replace(answer, steering=WEAVE * math.sin(math.tau * time.monotonic() / WEAVES_IN))


raising = _maker(_raise)
not_a_number = _maker(lambda answer: replace(answer, acceleration=math.nan))
hanging = _maker(_hang)
slow = _maker(_busy(0.030))
slowish = _maker(_busy(0.012))
limping = _maker(_Limp())
racing = _maker(lambda answer: replace(answer, acceleration=2.0))
wandering = _maker(lambda answer: replace(answer, steering=-WANDER), 3.0)
weaving = _maker(_weave, 3.5)
braking = _maker(lambda answer: replace(answer, acceleration=min(answer.acceleration, -BRAKES)))


# Controllers that mean no good to their process; `hostile` drives with them.


def _block(answer: ControlCommand) -> ControlCommand:
    time.sleep(1.0)
    return answer


def _print(answer: ControlCommand) -> ControlCommand:
    print("x" * 100_000)
    return answer


class Forks:
    """Leaves a process behind that holds everything open that the drive had open."""

    def __init__(self) -> None:
        self._forked = False

    def __call__(self, answer: ControlCommand) -> ControlCommand:
        """Fork, once."""
        if not self._forked:
            self._forked = True
            if os.fork() == 0:
                time.sleep(20.0)
                os._exit(0)
        return answer


class Hoards:
    """Takes memory until there is no more; the process may have 1 GB more than it has."""

    def __init__(self) -> None:
        self._hoard: list[bytearray] = []

    def __call__(self, answer: ControlCommand) -> ControlCommand:
        """Take 32 MB more."""
        if not self._hoard:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            most = pages * resource.getpagesize() + 2**30
            resource.setrlimit(resource.RLIMIT_AS, (most, most))
        self._hoard.append(bytearray(2**25))
        return answer


blocking = _maker(_block)
printing = _maker(_print)


def forking(vehicle: Vehicle, tuning: Tuning) -> Controller:
    """Make one that forks."""
    return _maker(Forks())(vehicle, tuning)


def hoarding(vehicle: Vehicle, tuning: Tuning) -> Controller:
    """Make one that takes all memory."""
    return _maker(Hoards())(vehicle, tuning)


class Mutating:
    """Moves the very pose that it was shown by 5 m."""

    def __init__(self, inner: Controller) -> None:
        self._inner, self._said = inner, False

    def step(self, observation: Observation) -> ControlCommand:
        """Answer, and move the pose."""
        answer = self._inner.step(observation)
        if observation.pose.speed > SPEED or self._said:
            if not self._said:
                self._said = True
                say_when()
            object.__setattr__(observation.pose, "x", observation.pose.x + 5.0)
        return answer


def mutating(vehicle: Vehicle, tuning: Tuning) -> Controller:
    """Make one that alters what it is shown."""
    return Mutating(load("follow_and_stop", vehicle, tuning, [shipped_root() / "controllers"]))
