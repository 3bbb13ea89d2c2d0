"""Decision patterns: shares and counts as Fig. 8 shows them."""

from __future__ import annotations

from islandgp.supervision.decisions import decisions


def guidance(**changes: object) -> dict[str, object]:
    plain = {
        "source": "llm",
        "phase": "refinement",
        "pattern": "healthy_progress",
        "intervention": False,
        "crisis": "",
    }
    return {**plain, **changes}


def test_shares_and_counts() -> None:
    """By hand: four decisions and one generation without an answer."""
    found = decisions(
        [
            guidance(),
            guidance(),
            guidance(phase="early_exploration", pattern="stagnation", intervention=True),
            guidance(source="llm and fallback", crisis="diversity"),
            guidance(source="none", phase=None, pattern=None, crisis="stagnation"),
        ]
    )
    assert dict(found) == {
        "phases/refinement": 0.6,
        "phases/early_exploration": 0.2,
        "patterns/healthy_progress": 0.6,
        "patterns/stagnation": 0.2,
        "decisions/llm": 0.6,
        "decisions/llm_and_fallback": 0.2,
        "decisions/none": 0.2,
        "decisions/interventions": 1,
        "decisions/crises": 2,
        "decisions/fallbacks": 1,
    }


def test_a_run_of_one_generation_has_no_decisions() -> None:
    """Nothing is divided by nothing."""
    assert dict(decisions([])) == {
        "decisions/interventions": 0,
        "decisions/crises": 0,
        "decisions/fallbacks": 0,
    }
