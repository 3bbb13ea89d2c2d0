"""The package's modules and what each of them imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "islandgp"


@dataclass(frozen=True)
class Import:
    """One import statement's module."""

    module: str  # who imports, below `islandgp`: "evolution.loop"
    name: str  # what, in full: "islandgp.bt.core.node", "numpy"
    at_load: bool  # when the module is loaded; not in a function, not for the type checker alone

    @property
    def top(self) -> str:
        """The first part of the name."""
        return self.name.partition(".")[0]


def modules() -> list[Path]:
    """All source files."""
    return sorted(PACKAGE.rglob("*.py"))


def module_name(path: Path) -> str:
    """A file's module, below `islandgp`."""
    name = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    return name.removesuffix("__init__").removesuffix(".")


@cache
def imports() -> tuple[Import, ...]:
    """Every import of the package."""
    all_imports: list[Import] = []
    for path in modules():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        all_imports += _of(tree, module_name(path), at_load=True)
    return tuple(all_imports)


def _of(node: ast.AST, module: str, *, at_load: bool) -> Iterator[Import]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import):
            yield from (Import(module, alias.name, at_load) for alias in child.names)
        elif isinstance(child, ast.ImportFrom):
            assert child.level == 0, f"{module}: imports are absolute"
            # `from islandgp.bt import engine` imports a module, `from ...node import Node` a name.
            for alias in child.names:
                full_name = f"{child.module}.{alias.name}"
                yield Import(
                    module, full_name if _is_module(full_name) else str(child.module), at_load
                )
        else:
            later = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            typing = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
            yield from _of(child, module, at_load=at_load and not later and not typing)


def _is_module(name: str) -> bool:
    path = ROOT.joinpath(*name.split("."))
    return path.with_suffix(".py").exists() or (path / "__init__.py").exists()
