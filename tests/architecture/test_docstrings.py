"""The documented surface has Args, Returns and Raises (Google style)."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import islandgp
from tests.architecture.sources import ROOT

PROTOCOLS = {
    "islandgp.evaluation.base": ["Evaluator"],
    "islandgp.search.base": ["Search"],
    "islandgp.supervision.base": ["Supervisor", "GenerationListener", "SupervisorLifecycle"],
    "islandgp.tracking.base": ["Tracker"],
}
AUTHORS = ("islandgp.domain.contract", "islandgp.domain.simulator", "islandgp.testing.check")
"""Modules that the reference of the Python interface shows whole, as MODULES of docs/pages.py."""


def surface() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Every public function and method of the documented surface, with its dotted name."""
    for name, module in islandgp._HOMES.items():
        yield from _functions(_origin(module, name), [name])
    for module, names in PROTOCOLS.items():
        yield from _functions(module, names)
    for module in AUTHORS:
        yield from _functions(module, None)


def _parsed(module: str) -> ast.Module:
    return ast.parse(ROOT.joinpath(*module.split(".")).with_suffix(".py").read_text("utf-8"))


def _origin(module: str, name: str) -> str:
    """The module that defines a name which another one may import."""
    for node in _parsed(module).body:
        if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
            return str(node.module)
    return module


def _functions(module: str, names: list[str] | None) -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in _parsed(module).body:
        name = getattr(node, "name", "_")
        if name.startswith("_") or (names is not None and name not in names):
            continue
        if isinstance(node, ast.FunctionDef):
            yield f"{module}.{name}", node
        elif isinstance(node, ast.ClassDef):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and not method.name.startswith(
                    ("_", "test_")
                ):
                    yield f"{module}.{name}.{method.name}", method


def gaps(function: ast.FunctionDef) -> list[str]:
    """The sections and arguments that a function's docstring lacks."""
    text = ast.get_docstring(function) or ""
    if text.startswith("See `"):  # it keeps the contract of a protocol, documented there
        return []
    spec = function.args
    arguments = [a.arg for a in (*spec.args, *spec.kwonlyargs) if a.arg not in ("self", "cls")]
    arguments += [f"*{spec.vararg.arg}"] if spec.vararg else []
    missing = [
        f"Args: {a}" for a in arguments if not re.search(rf"^ {{4}}{re.escape(a)}: ", text, re.M)
    ]
    returns = function.returns is not None and ast.unparse(function.returns) != "None"
    if arguments and returns and not re.search(r"^(Returns|Yields):$", text, re.M):
        missing.append("Returns")
    if _raises(function) and not re.search(r"^Raises:$", text, re.M):
        missing.append("Raises")
    return missing


def _raises(node: ast.AST) -> bool:
    """True if a function's own body, without its inner functions, raises a new exception."""
    return any(
        (isinstance(child, ast.Raise) and child.exc is not None)
        or (not isinstance(child, ast.FunctionDef | ast.Lambda) and _raises(child))
        for child in ast.iter_child_nodes(node)
    )


def test_the_documented_surface_is_documented() -> None:
    """Each public function has a description of every argument, its result and its errors."""
    missing = [f"{name}: {', '.join(g)}" for name, function in surface() if (g := gaps(function))]
    assert missing == []


def test_a_gap_is_found() -> None:
    """A function without sections lacks all three; a property or one without arguments none."""
    source = '''def area(width: float, *, height: float) -> float:
    """The area.

    Args:
        width: m, > 0.
    """
    if width <= 0:
        raise ValueError(width)
    return width * height
'''
    [function] = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef)
    assert gaps(function) == ["Args: height", "Returns", "Raises"]
