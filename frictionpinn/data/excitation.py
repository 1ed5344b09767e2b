"""Excitations written as text in a configuration: parsed without ``eval``, differentiated exactly."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from types import MappingProxyType

import sympy as sp

from ..errors import UserError, nearest
from ..physics.system import TIME

FUNCTIONS = {"sin": sp.sin, "cos": sp.cos, "tan": sp.tan, "exp": sp.exp, "sqrt": sp.sqrt, "tanh": sp.tanh}
FUNCTIONS |= {"sign": sp.sign, "abs": sp.Abs}
CONSTANTS = {"t": TIME, "pi": sp.pi, "deg": sp.pi / 180}
_OPERATORS = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_LONGEST, _LARGEST_EXPONENT = 1000, 64
_ALLOWED = "numbers, + - * / **, parentheses, t, pi, deg, " + ", ".join(FUNCTIONS)


class _Reader:
    """Turns the syntax tree of one text into a sympy expression; anything not listed above is refused."""

    def __init__(self, text: str, where: str, names: Mapping[str, sp.Expr]):
        self.text, self.where, self.names = text, where, names

    def refuse(self, what: str, column: int, fix: str = "") -> UserError:
        return UserError(
            what,
            where=f"{self.where}, character {column + 1}",
            received=repr(self.text),
            allowed=_ALLOWED + "".join(f", {name}" for name in self.names if name not in CONSTANTS),
            fix=fix,
        )

    def read(self, node: ast.expr) -> sp.Expr:
        if isinstance(node, ast.Constant) and type(node.value) in (int, float):
            return self.number(node)
        if isinstance(node, ast.Name):
            return self.name(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            value = self.read(node.operand)
            return -value if isinstance(node.op, ast.USub) else value
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return self.operation(node)
        if isinstance(node, ast.Call):
            return self.call(node)
        raise self.refuse("not allowed in an expression", node.col_offset)

    def number(self, node: ast.Constant) -> sp.Expr:
        value = node.value
        if isinstance(value, int):
            return sp.Integer(value)
        if not isinstance(value, float) or not math.isfinite(value):
            raise self.refuse("number too large", node.col_offset)
        return sp.Float(value)

    def name(self, node: ast.Name) -> sp.Expr:
        if node.id not in self.names:
            what = "function without its argument" if node.id in FUNCTIONS else "unknown name"
            raise self.refuse(f"{what} {node.id}", node.col_offset, nearest(node.id, [*self.names, *FUNCTIONS]))
        return self.names[node.id]

    def operation(self, node: ast.BinOp) -> sp.Expr:
        left, right = self.read(node.left), self.read(node.right)
        if isinstance(node.op, ast.Pow):
            if not (right.is_number and right.is_real and abs(float(right)) <= _LARGEST_EXPONENT):
                raise self.refuse(f"exponent is not a number up to {_LARGEST_EXPONENT}", node.right.col_offset)
            if left.is_number and abs(complex(left)) > 1e4 and abs(float(right)) > 4:
                raise self.refuse("number too large", node.col_offset)
        if isinstance(node.op, ast.Div) and right == 0:
            raise self.refuse("division by zero", node.right.col_offset)
        return _OPERATORS[type(node.op)](left, right)

    def call(self, node: ast.Call) -> sp.Expr:
        if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS:
            name = node.func.id if isinstance(node.func, ast.Name) else ""
            raise self.refuse(f"unknown function {name}".strip(), node.col_offset, nearest(name, FUNCTIONS))
        if len(node.args) != 1 or node.keywords or isinstance(node.args[0], ast.Starred):
            raise self.refuse(f"{node.func.id} takes one argument", node.col_offset)
        return FUNCTIONS[node.func.id](self.read(node.args[0]))


def parse_expression(
    text: str | float, where: str = "expression", constants: Mapping[str, float] = MappingProxyType({})
) -> sp.Expr:
    """Return a text such as ``"45*deg*sin(w*t + 0.45*sin(w*t))"`` as a sympy expression of time ``t`` (s).

    Numbers, + - * / **, parentheses, t, pi, deg (pi / 180), the functions sin cos tan exp sqrt tanh sign abs, and the
    names of ``constants`` are understood, nothing else; the text is never executed.

    Args:
        text: the expression; a number stands for itself.
        where: configuration key, for messages.
        constants: values of further names, ``{"w": 5.65}``.

    Raises:
        UserError: anything else, with the character at which it stands.
    """
    taken = [name for name in constants if name in CONSTANTS or name in FUNCTIONS or not str(name).isidentifier()]
    if taken:
        raise UserError("name of a constant is taken or not a name", where=where, received=repr(taken[0]))
    names = CONSTANTS | {name: sp.Float(float(value)) for name, value in constants.items()}
    source = str(text).strip()
    reader = _Reader(source, where, names)
    if len(source) > _LONGEST:
        raise UserError("expression too long", where=where, received=f"{len(source)} characters", allowed=f"{_LONGEST}")
    try:
        tree = ast.parse(source, mode="eval")
        value = reader.read(tree.body)
    except SyntaxError as error:
        raise reader.refuse("not an expression", max((error.offset or 1) - 1, 0)) from None
    except (RecursionError, MemoryError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise reader.refuse("expression cannot be read", 0) from None
    if value.has(sp.zoo, sp.nan, sp.oo, sp.I):
        raise reader.refuse("expression is not a finite real number", 0)
    return value
