"""A tree in a user's program: `islandgp.load_tree`, `Tree.bind`, `RobotTree.tick`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Generator
from fractions import Fraction
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

import islandgp
from islandgp import NodeStatus
from islandgp.binding import Tree
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import RUNNING
from islandgp.bt.core.parameters import one_of, switch
from islandgp.bt.core.vocabulary import (
    EMPTY_VOCABULARY,
    Action,
    Vocabulary,
    condition_leaf,
    flag,
    number,
)
from islandgp.errors import DomainError, OtherDomainError

ROOT = Path(__file__).resolve().parents[2]
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
PORTER = Vocabulary(
    "porter",
    {"Dock": Action("charges"), "Drive": Action("drives"), "Wave": Action("waves")},
    {"battery": number("%", 0, 100), "person": flag("somebody is near")},
)
GUARDED = "selector { when battery < 20 { Dock } Drive }"


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., islandgp.Tree]:
    """The tree of a text, from a file."""

    def loaded(text: str, vocabulary: Any = None) -> islandgp.Tree:
        (tmp_path / "my tree.bt").write_text(text, encoding="utf-8")
        return islandgp.load_tree(tmp_path / "my tree.bt", vocabulary)

    return loaded


class Porter:
    """A robot whose methods are the actions, and whose attributes and methods the keys."""

    def __init__(self) -> None:
        self.battery = 50.0
        self.events: list[str] = []

    def Dock(self) -> bool:
        self.events.append("dock")
        return True

    def Drive(self) -> Generator[None, None, bool]:
        self.events.append("start")
        try:
            while True:
                yield
        finally:
            self.events.append("stop")


def test_an_object_is_a_robot(load: Callable[..., islandgp.Tree]) -> None:
    """Methods are actions and attributes keys; a guard stops what runs before another starts."""
    porter = Porter()
    robot_tree = load(GUARDED).bind(porter)
    assert [robot_tree.tick() for _ in range(2)] == [NodeStatus.RUNNING, NodeStatus.RUNNING]
    porter.battery = 10
    assert robot_tree.tick() is NodeStatus.SUCCESS
    assert porter.events == ["start", "stop", "dock"]
    assert robot_tree.statuses == [
        NodeStatus.SUCCESS,
        NodeStatus.SUCCESS,
        NodeStatus.SUCCESS,
        NodeStatus.ABORTED,
    ]


def test_keys_are_read_once_a_tick(load: Callable[..., islandgp.Tree]) -> None:
    """Two guards on one key see the same value, and the next tick the next one."""
    values = iter([5, 50, 50])
    tree = load("selector { when battery < 20 { Dock } when battery >= 20 { Drive } }")
    leaves = {"Dock": lambda: True, "Drive": lambda: NodeStatus.RUNNING}
    robot_tree = tree.bind(leaves, keys={"battery": lambda: next(values)})
    statuses = [robot_tree.tick() for _ in range(3)]
    assert statuses == [NodeStatus.SUCCESS, NodeStatus.RUNNING, NodeStatus.RUNNING]


class Motor:
    """A leaf that is an object, with a method `stop`."""

    def __init__(self) -> None:
        self.stopped = 0

    def __call__(self) -> int:
        return NodeStatus.RUNNING

    def stop(self) -> None:
        self.stopped += 1


def test_stop_is_called(load: Callable[..., islandgp.Tree]) -> None:
    """At an abort, by `stop`, and at the end of a `with` block; once each."""
    motor, board = Motor(), {"battery": 50}
    leaves = {"Drive": motor, "Dock": lambda: True}
    with load(GUARDED).bind(leaves, board) as robot_tree:
        robot_tree.tick()
        board["battery"] = 5
        robot_tree.tick()
        assert motor.stopped == 1
        robot_tree.stop()
        assert motor.stopped == 1
        board["battery"] = 50
        robot_tree.tick()
        robot_tree.stop()
        assert motor.stopped == 2
        assert robot_tree.statuses == [
            NodeStatus.ABORTED,
            NodeStatus.FAILURE,
            None,
            NodeStatus.ABORTED,
        ]
        robot_tree.tick()
    assert motor.stopped == 3


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_exception_stops_the_robot(
    load: Callable[..., islandgp.Tree], error: type[BaseException]
) -> None:
    """A leaf that raises: all that runs is stopped, the exception goes on, the next tick starts."""
    motor, raising = Motor(), [False, True, False]

    def wave() -> int:
        if raising.pop(0):
            raise error
        return NodeStatus.RUNNING

    robot_tree = load("parallel { Drive Wave }").bind({"Drive": motor, "Wave": wave})
    robot_tree.tick()
    with pytest.raises(error):
        robot_tree.tick()
    assert motor.stopped == 1
    assert robot_tree.tick() is NodeStatus.RUNNING


def test_every_stop_is_called(load: Callable[..., islandgp.Tree]) -> None:
    """A `stop` that raises keeps no other from being called."""
    motor = Motor()

    def stubborn() -> Generator[None, None, bool]:
        try:
            yield
        finally:
            raise OSError("the motor does not answer")
        return True

    for text in ("parallel { Wave Drive }", "parallel { Drive Wave }"):
        robot_tree = load(text).bind({"Drive": motor, "Wave": stubborn})
        robot_tree.tick()
        with pytest.raises(OSError, match="motor"):
            robot_tree.stop()
    assert motor.stopped == 2


def test_each_use_has_a_generator(load: Callable[..., islandgp.Tree]) -> None:
    """An action that occurs twice in a tree runs twice."""
    starts = []

    def drive() -> Generator[None, None, bool]:
        starts.append(1)
        yield
        return True

    robot_tree = load("parallel { Drive Drive }").bind({"Drive": drive})
    assert [robot_tree.tick() for _ in range(2)] == [NodeStatus.RUNNING, NodeStatus.SUCCESS]
    assert len(starts) == 2


def test_a_leaf_gets_its_arguments(load: Callable[..., islandgp.Tree]) -> None:
    """By name, with the defaults of the vocabulary; a function that takes others is refused."""
    arguments = {"to": one_of("where", ("dock", "door")), "fast": switch("run")}
    vocabulary = Vocabulary("porter", {"Go": Action("goes", arguments=arguments)}, {})
    tree = load("sequence { Go(to: door) Go(fast: yes) }", vocabulary)
    calls: list[tuple[str, bool]] = []

    def go(to: str, fast: bool) -> bool:
        calls.append((to, fast))
        return True

    assert tree.bind({"Go": go}).tick() is NodeStatus.SUCCESS
    assert calls == [("door", False), ("dock", True)]
    with pytest.raises(DomainError, match="cannot be called with to, fast"):
        tree.bind({"Go": lambda: True})


async def later() -> bool:
    """No leaf."""
    return True


def test_all_faults_are_reported_at_once(load: Callable[..., islandgp.Tree]) -> None:
    """What is missing, what cannot be called, and what the vocabulary does not have."""
    text = "domain porter selector { when battery < 20 { Dock } Drive Wave }"
    leaves = {"Dok": lambda: True, "Drive": lambda speed: speed > 0, "Wave": later}
    with pytest.raises(DomainError) as excinfo:
        load(text, PORTER).bind(leaves, keys={"person": True})
    first, *lines = str(excinfo.value).splitlines()
    assert first.endswith("my tree.bt, found:")
    assert [re.sub(r", in .*", "", line.strip()) for line in lines] == [
        "nothing for the action Dock",
        "for the action Drive, a function that cannot be called without arguments:"
        " missing a required argument: 'speed'",
        "for the action Wave, a coroutine; write `def` in place of `async def`",
        "nothing for the key battery",
        "'Dok', which is not in the domain porter; perhaps Dock is meant",
    ]


@pytest.mark.parametrize("value", ["50", None, float("nan"), 10**400, Fraction(10**400, 3), [1]])
def test_a_key_is_a_number(load: Callable[..., islandgp.Tree], value: object) -> None:
    """Anything else is one clear error."""
    robot_tree = load(GUARDED).bind(Porter(), {"battery": lambda: value})
    with pytest.raises(DomainError, match=r"Expected a finite number.*the key battery, found"):
        robot_tree.tick()


@pytest.mark.parametrize("status", [None, 4, "SUCCESS"])
def test_a_leaf_returns_a_status(load: Callable[..., islandgp.Tree], status: Any) -> None:
    """Anything else is one clear error."""
    robot_tree = load("Wave").bind({"Wave": lambda: status})
    with pytest.raises(DomainError, match="Expected True, False or RUNNING from the action Wave"):
        robot_tree.tick()


def test_a_generator_yields_nothing(load: Callable[..., islandgp.Tree]) -> None:
    """`yield True` is no end of an action; `yield RUNNING` is a tick in which it runs."""

    def yielding(value: object) -> Generator[object, None, bool]:
        yield value
        return True

    tree = load("Drive")
    running = tree.bind({"Drive": partial(yielding, NodeStatus.RUNNING)})
    assert [running.tick(), running.tick()] == [NodeStatus.RUNNING, NodeStatus.SUCCESS]
    with pytest.raises(DomainError, match="found True; write `return True` to end the action"):
        tree.bind({"Drive": partial(yielding, True)}).tick()


@pytest.mark.parametrize("name", ["tick", "stop"])
@pytest.mark.parametrize("caller", ["leaf", "key", "thread"])
def test_one_tick_at_a_time(load: Callable[..., islandgp.Tree], name: str, caller: str) -> None:
    """A leaf, a key and another thread cannot tick or stop a tree that is in a tick."""
    errors: list[DomainError] = []

    def call() -> float:
        if len(errors) < 1:
            try:
                getattr(robot_tree, name)()
            except DomainError as error:
                errors.append(error)
        return 1

    def drive() -> bool:
        if caller == "thread":
            (thread := Thread(target=call)).start()
            thread.join()
        elif caller == "leaf":
            call()
        return True

    battery: Any = call if caller == "key" else 50
    robot_tree = load("when battery > 0 { Drive }").bind({"Drive": drive, "battery": battery})
    assert robot_tree.tick() is NodeStatus.SUCCESS
    assert str(errors[0]).startswith(f"Expected {name}() between two ticks of ")
    assert robot_tree.tick() is NodeStatus.SUCCESS
    robot_tree.stop()


@pytest.mark.parametrize("step_s", [0, -1, float("nan"), float("inf"), "1"])
@pytest.mark.parametrize("text", ["Drive", "wait 2 { Drive }"])
def test_the_time_of_a_tick(load: Callable[..., islandgp.Tree], text: str, step_s: Any) -> None:
    """It is checked also where no node counts seconds."""
    with pytest.raises(DomainError, match="Expected seconds above 0 as step_s"):
        load(text).bind({"Drive": lambda: True}, step_s=step_s)


def test_the_words_of_a_file(load: Callable[..., islandgp.Tree], tmp_path: Path) -> None:
    """A tree is checked against its domain: an installed one, or a file that declares it."""
    assert load("domain island PatrolWaypoint").actions() == ("PatrolWaypoint",)
    with pytest.raises(islandgp.TreeError, match="unknown action 'PatrolWaypont'"):
        load("domain island PatrolWaypont")
    with pytest.raises(OtherDomainError, match="islandgp domain porter --json"):
        load("# a robot\ndomain porter Wave")
    with pytest.raises(islandgp.TreeError):
        load("domain cartpole Wave")
    declared = tmp_path / "robot.json"
    declared.write_text(json.dumps({"domain": "porter", "actions": {"Wave": {}}}))
    assert load("domain porter Wave", declared).bind({"Wave": lambda: True}).tick()
    with pytest.raises(islandgp.TreeError, match="Drive"):
        load("domain porter Drive", str(declared))


def test_files_that_are_no_trees(tmp_path: Path) -> None:
    """Each is one clear error."""
    (tmp_path / "empty.bt").write_text("")
    (tmp_path / "bytes.bt").write_bytes(b"\xff")
    for name in ("missing.bt", "empty.bt", "bytes.bt", "."):
        with pytest.raises(islandgp.IslandError, match=r"xpected"):
            islandgp.load_tree(tmp_path / name)


def test_the_tutorials_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The program of docs/tutorial.md, at most 21 lines, prints what the tutorial shows."""
    monkeypatch.chdir(tmp_path)
    for name, text in re.findall(r"^```(?:bt|python) (\S+)\n(.*?)^```$", TUTORIAL, re.S | re.M):
        (tmp_path / name).write_text(text, encoding="utf-8")
    program = (tmp_path / "my_robot.py").read_text(encoding="utf-8")
    assert len([line for line in program.splitlines() if line.strip()]) <= 21
    exec(compile(program.replace("0.05", "0"), "my_robot.py", "exec"), {"__name__": "__main__"})
    lines = capsys.readouterr().out.splitlines()
    documented = TUTORIAL.split("aborts the patrol:\n\n```\n")[1].split("\n...")[0].splitlines()
    assert lines[: len(documented)] == documented
    assert documented.count("wheels stopped") == 2  # at the end of an action, and at an abort
    assert lines[-1] == "wheels stopped"  # at the end of the with block
    assert len(lines) == 20 + 4


def test_conditions_in_code() -> None:
    """A condition is a function that answers at once; an action may go on."""
    asks = condition_leaf("the way is clear", {"to": one_of("where to", ("dock", "door"))})
    vocabulary = Vocabulary("robot", {"IsClear": asks, "Go": Action("goes")}, {})
    node = parse("sequence { IsClear(to: door) Go }", vocabulary)
    tree = Tree(node, vocabulary, "a.bt")
    leaves = {"IsClear": lambda to: to == "door", "Go": lambda: RUNNING}
    assert tree.bind(leaves).tick() is NodeStatus.RUNNING
    with pytest.raises(DomainError, match="True or False from the condition IsClear"):
        tree.bind({**leaves, "IsClear": lambda to: RUNNING}).tick()  # noqa: ARG005
    with pytest.raises(DomainError, match="of a condition"):
        Vocabulary("robot", {"IsClear": Action("asks", condition=True)}, {})


def test_seconds_of_a_program() -> None:
    """A tree that waits needs the time between its ticks."""
    tree = Tree(parse("wait 0.2 { Go }"), EMPTY_VOCABULARY, "a.bt")
    with pytest.raises(DomainError, match="step_s"):
        tree.bind({"Go": lambda: True})
    bound = tree.bind({"Go": lambda: True}, step_s=0.1)
    ends = [bound.tick() for _ in range(3)]
    assert ends == [NodeStatus.RUNNING, NodeStatus.RUNNING, NodeStatus.SUCCESS]


def test_orders_are_those_of_the_seed() -> None:
    """Equal seeds try the children of a random_selector in equal orders; 0 is the default."""
    tree = Tree(parse("random_selector { A B C D }"), EMPTY_VOCABULARY, "t.bt")

    def orders(**seed: Any) -> str:
        tried: list[str] = []
        leaves = {name: partial(tried.append, name) for name in "ABCD"}
        bound = tree.bind({n: lambda f=leaf: bool(f()) for n, leaf in leaves.items()}, **seed)
        for _ in range(5):
            bound.tick()
        return "".join(tried)

    assert orders() == orders(seed=0) != orders(seed=1) == orders(seed=1)
    for wrong in (-1, 1.5, "1"):
        with pytest.raises(DomainError, match="Expected a whole number >= 0 as seed, found"):
            orders(seed=wrong)
