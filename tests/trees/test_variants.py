"""Nodes and spellings of public BehaviorTree.CPP files, compared with the library itself."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import pytest

from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.import_cpp import Imported, read_tree
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import TreeError
from tests.trees.targets import BehaviorTreeCpp, compiled, in_py_trees, ours

A, B = "SeekCharger", "PatrolWaypoint"
PLACES = VOCABULARY.key_index


def read(body: str) -> Imported:
    return read_tree(file(body), VOCABULARY)


def file(body: str) -> str:
    tree = f'<BehaviorTree ID="Main" _collapsed="true">{body}</BehaviorTree>'
    return f'<root BTCPP_format="4" main_tree_to_execute="Main">{tree}</root>'


@pytest.fixture(scope="module")
def cpp(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BehaviorTreeCpp]:
    library = BehaviorTreeCpp(compiled(tmp_path_factory.mktemp("runner")), VOCABULARY)
    yield library
    library.close()


EXACT = {
    f"<Fallback><AlwaysFailure/><{A}/></Fallback>": f"selector {{ always failure {A} }}",
    f'<Sequence _collapsed="false"><AlwaysSuccess/><{A}/></Sequence>': (
        f"sequence {{ always success {A} }}"
    ),
    f"<ParallelAll><{A}/><{B}/></ParallelAll>": f"parallel failure all {{ {A} {B} }}",
    f'<ParallelAll max_failures="1"><{A}/><AlwaysFailure/></ParallelAll>': (
        f"parallel failure all {{ {A} always failure }}"
    ),
    "<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>": "always running",
    f"<Inverter><KeepRunningUntilFailure><Inverter><{A}/></Inverter></KeepRunningUntilFailure>"
    "</Inverter>": f"until_success {{ {A} }}",
}
STATED = {
    f'<Repeat num_cycles="-1"><{A}/></Repeat>': (f"until_failure {{ {A} }}", "repeat"),
    f'<RetryUntilSuccessful num_attempts="-1"><{A}/></RetryUntilSuccessful>': (
        f"until_success {{ {A} }}",
        "repeat",
    ),
    f'<Repeat num_cycles="5000"><{A}/></Repeat>': (f"repeater 5000 {{ {A} }}", "repeat"),
    f'<ParallelAll max_failures="2"><{A}/><{B}/></ParallelAll>': (
        f"parallel success one failure all {{ {A} {B} }}",
        "waits",
    ),
    f'<Parallel success_threshold="1" failure_threshold="2"><{A}/><{B}/></Parallel>': (
        f"parallel success one failure all {{ {A} {B} }}",
        "judged",
    ),
    '<Sleep msec="1500"/>': ("wait 1.5 { always success }", "clock"),
}


@pytest.mark.parametrize("body", EXACT)
def test_exact(body: str) -> None:
    """Read without a difference, and back from an export."""
    tree, differences, _ = read(body)
    assert (tree, differences) == (parse(EXACT[body], VOCABULARY), {})
    assert read_tree(to_xml(tree, VOCABULARY), VOCABULARY).tree == tree


@pytest.mark.parametrize("body", STATED)
def test_stated(body: str) -> None:
    """Read with the difference that is stated."""
    tree, differences, _ = read(body)
    text, about = STATED[body]
    assert tree == parse(text, VOCABULARY)
    assert [*differences] == [about]


@pytest.mark.parametrize("body", EXACT)
def test_ticks(cpp: BehaviorTreeCpp, body: str) -> None:
    """The library's calls of the leaves are ours, from the file and from an export."""
    rng, tree = Random(1), read(body).tree
    boards = [[0.0] * len(PLACES)] * 25
    for _ in range(40):
        results = [rng.choice([FAILURE, SUCCESS, RUNNING]) for _ in range(60)]
        expected = ours(tree, boards, results, PLACES)
        names = [name for name in (A, B) if name in body]
        assert cpp.trace_of(file(body), names, boards, results) == expected
        assert cpp.trace(tree, boards, results) == expected
        assert in_py_trees(tree, boards, results, PLACES) == expected


def test_a_script_after_a_node_is_no_decoration() -> None:
    """An attribute that writes to the blackboard is not ignored."""
    with pytest.raises(TreeError, match="unknown key with an `initial` value 'n'"):
        read(f'<{A} _onSuccess="n := 1"/>')
    with pytest.raises(TreeError, match="no equivalent of '_onHalted'"):
        read(f'<{A} _onHalted="n := 1"/>')


def test_canonical_text() -> None:
    """The new nodes print as they are written."""
    text = "selector {\n  until_success { Go }\n  always running\n}\n"
    assert to_text(parse(text)) == text
