"""Runs a module's tests against its mutants, each in a forked child, and says which mutants lived.

The child forks where everything is imported that does not depend on the module, gets the changed code in place of the
module's own, and runs only the tests that reach the changed lines, those first that have found most. What a test
reaches is recorded once, on the unchanged module: up to the changed line a mutant does what the module does, so nothing
is missed.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import resource
import signal
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final, NamedTuple

import pytest

from tests.mutation.mutants import Mutant, mutants

REPOSITORY: Final = Path(__file__).parent.parent.parent
PATIENCE: Final = 5.0  # processor time that a test may take longer than on the unchanged module [s]
MEMORY: Final = 4 << 30  # that a mutant may take [bytes]
TIMED_OUT, BROKEN = 70, 99  # exit statuses of a child
#: Exit statuses that say nothing of the mutant: pytest was misused, found no test, or never came to run.
NOT_TRIED: Final = (pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED, BROKEN)


class Subject(NamedTuple):
    """A module and what is run against its mutants."""

    module: str
    tests: tuple[str, ...]  #: files or single tests, seen from the root of the repository

    @property
    def path(self) -> Path:
        return REPOSITORY / (self.module.replace(".", "/") + ".py")


class Outcome(NamedTuple):
    """What became of a mutant."""

    mutant: Mutant
    killer: str  #: the test that failed, or "timeout", "import"; empty when it lived
    tests: int  #: that reach the changed line


class Reached(NamedTuple):
    """What the tests do on the unchanged module."""

    seconds: dict[str, float]  #: processor time of every test
    lines: dict[str, frozenset[int]]  #: of the module, that every test runs
    at_import: frozenset[int]
    independent: tuple[str, ...]  #: modules that can be imported without the module

    def tests_of(self, mutant: Mutant) -> list[str]:
        """Return the tests that can notice the mutant."""
        if not self.at_import.isdisjoint(mutant.lines):
            return list(self.seconds)
        return [test for test, lines in self.lines.items() if not lines.isdisjoint(mutant.lines)]


def explore(subject: Subject) -> Reached:
    """Run all tests on the unchanged module; raises RuntimeError when one fails."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        _in_child(lambda: _explore(subject, writing))
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        data = pipe.read()
    _, status = os.waitpid(pid, 0)
    if os.waitstatus_to_exitcode(status) != 0 or not data:
        raise RuntimeError(f"{subject.module}: its tests fail on the unchanged module ({', '.join(subject.tests)})")
    reached: Reached = pickle.loads(data)
    return reached


def judge(subject: Subject, chosen: Sequence[Mutant], reached: Reached) -> Iterator[Outcome]:
    """Yield what became of each mutant, as it becomes known; as many at a time as there are processors."""
    if subject.module in sys.modules:
        raise RuntimeError(f"{subject.module}: another subject's tests have imported it; try it before that one")
    for name in reached.independent:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    found: Counter[str] = Counter()
    running: dict[int, tuple[Mutant, int, int]] = {}
    waiting = list(reversed(chosen))
    while waiting or running:
        while waiting and len(running) < (os.cpu_count() or 1):
            mutant = waiting.pop()
            tests = sorted(reached.tests_of(mutant), key=lambda test: (-found[test], reached.seconds[test]))
            if not tests:
                yield Outcome(mutant, "", 0)
                continue
            pid, pipe = _start(subject, mutant, tests, reached)
            running[pid] = (mutant, pipe, len(tests))
        if not running:
            continue
        pid, status = os.wait()
        mutant, pipe, number = running.pop(pid)
        with os.fdopen(pipe, "rb") as said:
            killer = said.read().decode()
        code = os.waitstatus_to_exitcode(status)
        if code in NOT_TRIED:
            raise RuntimeError(f"{subject.module}: its tests could not be run against a mutant: exit status {code}")
        if code and not killer:
            killer = "timeout" if code in (TIMED_OUT, -signal.SIGXCPU, -signal.SIGKILL) else "import"
        found[killer] += 1
        yield Outcome(mutant, killer, number)


def all_mutants(subject: Subject) -> list[Mutant]:
    """Return all mutants of the subject's module."""
    return mutants(subject.path.read_text())


def _in_child(work: Callable[[], int]) -> None:
    """Never return: a child that unwound into its parent's code would be two testers."""
    status = BROKEN
    try:
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
            status = work()
    finally:
        os._exit(status)


def _pytest(arguments: Sequence[str], plugin: object) -> int:
    import hypothesis

    # The same few examples each time; a failing one is not made smaller, one is enough.
    hypothesis.settings.register_profile(
        "mutation",
        derandomize=True,
        max_examples=30,
        database=None,
        deadline=None,
        suppress_health_check=list(hypothesis.HealthCheck),
        phases=[hypothesis.Phase.explicit, hypothesis.Phase.generate],
    )
    hypothesis.settings.load_profile("mutation")
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    os.chdir(REPOSITORY)
    options = ["-x", "-q", "--tb=no", "--no-header", "--no-summary", "-p", "no:cacheprovider", "-p", "no:logging"]
    options += [f"--rootdir={REPOSITORY}", "-m", "not live"]
    return int(pytest.main([*options, *arguments], plugins=[plugin]))


# The unchanged module.


class _Recorder:
    """Notes which lines of a module each test runs."""

    def __init__(self, module: str, path: Path) -> None:
        self._module = module
        self._path = str(path)
        self._now = ""  # the test that runs; empty while modules are imported
        self.lines: defaultdict[str, set[int]] = defaultdict(set)
        self.seconds: dict[str, float] = {}
        self.independent: tuple[str, ...] = ()

    def trace(self, frame: FrameType, event: str, argument: object) -> Any:
        if frame.f_code.co_filename != self._path:
            return None
        if not self.independent:
            self.independent = tuple(
                name
                for name, module in list(sys.modules.items())
                if not getattr(getattr(module, "__spec__", None), "_initializing", True)
            )
        into = self.lines[self._now]

        def line(frame: FrameType, event: str, argument: object) -> Any:
            into.add(frame.f_lineno)
            return line

        return line(frame, event, argument)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._now = item.nodeid
        self.lines[item.nodeid]
        begun = time.process_time()
        yield
        self.seconds[item.nodeid] = time.process_time() - begun
        self._now = ""


def _explore(subject: Subject, writing: int) -> int:
    recorder = _Recorder(subject.module, subject.path)
    sys.settrace(recorder.trace)
    status = _pytest(subject.tests, recorder)
    sys.settrace(None)
    at_import = frozenset(recorder.lines.pop("", set()))
    lines = {test: frozenset(numbers) for test, numbers in recorder.lines.items()}
    with os.fdopen(writing, "wb") as pipe:
        pickle.dump(Reached(recorder.seconds, lines, at_import, recorder.independent), pipe)
    return status


# A mutant.


class _Chosen:
    """Runs the chosen tests alone, in their order, and names the one that fails.

    The name of a test may hold a constant of the module, which the mutant has changed. Where a chosen test is missing
    those run as well that the unchanged module does not know by name.
    """

    def __init__(self, tests: Sequence[str], seconds: dict[str, float], writing: int) -> None:
        self._order = {test: place for place, test in enumerate(tests)}
        self._seconds = seconds
        self._writing = writing

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        chosen = sorted((i for i in items if i.nodeid in self._order), key=lambda item: self._order[item.nodeid])
        files, found = {item.nodeid.split("::")[0] for item in items}, {item.nodeid for item in chosen}
        missing = [test for test in self._order if test.split("::")[0] in files and test not in found]
        renamed = [item for item in items if item.nodeid not in self._seconds] if missing else []
        items[:] = chosen + renamed

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        longest = max(self._seconds.values())
        signal.setitimer(signal.ITIMER_PROF, PATIENCE + 5.0 * self._seconds.get(item.nodeid, longest))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            os.write(self._writing, report.nodeid.encode())
            os._exit(1)


def _start(subject: Subject, mutant: Mutant, tests: Sequence[str], reached: Reached) -> tuple[int, int]:
    code = mutant.code(str(subject.path))
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        _in_child(lambda: _try(subject, code, tests, reached, writing))
    os.close(writing)
    return pid, reading


def _try(subject: Subject, code: CodeType, tests: Sequence[str], reached: Reached, writing: int) -> int:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    limit = round(30.0 + 5.0 * sum(reached.seconds[test] for test in tests))
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    signal.signal(signal.SIGPROF, lambda *_: os._exit(TIMED_OUT))
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    original = SourceFileLoader.get_code

    def get_code(loader: SourceFileLoader, name: str) -> CodeType | None:
        return code if name == subject.module else original(loader, name)

    SourceFileLoader.get_code = get_code  # type: ignore[method-assign]
    # One file after the other: where the first finds the mutant the others need not even be imported.
    for file in dict.fromkeys(test.split("::")[0] for test in tests):
        status = _pytest([file], _Chosen(tests, reached.seconds, writing))
        if status:
            return status
    return 0
