"""Text of functions in C99 and Python, printed from the symbolic physics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp
from sympy.codegen.rewriting import create_expand_pow_optimization
from sympy.printing.c import C99CodePrinter
from sympy.printing.pycode import PythonCodePrinter

from ..physics import CONTACT, FrictionLaw

_POWERS = create_expand_pow_optimization(3)
U = sp.Symbol("u", real=True)
_SIGMOID = 1 / (1 + sp.exp(-U))
_NORMAL = sp.exp(-(U**2) / 2) / sp.sqrt(2 * sp.pi)
_NORMAL_SHARE = (1 + sp.erf(U / sp.sqrt(2))) / 2

# Value and slope of each activation of the networks. Slopes are written where sympy's would be 0/0 or a distribution.
ACTIVATIONS: dict[str, tuple[sp.Expr, sp.Expr]] = {
    "relu": (sp.Max(U, 0), sp.Heaviside(U, 0)),
    "silu": (U * _SIGMOID, _SIGMOID * (1 + U * (1 - _SIGMOID))),
    "tanh": (sp.tanh(U), 1 - sp.tanh(U) ** 2),
    "gelu": (U * _NORMAL_SHARE, _NORMAL_SHARE + U * _NORMAL),
    "softplus": (sp.Max(U, 0) + sp.log(1 + sp.exp(-sp.Abs(U))), _SIGMOID),
}


class _C(C99CodePrinter):
    def __init__(self) -> None:
        super().__init__({"math_macros": {}})  # M_PI and its like are none of C99

    def _print_NumberSymbol(self, expr: sp.Expr) -> str:
        return self._print(expr.evalf(17))

    def _print_Heaviside(self, expr: sp.Expr) -> str:
        return f"(({self._print(expr.args[0])}) > 0.0 ? 1.0 : 0.0)"

    def _print_sign(self, expr: sp.Expr) -> str:
        x = self._print(expr.args[0])
        return f"(({x}) > 0.0 ? 1.0 : (({x}) < 0.0 ? -1.0 : 0.0))"


class _Python(PythonCodePrinter):
    def _print_sign(self, expr: sp.Expr) -> str:
        x = self._print(expr.args[0])
        return f"(1.0 if ({x}) > 0.0 else (-1.0 if ({x}) < 0.0 else 0.0))"


def body(expressions: Sequence[sp.Expr]) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Common subexpressions (symbol, expression) and what the expressions become with them."""
    steps, results = sp.cse([_POWERS(sp.sympify(e)) for e in expressions], symbols=sp.numbered_symbols("c"))
    return steps, list(results)


def c_statements(expressions: Mapping[str, sp.Expr]) -> str:
    """C statements that assign every expression to its target ("out[0]", "return")."""
    printer = _C()
    steps, results = body(list(expressions.values()))
    lines = [f"const double {symbol.name} = {printer.doprint(expr)};" for symbol, expr in steps]
    for target, expr in zip(expressions, results, strict=True):
        lines.append(f"{target} {'' if target == 'return' else '= '}{printer.doprint(expr)};")
    return "\n".join("    " + line for line in lines)


def python_function(name: str, arguments: Sequence[str], expressions: Sequence[sp.Expr], text: str) -> str:
    """A Python function of scalars (module math) that returns the expressions."""
    printer = _Python({"fully_qualified_modules": True})
    steps, results = body(expressions)
    lines = [f'"""{text}"""', *(f"{symbol.name} = {printer.doprint(expr)}" for symbol, expr in steps)]
    lines.append("return " + ", ".join(printer.doprint(expr) for expr in results))
    return f"def {name}({', '.join(arguments)}):\n" + "\n".join("    " + line for line in lines) + "\n"


def bristle(law: FrictionLaw) -> tuple[sp.Expr, sp.Expr]:
    """z' and its derivative in z; zero for a law without memory."""
    if not law.memory:
        return sp.Integer(0), sp.Integer(0)
    rate = sp.sympify(law.bristle_rate(CONTACT, law.symbols))
    return rate, sp.diff(rate, CONTACT.z)
