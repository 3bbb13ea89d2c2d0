"""Which small changes of the core its tests notice: `make mutants ARGS="--number 120 --seed 1"`.

Each mutant is one changed expression of a module of CORE, never written to disk: a forked process
imports the changed module and runs the test files that import it, until one test fails. It prints
a line for each mutant and the share that was killed. Run it in the folder of the checkout.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import os
import random
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.abc import Loader, MetaPathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, Final

CORE: Final = ("bt", "gp", "evolution", "search", "scoring", "records")
MOST_FILES: Final = 12  # test files a module
UNCHANGED: Final = -1
SECONDS: Final = 300.0  # a mutant; one that hangs is killed
SWAPS: Final[dict[type, type]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed expression."""

    file: Path  # of the package, relative to the checkout
    place: int  # which of the places that `places` finds, or UNCHANGED


def module_of(file: Path) -> str:
    """The name of a module in full."""
    return ".".join(file.with_suffix("").parts)


def places(tree: ast.AST) -> Iterator[tuple[ast.expr | ast.If, str]]:
    """The nodes that `change` can change inside functions, and what it makes of them."""
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in (found for part in function.body for found in ast.walk(part)):
            match node:
                case ast.Compare(ops=[op]) if type(op) in SWAPS:
                    yield node, SWAPS[type(op)].__name__
                case ast.BoolOp(op=op) | ast.BinOp(op=op) if type(op) in SWAPS:
                    yield node, SWAPS[type(op)].__name__
                case ast.UnaryOp(op=ast.Not()):
                    yield node, "without not"
                case ast.Constant(value=bool() | int() | float()):
                    yield node, "another constant"
                case ast.If():
                    yield node, "if not"


def change(node: Any) -> None:
    """Changes a node in its place."""
    match node:
        case ast.Compare():
            node.ops = [SWAPS[type(node.ops[0])]()]
        case ast.BoolOp() | ast.BinOp():
            node.op = SWAPS[type(node.op)]()
        case ast.UnaryOp():
            node.op, node.operand = ast.Not(), ast.UnaryOp(ast.Not(), node.operand)
        case ast.Constant(value=bool()):
            node.value = not node.value
        case ast.Constant():
            node.value += 1
        case ast.If():
            node.test = ast.UnaryOp(ast.Not(), node.test)


def mutated(mutant: Mutant) -> tuple[ast.Module, str]:
    """The changed module, and the line and kind of the change."""
    tree = ast.parse(mutant.file.read_text(encoding="utf-8"))
    if mutant.place == UNCHANGED:
        return tree, f"{mutant.file} unchanged"
    node, what = list(places(tree))[mutant.place]
    change(node)
    return ast.fix_missing_locations(tree), f"{mutant.file}:{node.lineno} {what}"


class Mutating(MetaPathFinder, Loader):
    """Imports the changed module in the place of the one on disk."""

    def __init__(self, mutant: Mutant) -> None:
        self.mutant = mutant

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:  # noqa: ARG002
        """See `MetaPathFinder`."""
        if fullname != module_of(self.mutant.file):
            return None
        return importlib.util.spec_from_file_location(
            fullname, self.mutant.file.absolute(), loader=self
        )

    def exec_module(self, module: ModuleType) -> None:
        """See `Loader`."""
        tree, _ = mutated(self.mutant)
        exec(compile(tree, str(self.mutant.file), "exec"), module.__dict__)


TESTS: Final = {f: f.read_text(encoding="utf-8") for f in sorted(Path("tests").rglob("test_*.py"))}


@cache
def tests_of(file: Path) -> tuple[str, ...]:
    """The test files that import a module; those of its own folder first, then short ones."""
    name = re.compile(rf"\b{re.escape(module_of(file))}\b")
    files = [test for test, text in TESTS.items() if name.search(text)]
    files.sort(key=lambda test: (test.parts[1] != file.parts[1], len(TESTS[test]), test))
    return tuple(map(str, files[:MOST_FILES]))


def chosen(number: int, seed: int) -> list[Mutant]:
    """So many mutants, the same ones for the same seed and sources."""
    everything = [
        Mutant(file, place)
        for part in CORE
        for file in sorted(Path("islandgp", part).rglob("*.py"))
        if tests_of(file)
        for place in range(len(list(places(ast.parse(file.read_text(encoding="utf-8"))))))
    ]
    return random.Random(seed).sample(everything, number)


def survives(mutant: Mutant) -> bool:
    """Whether all tests of its module pass."""
    child = os.fork()
    if child == 0:
        os.setsid()
        sys.meta_path.insert(0, Mutating(mutant))
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)
        import pytest

        options = ["-x", "-q", "-p", "no:cacheprovider", "-n", "0"]
        # pytest's 5: no test was chosen
        os._exit(int(pytest.main([*options, "-m", UNIT, *tests_of(mutant.file)]) not in (0, 5)))
    end = time.monotonic() + SECONDS
    ended = 0
    try:
        while time.monotonic() < end:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                return status == 0
            time.sleep(0.05)
    finally:  # it hangs, or the user has pressed Ctrl-C
        if not ended:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
    return False


UNIT: Final = "not slow and not process and not packaging"


def main() -> None:
    """Makes the mutants and prints what becomes of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    sys.path.insert(0, str(Path.cwd()))
    # What every child needs, and what no mutant is in.
    for library in ("numpy", "pydantic", "lark", "pymunk", "scipy.stats"):
        importlib.import_module(library)
    ends: Counter[tuple[str, bool]] = Counter()
    mutants = chosen(given.number, given.seed)
    if not survives(Mutant(mutants[0].file, UNCHANGED)):
        sys.exit(f"Expected the tests of {mutants[0].file} to pass unchanged; run them first.")
    for mutant in mutants:
        alive = survives(mutant)
        ends[mutant.file.parts[1], alive] += 1
        print("survived" if alive else "killed  ", mutated(mutant)[1], flush=True)
    for part in CORE:
        print(f"{part:10} killed {ends[part, False]:3}  survived {ends[part, True]:3}")
    dead = sum(number for (_, alive), number in ends.items() if not alive)
    print(f"{dead} of {given.number} mutants killed ({dead / given.number:.0%})")


if __name__ == "__main__":
    main()
