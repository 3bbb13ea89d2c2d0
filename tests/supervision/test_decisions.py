"""Decision patterns: shares and counts as Fig. 8 shows them."""

from __future__ import annotations

import pytest

from islandgp.supervision.base import Pattern, Phase
from islandgp.supervision.decisions import decisions


def guidance(**changes: object) -> dict[str, object]:
    plain = {
        "source": "llm",
        "phase": "refinement",
        "pattern": "healthy_progress",
        "intervention": False,
        "crisis": "",
        "injected": True,
    }
    return {"guidance": {**plain, **changes}}


def test_shares_and_counts() -> None:
    """By hand: four decisions, one silent generation and the last one, which has none."""
    found = decisions(
        [
            guidance(),
            guidance(),
            guidance(phase="early_exploration", pattern="stagnation", intervention=True),
            guidance(source="llm and fallback", crisis="diversity", injected=False),
            guidance(source="none", phase=None, pattern=None, injected=False, crisis="stagnation"),
            {"guidance": None},
        ]
    )
    expected = {
        "phase_refinement": 0.75,
        "phase_early_exploration": 0.25,
        "phase_exploitation": 0.0,
        "pattern_healthy_progress": 0.75,
        "pattern_stagnation": 0.25,
        "source_llm": 0.6,
        "source_llm_and_fallback": 0.2,
        "source_none": 0.2,
        "decisions": 4,
        "interventions": 1,
        "crises": 2,
        "crises_diversity": 1,
        "crises_stagnation": 1,
        "injected": 3,
        "fallbacks": 1,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert sum(found[f"phase_{phase}"] for phase in Phase) == pytest.approx(1)
    assert sum(found[f"pattern_{pattern}"] for pattern in Pattern) == pytest.approx(1)


def test_a_run_without_decisions_has_no_shares() -> None:
    """The baseline names no phase: every share is 0, and nothing is divided by nothing."""
    found = decisions([guidance(phase=None, pattern=None), {"guidance": None}])
    assert found["decisions"] == 0
    assert all(found[f"phase_{phase}"] == 0 for phase in Phase)
    assert decisions([])["crises"] == 0
