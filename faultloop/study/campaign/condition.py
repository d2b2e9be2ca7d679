"""``[[only]] when = "EXPRESSION"``: comparisons and arithmetic over the varied keys, and nothing else."""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from faultloop.errors import InputError, nearest

_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
    ast.Not: operator.not_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {"abs": abs, "min": min, "max": max}
_NUMBER = (bool, int, float)
Judge = Callable[[Mapping[str, Any]], Any]


class Condition:
    """A condition over the varied keys, as in ``fault.F1.at_pu < 0.8 and fault.F1.type in ["AG", "BC"]``.

    Raises InputError where it is anything else.

    Attributes
    ----------
    keys : the varied keys that are in it.
    """

    def __init__(self, text: str, keys: Sequence[str], where: str) -> None:
        self.text, self.where = text, where
        self._keys = sorted(keys, key=len, reverse=True)  # the longer first: one may begin with another
        place = "|".join(re.escape(key) for key in self._keys)
        quoted = r"'[^']*'|\"[^\"]*\""
        pattern = re.compile(rf"({quoted})|(?<![\w.])({place})(?![\w.])")
        try:
            if re.search(r"_k\d+_", text):
                raise ValueError(f"'{text}' is not a varied key")
            tree = ast.parse(pattern.sub(self._place, text).strip(), mode="eval")
            self._check(tree.body)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            why = error.msg if isinstance(error, SyntaxError) else error or "nested too deep"
            raise self._wrong(str(why)) from None
        named = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - set(_FUNCTIONS)
        self.keys = frozenset(self._key(name) for name in named)
        self._judge = self._closure(tree.body)

    def __reduce__(self) -> tuple[Any, ...]:
        return Condition, (self.text, self._keys, self.where)

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Whether it holds with these values.  Raises InputError where they cannot be compared."""
        try:
            return bool(self._judge(values))
        except (TypeError, ZeroDivisionError, OverflowError, ValueError) as error:
            raise self._wrong(str(error)) from None

    def _place(self, match: re.Match[str]) -> str:
        return match[0] if match[1] else f"_k{self._keys.index(match[2])}_"

    def _wrong(self, why: str) -> InputError:
        return InputError(f"'{self.text}' cannot be judged: {why}", key=self.where)

    def _check(self, node: ast.AST) -> None:
        """The whole tree, before anything of it is used."""
        match node:
            case ast.BoolOp():
                inside: list[ast.AST] = list(node.values)
            case ast.BinOp() if type(node.op) in _OPERATORS:
                inside = [node.left, node.right]
            case ast.UnaryOp() if type(node.op) in _OPERATORS:
                inside = [node.operand]
            case ast.Compare() if all(type(op) in _OPERATORS for op in node.ops):
                inside = [node.left, *node.comparators]
            case ast.List() | ast.Tuple():
                inside = list(node.elts)
            case ast.Call(func=ast.Name(id=name), keywords=[]) if name in _FUNCTIONS and node.args:
                inside = list(node.args)
            case ast.Constant(value=value) if isinstance(value, (*_NUMBER, str)):
                inside = []
            case ast.Name(id=name) if re.fullmatch(r"_k\d+_", name):
                inside = []
            case ast.Name() | ast.Attribute():
                name = ast.unparse(node)
                raise ValueError(f"'{name}' is not a varied key; {nearest(name, self._keys)}")
            case _:
                raise ValueError(f"'{ast.unparse(node)}' has no place in a condition")
        for part in inside:
            self._check(part)

    def _key(self, name: str) -> str:
        return self._keys[int(name[2:-1])]

    def _closure(self, node: ast.AST) -> Judge:
        """The tree as functions of the values, ten times quicker than walking it for each case."""
        match node:
            case ast.BoolOp():
                parts = [self._closure(part) for part in node.values]
                every = all if isinstance(node.op, ast.And) else any
                return lambda values: every(part(values) for part in parts)
            case ast.BinOp():
                left, right, op = self._closure(node.left), self._closure(node.right), type(node.op)
                return lambda values: _calculated(_OPERATORS[op], left(values), right(values))
            case ast.UnaryOp():
                operand, apply = self._closure(node.operand), _OPERATORS[type(node.op)]
                return lambda values: apply(operand(values))
            case ast.Compare():
                sides = [self._closure(side) for side in (node.left, *node.comparators)]
                return _chain(sides, [_OPERATORS[type(op)] for op in node.ops])
            case ast.List() | ast.Tuple():
                items = [self._closure(item) for item in node.elts]
                return lambda values: [item(values) for item in items]
            case ast.Call(func=ast.Name(id=name)):
                arguments, function = [self._closure(part) for part in node.args], _FUNCTIONS[name]
                return lambda values: function(*[argument(values) for argument in arguments])
            case ast.Constant(value=value):
                return lambda values: value
            case ast.Name(id=name):
                return operator.itemgetter(self._key(name))
        raise AssertionError(ast.dump(node))


def _calculated(apply: Callable[..., Any], *sides: Any) -> Any:
    if not all(isinstance(side, _NUMBER) for side in sides):
        raise TypeError("only numbers can be calculated with")
    return apply(*sides)


def _chain(sides: Sequence[Judge], operators: Sequence[Callable[..., Any]]) -> Judge:
    """``a < b <= c``; what comes after a comparison that does not hold is not looked at."""

    def holds(values: Mapping[str, Any]) -> bool:
        left = sides[0](values)
        for apply, side in zip(operators, sides[1:], strict=True):
            right = side(values)
            if not apply(left, right):
                return False
            left = right
        return True

    return holds
