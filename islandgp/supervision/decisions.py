"""Decision patterns of a run: what Fig. 8 and section 3.7 are made of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any


def decisions(given: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, float]]:
    """Names and values, from the guidance of a run's generations (GuidanceRecord).

    phases/<name>, patterns/<name>   share of the guidance that names it, in [0, 1]
    decisions/<source>               share of the guidance from a source, as "llm_and_fallback"
    decisions/interventions          guidance that saw a need to step in
    decisions/crises                 generations with the emergency rate, Eq. (7)
    decisions/fallbacks              guidance that came from the fallback, wholly or in part
    """
    found = list(given)
    for key, section in (("phase", "phases"), ("pattern", "patterns"), ("source", "decisions")):
        for name, n in Counter(g[key] for g in found if g[key]).items():
            yield f"{section}/{name.replace(' ', '_')}", n / len(found)
    yield "decisions/interventions", sum(g["intervention"] for g in found)
    yield "decisions/crises", sum(bool(g["crisis"]) for g in found)
    yield "decisions/fallbacks", sum("fallback" in g["source"] for g in found)
