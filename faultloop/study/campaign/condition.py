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


class Condition:
    """A condition over the varied keys, as in ``fault.F1.at_pu < 0.8 and fault.F1.type in ["AG", "BC"]``.

    Raises InputError where it is anything else.
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
        self._tree = tree.body

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Whether it holds with these values.  Raises InputError where they cannot be compared."""
        try:
            return bool(self._evaluate(self._tree, values))
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

    def _evaluate(self, node: ast.AST, values: Mapping[str, Any]) -> Any:
        match node:
            case ast.BoolOp(op=ast.And()):
                return all(self._evaluate(part, values) for part in node.values)
            case ast.BoolOp():
                return any(self._evaluate(part, values) for part in node.values)
            case ast.BinOp():
                sides = [self._evaluate(part, values) for part in (node.left, node.right)]
                if not all(isinstance(side, _NUMBER) for side in sides):
                    raise TypeError("only numbers can be calculated with")
                return _OPERATORS[type(node.op)](*sides)
            case ast.UnaryOp():
                return _OPERATORS[type(node.op)](self._evaluate(node.operand, values))
            case ast.Compare():
                left = self._evaluate(node.left, values)
                for op, part in zip(node.ops, node.comparators, strict=True):
                    right = self._evaluate(part, values)
                    if not _OPERATORS[type(op)](left, right):
                        return False
                    left = right
                return True
            case ast.List() | ast.Tuple():
                return [self._evaluate(part, values) for part in node.elts]
            case ast.Call(func=ast.Name(id=name)):
                return _FUNCTIONS[name](*[self._evaluate(part, values) for part in node.args])
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                return values[self._keys[int(name[2:-1])]]
        raise AssertionError(ast.dump(node))
