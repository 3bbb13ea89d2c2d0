"""Mutation testing of the package by its unit tests: `make mutants ARGS="--seed 1"`.

Each mutant is one changed expression of a function. The tests are collected once; for each mutant
a forked process replaces the function's code and runs the tests of the files that import its
module, until one fails. It prints a line for each mutant and the share that was killed.
`--again FILE` runs the mutants of an earlier output, each against the test that killed it first.
"""

from __future__ import annotations

import argparse
import ast
import gc
import os
import random
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, Final

import pytest

PARTS: Final = (
    "bt", "gp", "evolution", "search", "scoring", "records", "domains", "evaluation",
    "supervision", "config", "compare", "tracking", "running", "viewer", "commands",
)  # fmt: skip
MOST_FILES: Final = 12  # test files a module
SECONDS: Final = 900.0  # a mutant that hangs where no test's time limit reaches it is killed
UNIT: Final = "not slow and not process and not packaging"
SWAPS: Final[dict[type, type]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip
TESTS: Final = {f: f.read_text(encoding="utf-8") for f in sorted(Path("tests").rglob("test_*.py"))}
LINE: Final = re.compile(r"(?:killed|survived) +(\S+) (\S+) #(\d+) \[.*?\] ?(.*)")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One changed expression. It keeps its identity when the lines above it change."""

    file: Path  # of the package, relative to the checkout
    function: str  # qualified name of a function or method of the module
    place: int  # index in the results of `places` for the function
    killer: str = ""  # the test that killed it in an earlier run

    @property
    def name(self) -> str:
        """Its name in the output."""
        return f"{self.file} {self.function} #{self.place}"


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """The functions of a module and the methods of its classes, by qualified name."""
    for node in tree.body:
        match node:
            case ast.FunctionDef():
                yield node.name, node
            case ast.ClassDef():
                for part in node.body:
                    if isinstance(part, ast.FunctionDef):
                        yield f"{node.name}.{part.name}", part


def places(function: ast.FunctionDef) -> Iterator[tuple[ast.expr | ast.If, str]]:
    """The nodes of a function that `change` can change, each with a description of the change."""
    for node in (inner for part in function.body for inner in ast.walk(part)):
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
    """Changes a node in place."""
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


@cache
def mutated(mutant: Mutant) -> tuple[ast.Module, str] | None:
    """The changed module and a description of the change; None if the sources have no such place.

    `main` makes all mutants before it imports the package, as the sources may change meanwhile.
    """
    try:
        tree = ast.parse(mutant.file.read_text(encoding="utf-8"))
        node, description = list(places(dict(functions(tree))[mutant.function]))[mutant.place]
    except (OSError, KeyError, IndexError):
        return None
    change(node)
    return ast.fix_missing_locations(tree), f"line {node.lineno}: {description}"


def codes(code: CodeType) -> Iterator[CodeType]:
    """All code objects inside a module's code object."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from codes(constant)


def install(mutant: Mutant, tree: ast.Module) -> None:
    """Replaces the code of the function in this process."""
    file = str(mutant.file.absolute())
    module = compile(tree, file, "exec")
    code = next(c for c in codes(module) if c.co_qualname == mutant.function)
    for thing in gc.get_objects():
        if isinstance(thing, FunctionType) and thing.__code__.co_filename == file:
            old = thing.__code__
            if (old.co_qualname, old.co_firstlineno) == (code.co_qualname, code.co_firstlineno):
                thing.__code__ = code


@cache
def tests_of(file: Path) -> tuple[str, ...]:
    """The test files that import a module: first those of the same folder, and short ones first."""
    module = ".".join(file.with_suffix("").parts)
    name = re.compile(rf"\b{re.escape(module)}\b")
    files = [test for test, text in TESTS.items() if name.search(text)]
    files.sort(key=lambda test: (test.parts[1] != file.parts[1], len(TESTS[test]), test))
    return tuple(map(str, files[:MOST_FILES]))


def sample(number: int, seed: int) -> list[Mutant]:
    """This number of mutants, the same ones for the same seed and sources."""
    everything = [
        Mutant(file, name, place)
        for part in PARTS
        for file in sorted(Path("islandgp", part).rglob("*.py"))
        if tests_of(file)
        for name, function in functions(ast.parse(file.read_text(encoding="utf-8")))
        for place in range(len(list(places(function))))
    ]
    return random.Random(seed).sample(everything, number)


def earlier(output: Path) -> list[Mutant]:
    """The mutants of an output, with their killers."""
    matches = map(LINE.match, output.read_text(encoding="utf-8").splitlines())
    return [Mutant(Path(m[1]), m[2], int(m[3]), m[4]) for m in matches if m]


def killer(mutant: Mutant | None, items: Sequence[pytest.Item], cpu: float) -> str | None:
    """The first test that fails with a mutant, run in another process; None if none does.

    Args:
        mutant: None runs the tests without a change.
        items: The tests, in the order in which they run.
        cpu: CPU seconds; after them no further test begins.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        _run(mutant, items, cpu, writing)
    os.close(writing)
    end = time.monotonic() + SECONDS
    while not (ended := os.waitpid(child, os.WNOHANG)[0]) and time.monotonic() < end:
        time.sleep(0.05)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    if not ended:
        os.waitpid(child, 0)
    with os.fdopen(reading) as pipe:
        *running, last = [*pipe.read().split("\n")] or [""]
    return None if last == "passed" else running[-1] if running else "(it crashed)"


def _run(mutant: Mutant | None, items: Sequence[pytest.Item], cpu: float, writing: int) -> None:
    """Writes each test's name before it runs, then "passed" if all did. Does not return."""
    cpu += time.process_time()
    try:
        os.setsid()
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silence, stream)
        if mutant:
            changed = mutated(mutant)
            assert changed
            install(mutant, changed[0])
        session = items[0].session
        for item, after in zip(items, [*items[1:], None], strict=True):
            os.write(writing, f"{item.nodeid}\n".encode())
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
            if session.testsfailed:
                os._exit(1)
            if time.process_time() > cpu:
                break
        os.write(writing, b"passed")
    finally:
        os._exit(0)


class Mutating:
    """A plugin of pytest that runs mutants instead of the tests."""

    def __init__(self, mutants: Sequence[Mutant], cpu: float) -> None:
        self.mutants = mutants
        self.cpu = cpu
        self.unreliable: set[str] = set()
        self.reliable: set[str] = set()

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Prints a line for each mutant, and the shares."""
        gc.unfreeze()  # tests/conftest.py hides the modules from `gc`
        ends: Counter[tuple[str, bool]] = Counter()
        for mutant in self.mutants:
            if not (changed := mutated(mutant)):
                print(f"gone     {mutant.name}", flush=True)
                continue
            by = self._killer(mutant, session.items)
            ends[mutant.file.parts[1], by is not None] += 1
            word = "survived" if by is None else "killed  "
            print(f"{word} {mutant.name} [{changed[1]}] {by or ''}".rstrip(), flush=True)
        for part in PARTS:
            print(f"{part:12} killed {ends[part, True]:3}  survived {ends[part, False]:3}")
        dead = sum(number for (_, killed), number in ends.items() if killed)
        print(f"{dead} of {ends.total()} mutants killed ({dead / max(ends.total(), 1):.0%})")
        return True

    def _killer(self, mutant: Mutant, items: Sequence[pytest.Item]) -> str | None:
        """`killer`, but only of a test that passes without the mutant."""
        files = tests_of(mutant.file)

        def cost(item: pytest.Item) -> tuple[bool, bool, int]:
            slow = hasattr(getattr(item, "obj", None), "hypothesis")
            return item.nodeid != mutant.killer, slow, files.index(item.nodeid.split("::")[0])

        candidates = sorted((i for i in items if i.nodeid.split("::")[0] in files), key=cost)
        while candidates := [item for item in candidates if item.nodeid not in self.unreliable]:
            by = killer(mutant, candidates, self.cpu)
            if by is None or by in self.reliable:
                return by
            alone = [item for item in candidates if item.nodeid == by]
            if alone and killer(None, alone, self.cpu) is None:
                self.reliable.add(by)
                return by
            self.unreliable.add(by)
        return None


def main() -> None:
    """Makes the mutants and prints for each whether it was killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--again", type=Path, metavar="FILE", help="the output of an earlier run")
    parser.add_argument("--cpu", type=float, default=15, help="CPU seconds of tests a mutant")
    parser.add_argument("--part", default="0/1", help="I/N: each N-th mutant from the I-th on")
    args = parser.parse_args()
    mutants = earlier(args.again) if args.again else sample(args.number, args.seed)
    start, step = map(int, args.part.split("/"))
    mutants = mutants[start::step]
    for mutant in mutants:
        mutated(mutant)
    files = sorted({test for mutant in mutants for test in tests_of(mutant.file)})
    options = ["-s", "-q", "-p", "no:cacheprovider", "-n", "0", "--timeout", "300"]
    options += ["--hypothesis-profile", "mutants", "-m", UNIT]
    sys.exit(pytest.main([*options, *files], plugins=[Mutating(mutants, args.cpu)]))


if __name__ == "__main__":
    main()
