"""Straight-line arithmetic as a body that numba compiles without looking at its types, of which there is but one.

A mechanism's kernel is thousands of assignments of float64 numbers. Numba finds the type of every product anew, which
is nine tenths of what compiling such a function takes. Here the function's syntax tree is written to LLVM's builder as
it stands; the call, its place in the cache and all that follows are numba's.
"""

from __future__ import annotations

import ast
import inspect
import math
import operator
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_DOUBLE = ir.DoubleType()
_OPERATIONS: dict[type, str] = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_COMPARED: dict[type, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


def straight_line(function: Callable) -> Callable:
    """``function``, whose arguments are contiguous float64 vectors, for use within a compiled one.

    It consists of assignments to names, of numbers or truths, and to elements of a vector, ``out[3] = ...``, of
    expressions of numbers, names, elements, ``+ - * / **``, comparisons, ``and``, ``or``, ``not``, ``a if b else c``,
    ``abs``, ``min``, ``max`` and functions of ``math``. Division by zero gives what IEEE 754 says.

    Raises:
        NotImplementedError: when compiled, anything else, with its line.
    """
    names = list(inspect.signature(function).parameters)

    def typed(typingctx, *vectors):
        def write(context, builder, signature, arguments):
            data = {
                name: context.make_array(kind)(context, builder, value).data
                for name, kind, value in zip(names, signature.args, arguments, strict=True)
            }
            body = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
            assert isinstance(body, ast.FunctionDef)
            _Writer(context, builder, data).lines(body.body)
            return context.get_dummy_value()

        return types.void(*vectors), write

    return intrinsic(_with_names(typed, names))


def _with_names(typed: Callable, names: Sequence[str]) -> Callable:
    """``typed`` with its vectors named one by one: numba counts the arguments of an intrinsic."""
    given = ", ".join(names)
    scope: dict[str, Any] = {"typed": typed}
    exec(f"def body(typingctx, {given}):\n    return typed(typingctx, {given})", scope)
    return scope["body"]


class _Writer:
    """Writes statements to a builder; ``data``: where each vector begins."""

    def __init__(self, context, builder, data: dict[str, ir.Value]):
        self.context, self.builder, self.data = context, builder, data
        self.values: dict[str, ir.Value] = {}
        self.functions: dict[Any, Callable] = {}

    def lines(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            match statement:
                case ast.Assign(
                    targets=[ast.Name(id=name)], value=ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()) as value
                ):
                    self.values[name] = self.truth(value)
                case ast.Assign(targets=[ast.Name(id=name)]):
                    self.values[name] = self.number(statement.value)
                case ast.Assign(targets=[ast.Subscript() as element]):
                    self.builder.store(self.number(statement.value), self._place(element))
                case ast.Pass() | ast.Expr(value=ast.Constant()):
                    pass
                case _:
                    raise _unknown(statement)

    def number(self, node: ast.expr) -> ir.Value:
        """A float64."""
        b = self.builder
        match node:
            case ast.Name(id=name) if name in self.values:
                return self.values[name]
            case ast.Constant(value=int() | float() as value):
                return ir.Constant(_DOUBLE, float(value))
            case ast.Attribute(value=ast.Name(id="math"), attr=name):
                return ir.Constant(_DOUBLE, getattr(math, name))
            case ast.Subscript():
                return b.load(self._place(node))
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
                return ir.Constant(_DOUBLE, -float(value))
            case ast.UnaryOp(op=ast.USub()):
                return b.fneg(self.number(node.operand))
            case ast.BinOp(op=ast.Pow()):
                return self._power(node)
            case ast.BinOp() if type(node.op) in _OPERATIONS:
                left = self.number(node.left)
                return getattr(b, _OPERATIONS[type(node.op)])(left, self.number(node.right))
            case ast.IfExp():
                return self._choice(node)
            case ast.Call(func=ast.Attribute(value=ast.Name(id="math"), attr=name)):
                return self._call(getattr(math, name), *map(self.number, node.args))
            case ast.Call(func=ast.Name(id="abs"), args=[x]):
                return self._call(math.fabs, self.number(x))
            case ast.Call(func=ast.Name(id="min" | "max" as name)):
                first, *others = map(self.number, node.args)
                for other in others:
                    nearer = b.fcmp_ordered("<" if name == "min" else ">", other, first)
                    first = b.select(nearer, other, first)
                return first
            case _:
                raise _unknown(node)

    def truth(self, node: ast.expr) -> ir.Value:
        """One bit."""
        b = self.builder
        match node:
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                unequal = isinstance(op, ast.NotEq)  # true beside what is no number, as in Python
                compare = b.fcmp_unordered if unequal else b.fcmp_ordered
                return compare(_COMPARED[type(op)], self.number(left), self.number(right))
            case ast.BoolOp(op=op, values=values):
                found, *others = map(self.truth, values)
                for other in others:
                    found = b.and_(found, other) if isinstance(op, ast.And) else b.or_(found, other)
                return found
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return b.not_(self.truth(operand))
            case ast.Name(id=name) if name in self.values:
                return self.values[name]
            case ast.Constant(value=bool() as value):
                return ir.Constant(ir.IntType(1), int(value))
            case _:
                raise _unknown(node)

    def _choice(self, node: ast.IfExp) -> ir.Value:
        """a if b else c, of which only one is computed."""
        b = self.builder
        with b.if_else(self.truth(node.test)) as (then, otherwise):
            with then:
                one, came = self.number(node.body), b.block
            with otherwise:
                other, went = self.number(node.orelse), b.block
        found = b.phi(_DOUBLE)
        found.add_incoming(one, came)
        found.add_incoming(other, went)
        return found

    def _power(self, node: ast.BinOp) -> ir.Value:
        """x ** n by squaring where n is a whole number that stands there, as numba does."""
        b, x = self.builder, self.number(node.left)
        try:
            n = ast.literal_eval(node.right)
        except ValueError:
            n = None
        if not isinstance(n, int):
            return self._call(operator.pow, x, self.number(node.right))
        found, left, one = None, abs(n), ir.Constant(_DOUBLE, 1.0)
        while left:
            if left & 1:
                found = x if found is None else b.fmul(found, x)
            left >>= 1
            x = b.fmul(x, x) if left else x
        found = one if found is None else found
        return b.fdiv(one, found) if n < 0 else found

    def _call(self, function: Any, *x: ir.Value) -> ir.Value:
        """A function of numbers as numba computes it."""
        if function not in self.functions:
            typing = self.context.typing_context
            kind = typing.resolve_value_type(function)
            signature = typing.resolve_function_type(kind, (types.float64,) * len(x), {})
            self.functions[function] = self.context.get_function(kind, signature)
        return self.functions[function](self.builder, x)

    def _place(self, node: ast.Subscript) -> ir.Value:
        match node:
            case ast.Subscript(value=ast.Name(id=name), slice=ast.Constant(value=int() as i)):
                return self.builder.gep(self.data[name], [ir.Constant(ir.IntType(64), i)])
        raise _unknown(node)


def _unknown(node: ast.AST) -> NotImplementedError:
    return NotImplementedError(f"no straight-line arithmetic: {ast.unparse(node)} (line {getattr(node, 'lineno', 0)})")
