"""Names of subtrees in the trees of runs and of `islandgp prune`."""

from __future__ import annotations

from hypothesis import given

from islandgp.bt.analysis.names import with_names
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node
from islandgp.bt.core.printer import with_subtrees
from islandgp.domains.island.vocabulary import VOCABULARY
from tests.profiles import examples
from tests.strategies import nodes

BETTER = parse(
    """
subtree recharge = sequence { SeekCharger ExecuteCharge }
selector { when batteryLevel < 15 { use recharge } PatrolWaypoint }
""",
    VOCABULARY,
    marked=True,
)


def test_names_are_kept_and_repetitions_get_one() -> None:
    """A branch of the first tree has its name; one that repeats is named after its last action."""
    tree = parse(
        """
selector {
  when foundGarbage { sequence { MoveToGarbage PickupGarbage } }
  when batteryLevel < 40 { sequence { SeekCharger ExecuteCharge } }
  when lap > 2 { sequence { MoveToGarbage PickupGarbage } }
}
""",
        VOCABULARY,
    )
    assert with_subtrees(with_names(tree, VOCABULARY, [BETTER])) == (
        """subtree pickup_garbage = sequence { MoveToGarbage PickupGarbage }

subtree recharge = sequence { SeekCharger ExecuteCharge }

selector {
  when foundGarbage { use pickup_garbage }
  when batteryLevel < 40 { use recharge }
  when lap > 2 { use pickup_garbage }
}
"""
    )


@given(tree=nodes())
@examples(200)
def test_names_change_no_tree(tree: Node) -> None:
    """The text with names is that of an equal tree."""
    named = with_names(tree, VOCABULARY, [BETTER])
    assert named == tree
    assert parse(with_subtrees(named)) == tree
