"""Makes frozen dataclasses cheap to create, for the values that every tick creates.

A frozen dataclass sets each field through `object.__setattr__`, a call a field. A class that is decorated here is
filled by plain assignments instead and frozen afterwards, which takes about a third of the time.
"""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

T = TypeVar("T")


def fast_frozen(made: type[T]) -> type[T]:
    """Return a frozen dataclass with slots, changed so that its instances are created by plain assignments.

    An instance is filled as one of a class with the same slots that is not frozen, then becomes one of `made`. It is
    the same in every other respect: signature, defaults, equality, hash, `dataclasses.replace`, copy and pickle.
    Raises TypeError for a class that is not frozen, has no slots of its own or has a base, for a class with
    `__post_init__`, and for fields with a default factory, keyword-only fields and those that `__init__` does not take.
    """
    parameters = getattr(made, "__dataclass_params__", None)
    if parameters is None or not parameters.frozen or "__slots__" not in vars(made) or made.__bases__ != (object,):
        raise TypeError(f"{made.__name__}: a frozen dataclass with slots and without a base is expected")
    fields = dataclasses.fields(made)  # type: ignore[arg-type]  # a dataclass, as its parameters say
    for field in fields:
        if not field.init or field.kw_only or field.default_factory is not dataclasses.MISSING:
            raise TypeError(f"{made.__name__}.{field.name}: a field that is set from a plain argument is expected")
    if hasattr(made, "__post_init__"):
        raise TypeError(f"{made.__name__}: __post_init__ would not be called")
    names = tuple(field.name for field in fields)
    open_class = type(made.__name__, (), {"__slots__": vars(made)["__slots__"]})
    defaults = {f"_default_{field.name}": field.default for field in fields if field.default is not dataclasses.MISSING}
    arguments = ", ".join(f"{name}=_default_{name}" if f"_default_{name}" in defaults else name for name in names)
    lines = [
        f"def __new__(_class, {arguments}):",
        " _self = _create(_open_class)",
        *(f" _self.{name} = {name}" for name in names),
        " _self.__class__ = _class",
        " return _self",
    ]
    known: dict[str, Any] = {"_create": object.__new__, "_open_class": open_class, **defaults}
    exec("\n".join(lines), known)  # as dataclasses themselves do it; the names are identifiers of the class
    create = known["__new__"]
    create.__qualname__ = f"{made.__qualname__}.__new__"
    create.__module__ = made.__module__
    made.__new__ = create  # type: ignore[method-assign]
    del made.__init__  # `object.__init__` ignores the arguments that `__new__` took

    def reduce(self: T) -> tuple[type[T], tuple[Any, ...]]:
        return type(self), tuple(getattr(self, name) for name in names)

    made.__reduce__ = reduce  # type: ignore[assignment]
    return made
