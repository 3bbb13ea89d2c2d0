"""The ablation "random injection": the expert's rates, with trees for targets drawn at random.

If targeting (Table 7) matters, the expert beats this; if any good tree helps, both do equally
well. Both choose from the same trees: compact ones until the first Complete Robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from islandgp.scoring.classes import INTEGRATION, RARE
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance
from islandgp.supervision.expert import Expert


def early_targets(targets: Sequence[str]) -> tuple[str, ...]:
    """The targets that can be chosen before the first robot of the first milestone."""
    return tuple(target for target in targets if target not in (RARE, INTEGRATION))


class Untargeted(Expert):
    """The expert's rate, and a tree for a target drawn at random."""

    name = "untargeted"

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """See `Supervisor`. Draws uniformly from the targets that the expert can choose now."""
        guidance = super().advise(state, rng)
        choices = state.targets if state.ever_quality else early_targets(state.targets)
        targets = [target for target in choices if self.library.targets.get(target)]
        if not targets:
            return guidance
        target = targets[rng.integers(len(targets))]
        tree_fields = self.tree_for(target, state, rng, ", drawn at random")
        return replace(guidance, target=target, **tree_fields)
