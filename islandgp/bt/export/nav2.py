"""Nav2's decorators, and the differences between its nodes and their equivalents."""

from __future__ import annotations

from typing import Final

from islandgp.bt.export.plan import SemanticDifference

GATES: Final = {
    "DistanceController": "sequence",
    "GoalUpdatedController": "sequence",
    "GoalUpdater": "sequence",
    "SingleTrigger": "sequence",
    "SpeedController": "sequence",
    "PathLongerOnApproach": "reactive_selector",
}
"""Decorators that become a leaf and their child, by the composite that holds both.

In a sequence the leaf succeeds when the child is due. In a selector the leaf, a condition, is
inverted: if it fails, the decorator succeeds without its child.
"""

GATE = SemanticDifference(
    "gate",
    "a decorator of Nav2 becomes a leaf before its child, which the program has to provide: the"
    " leaf runs until the child is due, and is not ticked while the child runs",
)
RATE = SemanticDifference(
    "rate",
    "a RateController starts its child at once after a node above it was reset; `every` does so"
    " only after an abort or a failure of its own",
)
ROUND = SemanticDifference(
    "round",
    'RoundRobin without wrap_around="true" ends after its last child in newer releases of Nav2;'
    " round_robin continues with the first one",
)
