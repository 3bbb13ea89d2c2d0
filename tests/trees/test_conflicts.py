"""Actions that share a resource never run in the same tick."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from islandgp.bt.analysis.conflicts import conflicts, without_conflicts
from islandgp.bt.core.engine import ABORTED, compile_tree
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Limits, Node, walk
from islandgp.bt.core.parameters import one_of
from islandgp.bt.core.vocabulary import Action, Vocabulary, flag
from islandgp.bt.export.declared import declared
from islandgp.domains.gymnasium.world import Choice, Filled
from islandgp.domains.gymnasium.world import _action as gymnasium_action
from islandgp.errors import DomainError
from islandgp.gp.random_trees import TreeSpace, random_tree
from islandgp.gp.variation import crossover, mutate
from tests.composed import composed
from tests.profiles import cases
from tests.trees.shell import Cli

CART = Vocabulary(
    "cart",
    {
        "DriveTo": Action(
            "drives", uses=("base",), arguments={"place": one_of("where to", ["shelf", "dock"])}
        ),
        "Rest": Action("stands still", uses=("base",)),
        "Grasp": Action("grasps", uses=("arm",)),
        "Carry": Action("drives with a raised arm", uses=("base", "arm")),
        "Beep": Action("beeps"),
    },
    {"seen": flag("something is in sight"), "low": flag("the battery is low")},
)
GP = composed().gp
SPACE = TreeSpace(GP.trees, CART, Limits(6, 40))


@pytest.mark.parametrize(
    ("text", "pairs"),
    [
        ("parallel { DriveTo DriveTo(place: dock) }", [(1, 2, "base")]),
        ("parallel { DriveTo Grasp Beep }", []),
        ("parallel { Grasp sequence { Beep Carry } }", [(1, 4, "arm")]),
        ("sequence { DriveTo Rest }", []),
        ("selector { when seen { DriveTo } Rest }", []),
        ("pipeline { DriveTo Rest }", [(1, 2, "base")]),
        ("reactive_sequence { DriveTo Rest }", [(1, 2, "base")]),
        ("reactive_selector { when seen { DriveTo } Rest }", []),
        ("reactive_selector { inverter { DriveTo } Rest }", [(2, 3, "base")]),
        ("recovery 2 { DriveTo Rest }", []),
        ("selector { parallel { DriveTo Rest } Rest }", [(2, 3, "base")]),
    ],
)
def test_pairs(text: str, pairs: list[tuple[int, int, str]]) -> None:
    """Two actions conflict where a tick can run both; one that has ended holds nothing."""
    tree = parse(text, CART)
    assert [tuple(each[:3]) for each in conflicts(tree, CART)] == pairs
    assert conflicts(without_conflicts(tree, CART), CART) == []


def held_together(tree: Node, rng: np.random.Generator) -> bool:
    """True if two leaves with a common resource are RUNNING after a tick of random results."""
    leaves = {place: node.action for place, node in enumerate(walk(tree)) if node.action}
    running: set[int] = set()

    def act(_: bool) -> int:
        return int(rng.choice([FAILURE, SUCCESS, RUNNING, RUNNING]))

    def watch(place: int, status: int) -> None:
        (running.add if status == RUNNING and place in leaves else running.discard)(place)
        assert status <= ABORTED

    board = [0.0, 0.0]
    tick = compile_tree(
        tree, dict.fromkeys(CART.actions, act), board, CART.key_index, watch=watch, step_s=1.0
    )
    for _ in range(30):
        board[:] = rng.integers(0, 2, 2).astype(float).tolist()
        tick()
        for one, other in combinations(running, 2):
            if {*CART.actions[leaves[one]].uses} & {*CART.actions[leaves[other]].uses}:
                return True
    return False


def test_random_and_bred_trees_never_share() -> None:
    """No random tree and no child has a conflict, nor two holders of a resource in any tick."""
    rng = np.random.default_rng(5)
    cross, trees = crossover("subtree"), list[Node]()
    for _ in range(cases(1000)):
        trees.append(random_tree(rng, SPACE))
        mother, father = (trees[int(rng.integers(len(trees)))] for _ in range(2))
        child = SPACE.repaired(cross(rng, mother, father, SPACE.limits))
        trees += [child, mutate(rng, child, rate=1, space=SPACE, settings=GP.mutation)[0]]
    assert any(node.kind == "parallel" for tree in trees for node in walk(tree))
    for tree in trees:
        assert conflicts(tree, CART) == []
        assert not held_together(tree, rng), to_text(tree)


DRIVES = """selector {
  parallel success one failure all { DriveTo(place: shelf)
    DriveTo(place: dock) }
  Rest
}"""


def test_check_refuses_with_both_lines(islandgp: Cli, tmp_path: Path) -> None:
    """An error at the second action that names the line of the first; import only warns."""
    words = {
        "domain": "cart",
        "actions": {
            "DriveTo": {
                "arguments": {
                    "place": {"sort": "word", "words": ["shelf", "dock"], "default": "shelf"}
                },
                "uses": ["base"],
            },
            "Rest": {"uses": ["base"]},
        },
    }  # fmt: skip
    file, tree, xml = tmp_path / "v.json", tmp_path / "t.bt", tmp_path / "t.xml"
    file.write_text(json.dumps(words), encoding="utf-8")
    tree.write_text(DRIVES, encoding="utf-8")
    result = islandgp("check", tree, "--vocabulary", file)
    assert result.code == 1
    assert result.out.startswith(
        f"{tree}:3:5: DriveTo(place: dock) can run in the same tick as DriveTo(place: shelf) in"
        " line 2, but both use base"
    )
    (entry,) = json.loads(islandgp("check", tree, "--vocabulary", file, "--json").out)
    assert (entry["severity"], entry["code"], entry["line"]) == ("error", "shared-resource", 3)
    export = islandgp("export", tree, "--vocabulary", file, "--to", "btcpp").out
    assert "uses base" in export
    xml.write_text(export, encoding="utf-8")
    assert "both use base" in islandgp("import", xml, "--vocabulary", file).err
    python = islandgp("export", tree, "--vocabulary", file, "--to", "pytrees").out
    assert "DriveTo uses base" in python
    words["actions"]["Rest"]["uses"] = ["motor"]  # type: ignore[index]
    with pytest.raises(
        DomainError, match=r"Expected resources of the vocabulary \(base\) .*'motor'"
    ):
        declared(json.dumps({**words, "resources": ["base"]}), "", name="v.json")


def test_wrong_names_are_refused() -> None:
    """A text instead of a tuple, and a name that is none."""
    for uses in ("base", ("my base",)):
        with pytest.raises(DomainError, match=r"as uses\S* of the action Go"):
            Vocabulary("cart", {"Go": Action("", uses=uses)}, {})  # type: ignore[arg-type]


def test_actions_of_gymnasium() -> None:
    """Choices use the environment's action, or the numbers of it that they set."""
    assert gymnasium_action(Choice(do=1, meaning="")).uses == ("action",)
    assert gymnasium_action(Choice(do=(0, 1), meaning="")).uses == ("number_0", "number_1")
    filled = Filled(at=1, meaning="", range=(0, 1))
    assert gymnasium_action(Choice(meaning="", arguments={"force": filled})).uses == ("number_1",)
