"""Each form of a declaration in a vocabulary works wherever a tree is used.

The way of each: check, `bind`, BehaviorTree.CPP and back, py_trees, and the bindings of the ROS 2
plug-in, for which ROS need not run.
"""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any, Final

import pytest

from islandgp.binding import NodeStatus, Tree
from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.language import parse, tree_errors
from islandgp.bt.core.parameters import adapter
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.bt.export import behaviortree_cpp, py_trees
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp_ros2.keys import RosKeys
from islandgp_ros2.leaves import functions
from islandgp_ros2.robot_map import RobotMap


def argument(tree: str, value: object, **declaration: object) -> tuple[Any, ...]:
    """A tree with an action `Go` of one argument, and what its function gets."""
    return {"Go": {"arguments": {"v": declaration}}}, {}, {}, tree, [{"v": value}]


def key(condition: str, value: object, **declaration: object) -> tuple[Any, ...]:
    """A tree that asks a key, which holds for the value."""
    tree = f"when {condition} {{ Go }}"
    return {"Go": {}}, {"k": declaration}, {"k": value}, tree, [{}]


def written(tree: str, **declaration: object) -> tuple[Any, ...]:
    """A tree that writes a key before `Go`."""
    return {"Go": {}}, {"k": declaration}, {}, f"sequence {{ {tree} Go }}", [{}]


CASES: Final[dict[str, tuple[Any, ...]]] = {
    # name: actions, keys, values of the keys, tree, arguments of each call
    "flag, false": argument("Go", False, sort="flag", default=False),
    "flag, no": argument("Go", False, sort="flag", default="no"),
    "flag, true": argument("Go(v: no)", False, sort="flag", default=True),
    "flag, yes": argument("Go", True, sort="flag", default="yes"),
    "flag without default": argument("Go(v: yes)", True, sort="flag"),
    "flag with words": argument("Go(v: yes)", True, sort="flag", words=["no", "yes"], default="no"),
    "number": argument("Go", 0.5, sort="number", low=0.1, high=1, default=0.5, unit="m/s"),
    "number below 0": argument("Go(v: -2.25)", -2.25, sort="number", low=-5, high=5, default=0),
    "number in steps": argument("Go(v: 3)", 3.0, sort="number", low=0, high=4, step=0.5, default=1),
    "logarithmic": argument(
        "Go(v: 10)", 10.0, sort="number", low=0.001, high=100, logarithmic=True, default=1
    ),
    "integer": argument("Go(v: 3)", 3, sort="integer", low=1, high=5, step=1, default=2),
    "integer without step": argument("Go", 2, sort="integer", low=1, high=5, default=2),
    "word": argument("Go(v: door)", "door", sort="word", words=["dock", "door"], default="dock"),
    "word like a keyword": argument(
        "Go(v: timeout)", "timeout", sort="word", words=["all", "timeout"], default="all"
    ),
    "text": argument('Go(v: "a b, c: {d} <&>")', "a b, c: {d} <&>", sort="text", default=""),
    "text by default": argument("Go", "it's /scan", sort="text", default="it's /scan"),
    "flag key": key("k", True),
    "flag key, declared": key("not k", False, flag=True),
    "number key": key("k < 2.5", 2, low=0, high=9.5),
    "number key, declared": key("k > -1", 0, flag=False, low=-3, high=9, step=0.5, most=20),
    "whole key": key("k == 3", 3, low=0, high=9, whole=True),
    "key of words": key("k == fast", "fast", words=["slow", "fast"]),
    "key of texts": key('k != "a b"', "c", words=["a b", "c"]),
    "sum of keys": key("2 * k + 1 > 4", 2, low=0, high=9),
    "two keys": (
        {"Go": {}}, {"a": {"low": 0, "high": 1}, "b": {"low": 0, "high": 2}},
        {"a": 1, "b": 2}, "when a < b { Go }", [{}],
    ),
    "written flag": written("set k = yes", initial="no"),
    "written flag, true": written("set k = no", initial=True),
    "written number": written("set k = k + 1", low=0, high=9, initial=0),
    "written whole": written("set k = 3", low=0, high=9, whole=True, initial=2),
    "written word": written("set k = fast", words=["slow", "fast"], initial="slow"),
    "resources": (
        {"Go": {"uses": ["base"]}, "Wave": {"uses": ["arm"]}}, {}, {},
        "parallel { Go Wave }", [{}, {}],
    ),
    "statuses": ({"Go": {"statuses": ["SUCCESS", "FAILURE"]}}, {}, {}, "Go", [{}]),
    "condition": (
        {"Go": {"condition": True, "statuses": ["SUCCESS", "FAILURE"]}}, {}, {}, "Go", [{}],
    ),
    "to start and to succeed": (
        {"Go": {"to_start": [["k", ">", 1]], "to_succeed": [["k", "<", 5]]}},
        {"k": {"low": 0, "high": 9}}, {"k": 3}, "Go", [{}],
    ),
    "gives, changes and after": (
        {"Go": {"gives": [["f", "is", 0]], "changes": {"k": -1}}, "Wave": {"after": ["Go"]}},
        {"f": {}, "k": {"low": 0, "high": 9}}, {}, "sequence { Go Wave }", [{}, {}],
    ),
    "sets": (
        {"Go": {"sets": ["k"]}}, {"k": {"low": 0, "high": 9, "initial": 0}}, {},
        "sequence { Go when k < 1 { Go } }", [{}, {}],
    ),
    "seconds": ({"Go": {}}, {}, {}, "timeout 2.5 { Go }", [{}]),
    "list": (
        {"Go": {"arguments": {"v": {"sort": "word", "words": ["a", "b"], "default": "a"}}}}, {}, {},
        "for place in [a, b] { Go(v: place) }", [{"v": "a"}, {"v": "b"}],
    ),
}  # fmt: skip

FROM_KEYS: Final = {
    "flag": ({"sort": "flag"}, {}, True),
    "number": ({"sort": "number", "low": 0, "high": 9, "default": 0}, {"low": 0, "high": 9}, 2.5),
    "integer": (
        {"sort": "integer", "low": 0, "high": 9, "default": 0},
        {"low": 0, "high": 9, "whole": True}, 3,
    ),
    "word": (
        {"sort": "word", "words": ["a", "b"], "default": "a"}, {"words": ["b", "a"]}, "b",
    ),
}  # fmt: skip
"""Arguments that keys give: their declarations, and the value of the key."""
CASES.update(
    (
        f"{name} from a key",
        ({"Go": {"arguments": {"v": one}}}, {"k": other}, {"k": value}, 'Go(v: "{k}")', [value]),
    )
    for name, (one, other, value) in FROM_KEYS.items()
)


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Vocabulary, dict[str, object], str, list[Any]]:
    """A vocabulary from its JSON, values of the keys, a tree, and the arguments of each call."""
    actions, keys, values, text, calls = CASES[request.param]
    declaration = {"domain": "bot", "actions": actions, "keys": keys}
    vocabulary = declared(json.dumps(declaration), text, name="bot.json")
    calls = [each if isinstance(each, dict) else {"v": each} for each in calls]
    return vocabulary, values, text, calls


def test_check_and_json(case: Any) -> None:
    """A tree has no errors, warnings can be given, and the vocabulary is read back as it was."""
    vocabulary, _, text, _ = case
    assert tree_errors(text, vocabulary, name="t.bt", folder=None) == []
    warnings(text, vocabulary)
    kind = adapter(Vocabulary)
    plain = kind.dump_python(vocabulary, mode="json", exclude_defaults=True)
    assert declared(json.dumps(plain), text, name="again.json") == vocabulary


def test_bind_and_ros(case: Any, tmp_path: Path) -> None:
    """A function gets the values as they are declared, directly and as a leaf of a robot map."""
    vocabulary, values, text, calls = case
    tree = Tree(parse(text, vocabulary), vocabulary, "t.bt")
    got: list[dict[str, object]] = []

    def called(**arguments: object) -> bool:
        got.append(arguments)
        return True

    def ticked(leaves: Any, keys: Any) -> None:
        got.clear()
        assert tree.bind(leaves, keys, step_s=0.5).tick() == NodeStatus.SUCCESS
        assert got == calls
        assert [*map(type, got[0].values())] == [*map(type, calls[0].values())]

    inputs = {name: value for name, value in values.items() if name in tree.inputs()}
    ticked(dict.fromkeys(vocabulary.actions, called), inputs)
    file = tmp_path / "leaves.py"
    names = {name for name in vocabulary.actions if name in tree.actions()}
    file.write_text("".join(f"def {n}(keys, **a): return keys.called(**a)\n" for n in names))
    given = {name: {"initial": value} for name, value in values.items()}
    robot_map = RobotMap.model_validate({"actions": {}, "keys": given})
    ros_keys = RosKeys(None, robot_map.keys)
    ros_keys.vocabulary = vocabulary
    ros_keys.called = called  # type: ignore[attr-defined]
    leaves = functions(file, ros_keys)
    ticked(leaves, {name: partial(ros_keys.__getitem__, name) for name in inputs})


def test_behaviortree_cpp(case: Any) -> None:
    """The XML has the same tree, and its model declares the same types of arguments."""
    vocabulary, _, text, _ = case
    tree = parse(text, vocabulary)
    xml = behaviortree_cpp.to_xml(tree, vocabulary)
    assert read_tree(xml, vocabulary, name="t.xml").tree == tree
    model = declared(xml, xml, name="t.xml").actions
    for name, action in model.items():
        assert [*action.arguments] == [*vocabulary.actions[name].arguments]


def test_py_trees(case: Any, request: pytest.FixtureRequest) -> None:
    """The module gives each leaf the values as they are declared."""
    library = pytest.importorskip("py_trees", reason="extra `pytrees` is not installed")
    vocabulary, values, text, calls = case
    tree = parse(text, vocabulary)
    if request.node.callspec.params["case"].endswith("from a key"):
        with pytest.raises(Exception, match="py_trees"):
            py_trees.to_python(tree, vocabulary)
        return
    module: dict[str, Any] = {}
    exec(py_trees.to_python(tree, vocabulary), module)
    got: list[dict[str, object]] = []

    def leaf(name: str, **arguments: object) -> Any:
        got.append(arguments)
        return library.behaviours.Success(name)

    library.blackboard.Blackboard.clear()
    root = module["create_tree"](leaf, step_s=0.5)
    writer = library.blackboard.Client(name="robot")
    for name, declaration in vocabulary.keys.items():
        writer.register_key(name, access=library.common.Access.WRITE)
        first = declaration.initial if declaration.writable else 0
        writer.set(name, values.get(name, first == "yes" if declaration.flag else first))
    root.tick_once()
    assert (root.status.name, got) == ("SUCCESS", calls)
    assert [*map(type, got[0].values())] == [*map(type, calls[0].values())]
