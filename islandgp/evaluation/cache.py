"""No episode twice: elites' copies and twins under the same world and stage cost nothing."""

from __future__ import annotations

from collections.abc import Sequence

from islandgp.domain import Outcome
from islandgp.evaluation.base import Evaluator, Job


class Cached:
    """An evaluator that asks another one only for episodes it has not seen lately.

    Worlds change with each generation, so it remembers the last batch only.
    """

    def __init__(self, inner: Evaluator) -> None:
        self.inner = inner
        self._recent: dict[Job, Outcome] = {}

    @property
    def simulated(self) -> int:
        """Episodes that were really simulated."""
        return self.inner.simulated

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        new = [job for job in dict.fromkeys(jobs) if job not in self._recent]
        fresh = dict(zip(new, self.inner.evaluate(new), strict=True))
        known = {job: fresh.get(job) or self._recent[job] for job in jobs}
        self._recent = known
        return [known[job] for job in jobs]

    def close(self) -> None:
        """See `Evaluator`."""
        self.inner.close()
