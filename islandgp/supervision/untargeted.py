"""The ablation "random injection": as many trees, of the same library, blind to what lacks.

If targeting is what helps (Table 7), the expert beats this; if any good tree
helps, the two are alike. Both have the same trees to choose from: compact ones
until a Complete Robot has existed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import Guidance
from islandgp.supervision.expert import Expert, early


class Untargeted(Expert):
    """The expert's rate, and a tree for a target drawn at random."""

    name = "untargeted"

    def advise(self, state: PopulationState, rng: np.random.Generator) -> Guidance:
        """Every target with a tree that the expert could have now is as likely as another."""
        guidance = super().advise(state, rng)
        now = state.targets if state.ever_quality else early(state.targets)
        targets = [target for target in now if self.library.targets.get(target)]
        target = targets[rng.integers(len(targets))]
        name = self.pick(target, state, rng)
        return replace(
            guidance,
            target=target,
            tree=self.library.trees[name],
            rationale=f"{target}, drawn at random: tree {name}",
        )
