"""Decision patterns of a run: what Fig. 8 and section 3.7 are made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from islandgp.supervision.base import Pattern, Phase


def decisions(records: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    """Shares and counts of a run's decisions, from the lines of its generations.jsonl.

    phase_<name>, pattern_<name>   share of the decisions that name one, in [0, 1]
    source_<name>                  share of the decisions, spaces as underscores
    decisions                      guidance that has a phase or a pattern
    interventions                  guidance that saw a need to step in
    crises, crises_diversity, crises_stagnation   generations with the emergency rate, Eq. (7)
    injected                       trees that went into the population
    fallbacks                      guidance that came from the fallback, wholly or in part
    """
    given = [r["guidance"] for r in records if r["guidance"] is not None]
    phases = Counter(g["phase"] for g in given if g["phase"])
    patterns = Counter(g["pattern"] for g in given if g["pattern"])
    sources = Counter(g["source"] for g in given)
    crises = Counter(g["crisis"] for g in given if g["crisis"])
    return {
        **{f"phase_{p}": _share(phases[p], phases.total()) for p in Phase},
        **{f"pattern_{p}": _share(patterns[p], patterns.total()) for p in Pattern},
        **{
            f"source_{name.replace(' ', '_')}": _share(count, len(given))
            for name, count in sorted(sources.items())
        },
        "decisions": sum(bool(g["phase"] or g["pattern"]) for g in given),
        "interventions": sum(g["intervention"] for g in given),
        "crises": crises.total(),
        **{f"crises_{reason}": crises[reason] for reason in ("diversity", "stagnation")},
        "injected": sum(g["injected"] for g in given),
        "fallbacks": sum("fallback" in g["source"] for g in given),
    }


def _share(count: int, total: int) -> float:
    return count / total if total else 0.0
