"""The MLflow metrics of a run that are computed from all its records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from islandgp.gp.edit_fates import EditFate, edit_fates
from islandgp.gp.record import GenerationRecord, GuidanceRecord
from islandgp.plain import from_plain
from islandgp.supervision.decisions import Decisions, decisions


def final_metrics(records: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, float]]:
    """The metrics of a whole run that its summary lacks: edits, and the decisions of Fig. 8."""
    guidance: list[GuidanceRecord] = []
    edited: list[GenerationRecord] = []
    for record in records:
        if edited or (record["guidance"] or {}).get("edits"):
            edited.append(from_plain(GenerationRecord, record))
        if record["guidance"] is not None:
            guidance.append(GuidanceRecord(**record["guidance"]))
    yield from _fates(edit_fates(edited))
    yield from _decisions(decisions([guidance]))


def _fates(fates: Sequence[EditFate]) -> Iterator[tuple[str, float]]:
    """Shares of the run's evaluated edits, in [0, 1]."""
    evaluated = [fate for fate in fates if fate.trial is not None]
    if n := len(evaluated):
        yield "run/edits_better", sum((fate.gain or 0) > 0 for fate in evaluated) / n
        yield "run/edits_with_children", sum(fate.children > 0 for fate in evaluated) / n
        yield "run/edits_lived", sum(fate.lived for fate in evaluated) / n


def _decisions(decisions: Decisions) -> Iterator[tuple[str, float]]:
    """The run's decisions as in Fig. 8.

    phases/<name>, patterns/<name>   share of the decisions with this phase or pattern, in [0, 1]
    decisions/<source>               share of the decisions of a source, e.g. "llm_and_fallback"
    decisions/interventions          decisions that considered an intervention necessary
    decisions/crises                 generations with the emergency rate, Eq. (7)
    decisions/fallbacks              decisions that are wholly or partly the fallback's
    """
    sections = {
        "phases": decisions.phases,
        "patterns": decisions.patterns,
        "decisions": decisions.sources,
    }
    for section, counts in sections.items():
        for name, n in counts.items():
            yield f"{section}/{name.replace(' ', '_')}", n / decisions.total
    yield "decisions/interventions", decisions.interventions
    yield "decisions/crises", decisions.crises.total()
    yield "decisions/fallbacks", sum(n for s, n in decisions.sources.items() if "fallback" in s)
