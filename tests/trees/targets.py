"""One tree in three engines: ours, py_trees and BehaviorTree.CPP; the calls of their leaves.

A trace has a text per tick: "A! B -C = RUNNING" is A started, B resumed, C halted, in that order,
and then the root's status.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, TypeAlias

import pytest

from islandgp.bt.core.engine import ABORTED, compile_tree
from islandgp.bt.core.node import FAILURE, RUNNING, STATUS_NAMES, SUCCESS, Node, leaf, walk
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.import_cpp import read_tree

Boards: TypeAlias = Sequence[Sequence[float]]
Trace: TypeAlias = list[str]

BUILT: Final = Path(__file__).parents[2] / "build" / "behaviortree_cpp"
"""Where `build_btcpp.py` puts the library, unless BEHAVIORTREE_CPP names a folder."""


def main_tree(text: str, vocabulary: Vocabulary, *, name: str = "<xml>") -> Node:
    """The main tree of an XML file, with any losses."""
    return read_tree(text, vocabulary, name=name).tree


def with_unique_names(node: Node, numbers: Iterator[int]) -> Node:
    """The tree with a unique name for each leaf, so that calls identify leaves."""
    if node.action:
        return leaf(f"Leaf{next(numbers)}")
    return node._replace(
        children=tuple(with_unique_names(child, numbers) for child in node.children)
    )


def leaves(tree: Node) -> list[str]:
    return [node.action for node in walk(tree) if node.action]


class Script:
    """The results of leaves, one after the other, and their calls."""

    def __init__(self, results: Sequence[int]) -> None:
        self.calls: list[str] = []
        self._results = results
        self._taken = 0

    def call(self, name: str, fresh: bool) -> int:
        self.calls.append(f"{name}!" if fresh else name)
        self._taken += 1
        return self._results[(self._taken - 1) % len(self._results)]

    def halt(self, name: str) -> None:
        self.calls.append(f"-{name}")

    def take(self, status: str) -> str:
        calls, self.calls = self.calls, []
        return " ".join([*calls, "=", status])


def ours(tree: Node, boards: Boards, results: Sequence[int], places: dict[str, int]) -> Trace:
    """What our engine does."""
    script, board = Script(results), list(boards[0])
    names = {i: n.action for i, n in enumerate(walk(tree)) if n.action}

    def action(name: str) -> Callable[[bool], int]:
        return lambda fresh: script.call(name, fresh)

    def watch(place: int, status: int) -> None:
        if status == ABORTED and place in names:
            script.halt(names[place])

    actions = {name: action(name) for name in names.values()}
    tick = compile_tree(tree, actions, board, places, watch=watch, step_s=1.0)
    trace = []
    for values in boards:
        board[:] = values
        trace.append(script.take(STATUS_NAMES[tick()]))
    return trace


def in_py_trees(
    tree: Node, boards: Boards, results: Sequence[int], places: dict[str, int]
) -> Trace:
    """What the real library does with the exported module."""
    library: Any = pytest.importorskip("py_trees", reason="extra `pytrees` is not installed")
    script = Script(results)
    names = library.common.Status
    statuses = (names.FAILURE, names.SUCCESS, names.RUNNING)

    class Leaf(library.behaviour.Behaviour):  # type: ignore[misc]
        fresh = True

        def initialise(self) -> None:
            self.fresh = True

        def update(self) -> Any:
            fresh, self.fresh = self.fresh, False
            return statuses[script.call(self.name, fresh)]

        def terminate(self, new_status: Any) -> None:
            if new_status == names.INVALID and self.status == names.RUNNING:
                script.halt(self.name)

    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree), module)
    library.blackboard.Blackboard.clear()
    root = module["create_tree"](Leaf, step_s=1.0)
    writer = library.blackboard.Client(name="robot")
    for name in places:
        writer.register_key(name, access=library.common.Access.WRITE)
    trace = []
    for values in boards:
        for name, place in places.items():
            writer.set(name, values[place])
        root.tick_once()
        trace.append(script.take(root.status.name))
    return trace


class BehaviorTreeCpp:
    """The real library, in a process that loads files and ticks them."""

    def __init__(self, runner: Path, vocabulary: Vocabulary) -> None:
        self._keys = [f"{n} {'b' if key.flag else 'd'}" for n, key in vocabulary.keys.items()]
        self._process = subprocess.Popen(
            [runner], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def trace(
        self,
        tree: Node,
        boards: Boards,
        results: Sequence[int],
        *,
        tick_function: str = "exactly",
        restarting: bool = False,
    ) -> Trace:
        """The library's trace; `tick_function` is once or exactly.

        `restarting`: leaves start again after their end, as those of Nav2 do.
        """
        xml = behaviortree_cpp.to_xml(tree)
        return self.trace_of(
            xml, leaves(tree), boards, results, tick_function=tick_function, restarting=restarting
        )

    def trace_of(
        self,
        xml: str,
        names: Sequence[str],
        boards: Boards,
        results: Sequence[int],
        *,
        tick_function: str = "exactly",
        restarting: bool = False,
    ) -> Trace:
        """What the library does with the XML of any file."""
        names = sorted(set(names))
        codes = {FAILURE: "F", SUCCESS: "S", RUNNING: "R"}
        request = [
            "1", tick_function, "restarting" if restarting else "stateful",
            f"{len(xml.encode())} {xml}", str(len(names)), *names,
            str(len(self._keys)), *self._keys,
            str(len(boards)), *(repr(float(value)) for board in boards for value in board),
            str(len(results)), *(codes[result] for result in results),
        ]  # fmt: skip
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n".join(request) + "\n")
        self._process.stdin.flush()
        trace = []
        while (line := self._process.stdout.readline().strip()) != ".":
            assert line, "the process with the library died"
            trace.append(line)
        return trace

    def close(self) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait(timeout=10)
        self._process.stdout.close()


def compiled(folder: Path) -> Path:
    """The program that ticks trees in BehaviorTree.CPP; skips the test where it can't be made."""
    compiler = shutil.which("c++") or pytest.skip("no C++ compiler")
    root = Path(os.environ.get("BEHAVIORTREE_CPP", BUILT))
    include = next((p for p in (root / "include", Path("/usr/include")) if _has_headers(p)), None)
    if include is None:
        pytest.skip(
            "BehaviorTree.CPP is not here: make btcpp builds it, or BEHAVIORTREE_CPP names the"
            " folder with its include and lib"
        )
    # All static libraries that come with a build, or the installed shared one.
    libraries: list[str] = [*map(str, sorted(root.glob("lib/*.a"), key=_first))]
    nodes = Path(behaviortree_cpp.__file__).parent / "nodes"
    runner = folder / "runner"
    command = [
        compiler, "-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", "-I", str(nodes),
        "-isystem", str(include), str(Path(__file__).parent / "btcpp" / "runner.cpp"),
        *(libraries or [f"-L{root / 'lib'}", "-lbehaviortree_cpp", f"-Wl,-rpath,{root / 'lib'}"]),
        "-lpthread", "-ldl", "-o", str(runner),
    ]  # fmt: skip
    subprocess.run(command, check=True)
    return runner


def _has_headers(include: Path) -> bool:
    return (include / "behaviortree_cpp" / "bt_factory.h").is_file()


def _first(library: Path) -> bool:
    """The library itself must come before what it is linked with."""
    return library.name != "libbehaviortree_cpp.a"
