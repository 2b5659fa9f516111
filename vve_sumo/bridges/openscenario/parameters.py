"""Values of attributes: parameters of OpenSCENARIO and the expressions that are made of them.

ASAM OpenSCENARIO XML 1.3, chapters "Parameters" and "Expressions". Knows no element's meaning.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element

#: characters of an expression at most
MAX_LENGTH: Final = 2000
_NAME: Final = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")

_OPERATORS: Final[dict[type[ast.AST], Callable[..., Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_FUNCTIONS: Final[dict[str, Callable[..., float]]] = {
    "round": lambda value: math.floor(value + 0.5),
    "floor": math.floor,
    "ceil": math.ceil,
    "sqrt": math.sqrt,
    "pow": math.pow,
    "abs": abs,
    "sign": lambda value: (value > 0.0) - (value < 0.0),
    "min": min,
    "max": max,
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "log")},
}
_CONSTANTS: Final = {"pi": math.pi, "e": math.e, "true": True, "false": False}
_BOOLEANS: Final = {"true": True, "1": True, "false": False, "0": False}

#: how values are compared
RULES: Final = {
    "greaterThan": ">",
    "lessThan": "<",
    "equalTo": "==",
    "greaterOrEqual": ">=",
    "lessOrEqual": "<=",
    "notEqualTo": "!=",
}


class Scope:
    """The parameters that are known at a place, and the values of attributes there."""

    def __init__(self, values: Mapping[str, str] | None = None) -> None:
        self.values: dict[str, str] = dict(values or {})

    def declared(self, element: Element | None, given: Mapping[str, str] | None = None) -> Scope:
        """Return the scope inside an element that declares parameters, with those that are `given` their values."""
        inner = Scope(self.values)
        for one in [] if element is None else element.all("ParameterDeclaration"):
            name = one.attributes.get("name", "")
            inner.values[name] = (given or {}).get(name) or str(inner.text(one, "value"))
            inner.constrain(one, inner.values[name])
        return inner

    def constrain(self, declaration: Element, value: str) -> None:
        """Raise NotTakenError where a value meets none of the groups of constraints that its declaration states."""
        groups = [[self._meets(one, value) for one in group.children] for group in declaration.all("ConstraintGroup")]
        if groups and not any(all(group) for group in groups):
            raise NotTakenError(declaration, f"its constraints do not allow {value[:80]!r}")

    def _meets(self, constraint: Element, value: str) -> bool:
        rule = self.text(constraint, "rule")
        if rule not in RULES:
            raise NotTakenError(constraint, f"rule: expected {', '.join(RULES)}, got {rule!r}")
        return holds(value, RULES[rule], self.text(constraint, "value"))

    def text(self, element: Element, name: str, default: str | None = None) -> str:
        """Return an attribute's value; raises NotTakenError where it is missing or its expression is none."""
        raw = element.attributes.get(name, default)
        if raw is None:
            raise NotTakenError(element, f"expected an attribute {name}")
        if not raw.startswith("$"):
            return raw
        if raw.startswith("${"):
            value = self._evaluated(element, name, raw)
            return str(value).lower() if isinstance(value, bool) else repr(float(value))
        key = raw[1:]
        if key not in self.values:
            raise NotTakenError(element, f"{name}: no parameter {raw} is declared")
        return self.values[key]

    def number(self, element: Element, name: str, default: float | None = None) -> float:
        """Return an attribute's number; raises NotTakenError for what is none, infinity and NaN included."""
        text = self.text(element, name, None if default is None else repr(default))
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise NotTakenError(element, f"{name}: expected a number, got {text[:80]!r}")
        return value

    def whole(self, element: Element, name: str, default: int | None = None) -> int:
        """Return an attribute's whole number."""
        value = self.number(element, name, None if default is None else float(default))
        if value != round(value):
            raise NotTakenError(element, f"{name}: expected a whole number, got {value:g}")
        return round(value)

    def flag(self, element: Element, name: str, default: bool) -> bool:
        """Return an attribute's boolean."""
        text = self.text(element, name, str(default))
        # Python's writers of such files write True and False.
        if (value := _BOOLEANS.get(text.lower())) is None:
            raise NotTakenError(element, f"{name}: expected true or false, got {text[:80]!r}")
        return value

    def _evaluated(self, element: Element, name: str, raw: str) -> float | bool:
        inner = raw[2:-1] if raw.endswith("}") else ""
        missing = next((key for key in _NAME.findall(inner) if key not in self.values), None)
        if missing is not None:
            raise NotTakenError(element, f"{name}: no parameter ${missing} is declared")
        try:
            if not inner or len(inner) > MAX_LENGTH:
                raise ValueError
            python = _NAME.sub(lambda found: f"({self.values[found[1]]})", inner)
            value = _value(ast.parse(python.strip(), mode="eval").body)
        except (SyntaxError, ValueError, TypeError, ArithmeticError, RecursionError, MemoryError):
            raise NotTakenError(element, f"{name}: expected an expression, got {raw[:80]!r}") from None
        return value


def holds(value: str, rule: str, wanted: str) -> bool:
    """Return whether a parameter or variable compares as a rule says: as numbers where both are."""
    try:
        one, other = float(value), float(wanted)
    except ValueError:
        same = value.lower() == wanted.lower()
        return same if rule == "==" else rule == "!=" and not same
    compared = {">": one > other, "<": one < other, "==": one == other}
    return compared.get(rule, {">=": one >= other, "<=": one <= other, "!=": one != other}.get(rule, False))


def _value(node: ast.AST) -> float | bool:
    """Return the value of an expression's node; raises ValueError for whatever is no arithmetic."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return node.value if isinstance(node.value, bool) else float(node.value)
    if isinstance(node, ast.Name) and node.id in _CONSTANTS:
        return _CONSTANTS[node.id]
    if isinstance(node, (ast.BinOp, ast.UnaryOp)) and type(node.op) in _OPERATORS:
        of = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
        found: float | bool = _OPERATORS[type(node.op)](*map(_value, of))
        return found
    if isinstance(node, ast.BoolOp):
        return (all if isinstance(node.op, ast.And) else any)([bool(_value(one)) for one in node.values])
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _OPERATORS:
        return bool(_OPERATORS[type(node.ops[0])](_value(node.left), _value(node.comparators[0])))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
        return float(_FUNCTIONS[node.func.id](*map(_value, node.args)))
    raise ValueError
