"""The mutation tool itself: which mutants it makes, and that it tells those that are noticed from those that live."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

from tests.mutation.equivalents import argued
from tests.mutation.mutants import mutants
from tests.mutation.subjects import SUBJECTS
from tests.mutation.trial import REPOSITORY, all_mutants


def changes(source: str) -> set[str]:
    return {mutant.change for mutant in mutants(textwrap.dedent(source))}


@pytest.mark.parametrize(
    ("source", "change"),
    [
        ("x = a < b", "a < b -> a <= b"),
        ("x = a < b", "a < b -> a > b"),
        ("x = not a <= b", "not a <= b -> a > b"),
        ("x = not 0 <= a <= b", "not 0 <= a <= b -> 0 > a or a > b"),
        ("x = not a", "not a -> a"),
        ("x = a and b and c", "without b"),
        ("x = a and b", "a and b -> a or b"),
        ("x = a + b", "a + b -> a - b"),
        ("x = -a", "-a -> a"),
        ("x = 5.0", "5.0 -> 10.0"),
        ("x = 5.0", "5.0 -> 4.5"),
        ("x = 5.0", "5.0 -> 0.0"),
        ("x = 5.0", "5.0 -> -5.0"),
        ("x = 7", "7 -> 8"),
        ("x = True", "True -> False"),
        ("x = 'gear_lost'", "'gear_lost' -> 'gear_lost_other'"),
        ("def f():\n    return a", "return a -> return None"),
        ("f(a)", "deleted: f(a)"),
        ("a.b = c", "deleted: a.b = c"),
        ("a += b", "a += b -> a = b"),
        ("x = min(a, b)", "min -> max in min(a, b)"),
        ("x = min(a, b)", "without a in min(a, b)"),
        ("x = abs(a)", "abs(a) -> a"),
        ("x = {a, b}", "without a"),
        ("x = {1: a, 2: b}", "1: a -> b"),
        ("x = {1: a, 2: b}", "without 2: b"),
        ("x = a if b else c", "always a"),
        ("if a:\n    f(a)", "if not a"),
        ("x = [a for a in b if c]", "without if c"),
        ("match a:\n    case 1 if b:\n        f(a)\n    case _:\n        g(a)", "guard of case 1 if b dropped"),
        ("def f(a=True):\n    g(a)", "True -> False"),
    ],
)
def test_a_change_is_made(source, change):
    assert change in changes(source)


@pytest.mark.parametrize(
    "source",
    [
        '"""What it is for."""',
        "x: Final[float]",
        "import a",
        "@b(1)\nclass A:\n    pass",
        'def f(a: "x"):\n    """It."""',
    ],
)
def test_what_no_car_depends_on_is_left_alone(source):
    assert changes(source) == set()


@pytest.mark.thorough
def test_mutants_have_names_of_their_own_and_all_compile():
    for name, subject in SUBJECTS.items():
        every = all_mutants(subject)
        assert len({mutant.key for mutant in every}) == len(every)
        assert {mutant.key for mutant in every} >= set(argued(name))
        for mutant in every[:: max(len(every) // 20, 1)]:
            mutant.code("module")


TRY = """
from tests.mutation import trial

toy = trial.Subject("tests.mutation.toy", ("tests/mutation/toy_tests.py",))
for outcome in trial.judge(toy, trial.all_mutants(toy), trial.explore(toy)):
    print(outcome.mutant.change, "|", outcome.killer.split("::")[-1])
"""


@pytest.mark.thorough
def test_a_mutant_lives_where_no_test_can_tell_it_and_is_noticed_elsewhere():
    """min(value, bound) is value there: what is larger has been returned before."""
    run = subprocess.run([sys.executable, "-c", TRY], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    outcomes = dict(line.split(" | ") for line in run.stdout.splitlines())
    lived = {change for change, killer in outcomes.items() if not killer}
    assert lived == {"value <= bound -> value < bound", "without bound in min(value, bound)"}
    assert outcomes["not value <= bound -> value > bound"] == "test_what_is_not_a_number_is_the_bound"
    assert outcomes["return bound -> return None"].startswith("test_")
    assert outcomes["2.0 -> 4.0"].startswith("test_the_limit_is_two"), "whose name is another for this mutant"


@pytest.mark.thorough
def test_twenty_mutants_of_the_arming_table_are_noticed():
    run = subprocess.run(
        [sys.executable, "-m", "tests.mutation", "arming", "--sample", "20", "--seed", "3"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.startswith("arming: 20 mutants, 20 noticed, 0 argued, 0 lived")
