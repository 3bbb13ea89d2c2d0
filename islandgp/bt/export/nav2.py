"""Nav2's own decorators, and where its nodes do something else than those that they become."""

from __future__ import annotations

from typing import Final

from islandgp.bt.export.plan import Loss

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
inverted: where it fails, the decorator succeeds without its child.
"""

GATE = Loss(
    "gate",
    "a decorator of Nav2 is a leaf in front of its child, which the program provides: it runs"
    " until the child is due; while the child runs, it is not asked",
)
RATE = Loss(
    "rate",
    "a RateController starts its child at once after a node above it was reset; `every` does so"
    " only where it was aborted or has failed",
)
ROUND = Loss(
    "round",
    'RoundRobin without wrap_around="true" ends behind its last child in newer releases of Nav2;'
    " round_robin goes on with the first one",
)
