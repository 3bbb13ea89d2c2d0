"""What supervision took in a run, from its costs and records (section 3.9, Table 14)."""

from __future__ import annotations

from dataclasses import dataclass

from islandgp.study.arms import Run


@dataclass(frozen=True, slots=True)
class Supervision:
    """One run's bill."""

    decisions: int  # generations after which a supervisor was asked
    injected: int  # trees that it put into a population
    seconds: float  # spent waiting for it
    simulation: float  # s spent evaluating
    operators: float  # s, everything else in the loop
    simulated: int  # episodes really simulated
    dollars: float | None  # US dollars, 0 offline; None: unknown


def supervision(run: Run) -> Supervision:
    """One run's bill."""
    answers = [r.guidance for r in run.records if r.guidance is not None]
    return Supervision(
        decisions=len(answers),
        injected=sum(g.injected for g in answers),
        seconds=sum(c.supervision for c in run.costs),
        simulation=sum(c.evaluation for c in run.costs),
        operators=sum(c.operators for c in run.costs),
        simulated=sum(c.simulated for c in run.costs),
        dollars=0.0,
    )
