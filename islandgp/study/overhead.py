"""What supervision took in a run, from its costs and records (section 3.9, Table 14)."""

from __future__ import annotations

from dataclasses import dataclass

from islandgp.study.arms import Run


@dataclass(frozen=True, slots=True)
class Bill:
    """One run's bill."""

    decisions: int  # generations after which a supervisor was asked
    injected: int  # trees that it put into a population
    seconds: float  # that the run waited for it
    simulation: float  # s spent evaluating
    operators: float  # s, everything else in the loop
    simulated: int  # episodes really simulated
    requests: float  # to a language model, retries and repairs included
    latency: float  # s, all requests together
    input_tokens: float
    output_tokens: float
    fallbacks: float  # rates and trees that came from the fallback instead
    dollars: float | None  # US dollars; None: the model has no known price


def bill(run: Run) -> Bill:
    """One run's bill."""
    llm = run.costs[-1].llm  # sums since the start, by supervision.llm.ledger; {} offline
    return Bill(
        decisions=len(run.guidance),
        injected=sum(g.injected for g in run.guidance),
        seconds=sum(c.supervision for c in run.costs),
        simulation=sum(c.evaluation for c in run.costs),
        operators=sum(c.operators for c in run.costs),
        simulated=sum(c.simulated for c in run.costs),
        requests=llm.get("requests", 0),
        latency=llm.get("latency_s", 0),
        input_tokens=llm.get("input_tokens", 0),
        output_tokens=llm.get("output_tokens", 0),
        fallbacks=llm.get("fallback_rates", 0) + llm.get("fallback_trees", 0),
        dollars=llm.get("cost_usd") if llm else 0.0,
    )
