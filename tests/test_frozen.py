"""Dataclasses that are quickly made, against the plain frozen dataclass with the same fields."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.frozen import fast_frozen


def declared(name: str) -> Any:
    """Return a frozen dataclass of the standard library, the same at each call but for its name."""
    columns = [("first", float), ("second", str), ("third", tuple[int, ...], ())]
    namespace = {"doubled": property(lambda self: 2.0 * self.first), "__module__": __name__}
    return dataclasses.make_dataclass(name, columns, namespace=namespace, frozen=True, slots=True)


Plain = declared("Plain")
Quick = fast_frozen(declared("Quick"))


values = st.tuples(st.floats(allow_nan=False), st.text(), st.tuples(st.integers()))


@pytest.mark.thorough
@given(values, values)
def test_it_is_what_the_plain_dataclass_is(one: Any, other: Any) -> None:
    plain, quick = Plain(*one), Quick(*one)
    assert dataclasses.astuple(quick) == dataclasses.astuple(plain) == one
    assert dataclasses.asdict(quick) == dataclasses.asdict(plain)
    assert repr(quick) == repr(plain).replace("Plain", "Quick")
    assert hash(quick) == hash(plain)
    assert quick.doubled == plain.doubled
    assert (quick == Quick(*other)) == (plain == Plain(*other))
    assert dataclasses.astuple(dataclasses.replace(quick, second=other[1])) == (one[0], other[1], one[2])
    for twin in (pickle.loads(pickle.dumps(quick)), copy.copy(quick), copy.deepcopy(quick)):
        assert type(twin) is Quick
        assert twin == quick


def test_its_arguments_are_the_plain_dataclass_s() -> None:
    assert Quick(1.0, "a") == Quick(first=1.0, second="a", third=()) == Quick(1.0, second="a")
    assert list(inspect.signature(Quick).parameters) == list(inspect.signature(Plain).parameters)
    for made in (Plain, Quick):
        with pytest.raises(TypeError, match="second"):
            made(1.0)
        with pytest.raises(TypeError, match="fourth"):
            made(1.0, "a", fourth=3)
        with pytest.raises(TypeError, match="positional"):
            made(1.0, "a", (), 4)


def test_it_stays_frozen_and_slotted() -> None:
    quick = Quick(1.0, "a")
    with pytest.raises(dataclasses.FrozenInstanceError):
        quick.first = 2.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        del quick.first
    with pytest.raises((dataclasses.FrozenInstanceError, TypeError)):
        quick.other = 2.0
    assert not hasattr(quick, "__dict__")
    assert quick == Quick(1.0, "a")


def refused(name: str, message: str, a: Any = dataclasses.MISSING, **options: Any) -> None:
    columns: list[Any] = [("a", int) if a is dataclasses.MISSING else ("a", int, a)]
    with pytest.raises(TypeError, match=message):
        fast_frozen(dataclasses.make_dataclass(name, columns, **options))


def test_what_it_would_change_is_refused() -> None:
    both: dict[str, Any] = {"frozen": True, "slots": True}
    refused("Thawed", "Thawed: a frozen dataclass with slots", slots=True)
    refused("Open", "Open: a frozen dataclass with slots", frozen=True)
    refused("Derived", "Derived: .* without a base", a=1, bases=(Plain,), **both)
    refused("Checked", "Checked: __post_init__", namespace={"__post_init__": lambda self: None}, **both)
    refused("Fresh", r"Fresh\.a: a field", a=dataclasses.field(default_factory=int), **both)
    refused("Named", r"Named\.a: a field", a=dataclasses.field(kw_only=True), **both)
    refused("Fixed", r"Fixed\.a: a field", a=dataclasses.field(default=1, init=False), **both)
    with pytest.raises(TypeError, match="int: a frozen dataclass"):
        fast_frozen(int)
