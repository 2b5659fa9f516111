"""Which small changes of a module's source its tests must notice.

It reads and edits syntax trees; it runs nothing. A mutant is one change at one place. Annotations, docstrings,
decorators, imports and texts made for people are left alone: nothing that a car does depends on them.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from types import CodeType
from typing import Any, NamedTuple

Change = tuple[str, ast.AST]  # what the change is called, and what stands there instead

_LOOSER = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
# What is left of `not a <= b` when somebody tidies it up: NaN passes.
_TIDIED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
_ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_OTHER_CALL = {"min": "max", "max": "min", "any": "all", "all": "any", "atan2": "hypot"}
_UNWRAPPED = ("abs", "copysign", "remainder")


class _Place(NamedTuple):
    """A node and where it hangs."""

    node: ast.AST
    parent: ast.AST
    field: str
    index: int | None
    statement: ast.stmt
    scope: tuple[str, ...]

    def put(self, node: ast.AST) -> None:
        if self.index is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.index] = node


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change at one place."""

    scope: str  #: class and function, "" in the module's body
    text: str  #: of the source line, stripped
    change: str
    line: int
    lines: range  #: of the statement or its head: a test that runs none of these lines can't notice
    _tree: ast.Module
    _place: _Place
    _instead: ast.AST

    @property
    def key(self) -> tuple[str, str, str]:
        """What tells this mutant from all others, whatever moves up or down in the file."""
        return (self.scope, self.text, self.change)

    def code(self, filename: str) -> CodeType:
        """Return the compiled module with this change."""
        self._place.put(self._instead)
        try:
            return compile(ast.fix_missing_locations(self._tree), filename, "exec")
        finally:
            self._place.put(self._place.node)


def mutants(source: str) -> list[Mutant]:
    """Return all mutants of a module, in the order of its source."""
    tree = ast.parse(source)
    lines = source.splitlines()
    found: list[Mutant] = []
    seen: Counter[tuple[str, str, str]] = Counter()
    for place in _places(tree):
        for change, instead in _changes(place):
            line = getattr(place.node, "lineno", place.statement.lineno)
            key = (".".join(place.scope), lines[line - 1].strip(), change)
            seen[key] += 1
            name = change if seen[key] == 1 else f"{change} (no. {seen[key]})"
            ast.copy_location(instead, place.node if hasattr(place.node, "lineno") else place.statement)
            found.append(Mutant(key[0], key[1], name, line, _head(place.statement), tree, place, instead))
    return sorted(found, key=lambda mutant: mutant.line)


def _head(statement: ast.stmt) -> range:
    body = getattr(statement, "body", None) or getattr(statement, "cases", None)
    if not body:
        return range(statement.lineno, (statement.end_lineno or statement.lineno) + 1)
    first = body[0].pattern.lineno if isinstance(body[0], ast.match_case) else body[0].lineno
    return range(statement.lineno, max(first, statement.lineno + 1))


def _places(tree: ast.Module) -> Iterator[_Place]:
    yield from _below(tree, tree.body[0], ())


def _below(node: ast.AST, statement: ast.stmt, scope: tuple[str, ...]) -> Iterator[_Place]:
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        children = list(enumerate(value)) if isinstance(value, list) else [(None, value)]
        for index, child in children:
            if not isinstance(child, ast.AST) or _left_alone(child, index, field, node):
                continue
            inside = child if isinstance(child, ast.stmt) else statement
            yield _Place(child, node, field, index, inside, scope)
            named = isinstance(child, (ast.FunctionDef, ast.ClassDef))
            yield from _below(child, inside, (*scope, child.name) if named else scope)


def _left_alone(child: ast.AST, index: int | None, field: str, parent: ast.AST) -> bool:
    docstring = (
        field == "body"
        and index == 0
        and isinstance(parent, (ast.Module, ast.ClassDef, ast.FunctionDef))
        and isinstance(child, ast.Expr)
        and isinstance(child.value, ast.Constant)
    )
    return docstring or isinstance(child, (ast.Import, ast.ImportFrom, ast.JoinedStr))


def _changes(place: _Place) -> Iterator[Change]:
    for kinds, changes in _CHANGES:
        if isinstance(place.node, kinds):
            yield from changes(place.node, place)


def _said(node: ast.AST) -> str:
    return ast.unparse(node)


def _with(node: Any, **fields: object) -> Any:
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _became(node: ast.AST, other: ast.AST) -> Change:
    return f"{_said(node)} -> {_said(other)}", other


def _without(items: list[Any], index: int) -> list[Any]:
    return items[:index] + items[index + 1 :]


def _compare(node: ast.Compare, _: _Place) -> Iterator[Change]:
    for index, operator in enumerate(node.ops):
        for other in _LOOSER[type(operator)]:
            yield _became(node, _with(node, ops=[*node.ops[:index], other(), *node.ops[index + 1 :]]))


def _bool_op(node: ast.BoolOp, _: _Place) -> Iterator[Change]:
    yield _became(node, _with(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And()))
    for index, part in enumerate(node.values):
        rest = _without(node.values, index)
        yield f"without {_said(part)}", rest[0] if len(rest) == 1 else _with(node, values=rest)


def _unary(node: ast.UnaryOp, _: _Place) -> Iterator[Change]:
    yield _became(node, node.operand)
    inner = node.operand
    if isinstance(node.op, ast.Not) and isinstance(inner, ast.Compare) and type(inner.ops[0]) in _TIDIED:
        if len(inner.ops) == 1:
            yield _became(node, _with(inner, ops=[_TIDIED[type(inner.ops[0])]()]))
        else:
            # not a <= x <= b, tidied up: x < a or x > b
            sides = [inner.left, *inner.comparators]
            parts: list[ast.expr] = [
                ast.Compare(sides[k], [_TIDIED[type(op)]()], [sides[k + 1]]) for k, op in enumerate(inner.ops)
            ]
            yield _became(node, ast.BoolOp(ast.Or(), parts))


def _bin_op(node: ast.BinOp, _: _Place) -> Iterator[Change]:
    other = _ARITHMETIC.get(type(node.op))
    if other is not None:
        yield _became(node, _with(node, op=other()))


def _aug_assign(node: ast.AugAssign, _: _Place) -> Iterator[Change]:
    yield _became(node, ast.Assign([node.target], node.value, lineno=node.lineno))
    other = _ARITHMETIC.get(type(node.op))
    if other is not None and not isinstance(node.value, (ast.List, ast.Call)):
        yield _became(node, _with(node, op=other()))


def _constant(node: ast.Constant, place: _Place) -> Iterator[Change]:
    value = node.value
    others: list[object] = []
    if isinstance(value, bool):
        others = [not value]
    elif isinstance(value, int):
        others = [value + 1, value - 1]
    elif isinstance(value, float):
        others = [2.0 * value, float(f"{0.9 * value:.9g}"), 0.0, -value] if value else [1.0]
    elif isinstance(value, str) and " " not in value and not isinstance(place.parent, ast.Expr):
        others = [f"{value}_other"]
    for other in others:
        yield f"{value!r} -> {other!r}", _literal(other)


def _literal(value: object) -> ast.expr:
    if isinstance(value, (int, float)) and not isinstance(value, bool) and value < 0:
        return ast.UnaryOp(ast.USub(), ast.Constant(-value))
    return ast.Constant(value)


def _call(node: ast.Call, _: _Place) -> Iterator[Change]:
    name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
    if name in _OTHER_CALL:
        other = _OTHER_CALL[name]
        function = _with(node.func, **{"id" if isinstance(node.func, ast.Name) else "attr": other})
        yield f"{name} -> {other} in {_said(node)}", _with(node, func=function)
    if name in ("min", "max") and len(node.args) > 1 and not any(isinstance(a, ast.Starred) for a in node.args):
        for index, part in enumerate(node.args):
            rest = _without(node.args, index)
            yield f"without {_said(part)} in {_said(node)}", rest[0] if len(rest) == 1 else _with(node, args=rest)
    if name in _UNWRAPPED and node.args:
        yield _became(node, node.args[0])


def _if_exp(node: ast.IfExp, _: _Place) -> Iterator[Change]:
    yield f"always {_said(node.body)}", node.body
    yield f"always {_said(node.orelse)}", node.orelse
    yield from _negated(node)


def _branch(node: ast.If | ast.While, _: _Place) -> Iterator[Change]:
    yield from _negated(node)


def _negated(node: ast.If | ast.IfExp | ast.While) -> Iterator[Change]:
    if isinstance(node.test, (ast.Name, ast.Attribute, ast.Call)):
        yield f"if not {_said(node.test)}", _with(node, test=ast.UnaryOp(ast.Not(), node.test))


def _elements(node: ast.Set | ast.List | ast.Tuple, place: _Place) -> Iterator[Change]:
    members = isinstance(place.parent, ast.Compare)
    rows = node.elts and all(isinstance(e, ast.Tuple) for e in node.elts)
    codes = node.elts and all(isinstance(e, ast.Constant) and isinstance(e.value, str) for e in node.elts)
    if isinstance(node, ast.Set) or members or rows or codes:
        for index, element in enumerate(node.elts):
            rest = _without(node.elts, index)
            empty_set = ast.Call(ast.Name("set", ast.Load()), [], [])
            yield (
                f"without {_said(element)}",
                empty_set if not rest and isinstance(node, ast.Set) else _with(node, elts=rest),
            )


def _dict(node: ast.Dict, place: _Place) -> Iterator[Change]:
    names = {_said(v): v for v in ast.walk(place.statement) if isinstance(v, (ast.Name, ast.Attribute))}
    states = {said: name for said, name in names.items() if any(said == _said(v) for v in _values(place.statement))}
    for index, (key, value) in enumerate(zip(node.keys, node.values, strict=True)):
        entry = f"{_said(key) if key else '**'}: {_said(value)}"
        short = entry if isinstance(value, (ast.Name, ast.Attribute, ast.Constant)) else f"{_said(key or value)}"
        yield f"without {short}", _with(node, keys=_without(node.keys, index), values=_without(node.values, index))
        if isinstance(value, (ast.Name, ast.Attribute)):
            for said, other in states.items():
                if said != _said(value):
                    changed = [*node.values[:index], other, *node.values[index + 1 :]]
                    yield f"{entry} -> {said}", _with(node, values=changed)


def _values(statement: ast.stmt) -> list[ast.expr]:
    tables = [node for node in ast.walk(statement) if isinstance(node, ast.Dict)]
    return [value for table in tables for value in table.values if isinstance(value, (ast.Name, ast.Attribute))]


def _return(node: ast.Return, _: _Place) -> Iterator[Change]:
    if node.value is not None and not (isinstance(node.value, ast.Constant) and node.value.value is None):
        yield f"{_said(node)} -> return None", ast.Return(ast.Constant(None))


def _statement(node: ast.stmt, place: _Place) -> Iterator[Change]:
    if isinstance(node, ast.AnnAssign) and (node.value is None or isinstance(node.target, ast.Name)):
        return
    if isinstance(node, ast.Assign) and all(isinstance(target, ast.Name) for target in node.targets):
        # A name that is bound only here would be missing: nothing that a test could overlook.
        bound = [
            name.id for name in ast.walk(place.parent) if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store)
        ]
        arguments = [a.arg for a in ast.walk(place.parent) if isinstance(a, ast.arg)]
        if all(isinstance(t, ast.Name) and (bound + arguments).count(t.id) < 2 for t in node.targets):
            return
    yield f"deleted: {_said(node)}", ast.Pass()


def _expression(node: ast.Expr, _: _Place) -> Iterator[Change]:
    if isinstance(node.value, ast.Call):
        yield f"deleted: {_said(node)}", ast.Pass()


def _comprehension(node: ast.comprehension, _: _Place) -> Iterator[Change]:
    for index, condition in enumerate(node.ifs):
        yield f"without if {_said(condition)}", _with(node, ifs=_without(node.ifs, index))


def _match(node: ast.Match, _: _Place) -> Iterator[Change]:
    for index, case in enumerate(node.cases):
        guard = f" if {_said(case.guard)}" if case.guard else ""
        name = f"case {_said(case.pattern)}{guard}"
        if len(node.cases) > 1:
            yield f"without {name}", _with(node, cases=_without(node.cases, index))
        if case.guard:
            bare = _with(case, guard=None)
            if not (isinstance(case.pattern, ast.MatchAs) and index < len(node.cases) - 1):
                yield (
                    f"guard of {name} dropped",
                    _with(node, cases=[*node.cases[:index], bare, *node.cases[index + 1 :]]),
                )


def _match_or(node: ast.MatchOr, _: _Place) -> Iterator[Change]:
    for index, pattern in enumerate(node.patterns):
        rest = _without(node.patterns, index)
        yield f"without {_said(pattern)}", rest[0] if len(rest) == 1 else _with(node, patterns=rest)


_CHANGES: tuple[tuple[Any, Any], ...] = (
    (ast.Compare, _compare),
    (ast.BoolOp, _bool_op),
    (ast.UnaryOp, _unary),
    (ast.BinOp, _bin_op),
    (ast.AugAssign, _aug_assign),
    (ast.Constant, _constant),
    (ast.Call, _call),
    (ast.IfExp, _if_exp),
    ((ast.If, ast.While), _branch),
    ((ast.Set, ast.List, ast.Tuple), _elements),
    (ast.Dict, _dict),
    (ast.Return, _return),
    ((ast.Assign, ast.AnnAssign, ast.AugAssign, ast.Raise, ast.Continue, ast.Break, ast.Delete), _statement),
    (ast.Expr, _expression),
    (ast.comprehension, _comprehension),
    (ast.Match, _match),
    (ast.MatchOr, _match_or),
)
