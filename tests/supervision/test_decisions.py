"""What supervisors decided, counted by hand."""

from __future__ import annotations

from collections import Counter

from islandgp.supervision.decisions import decisions
from tests.compare.fake_runs import guidance


def test_counts() -> None:
    """Two runs: decisions without a label are left out, and a crisis that lasts begins once."""
    one = [
        guidance(source="llm", phase="refinement", pattern="stagnation", crisis="diversity"),
        guidance(source="llm", phase="refinement", crisis="diversity", intervention=True),
        guidance(source="fallback", crisis="stagnation"),
    ]
    other = [
        guidance(source="llm", crisis="diversity", target="clearing", injected=True),
        guidance(source="llm", target="charging", injected=False),
    ]
    counts = decisions([one, other])
    assert counts.total == 5
    assert counts.sources == Counter(llm=4, fallback=1)
    assert counts.phases == Counter(refinement=2)
    assert counts.patterns == Counter(stagnation=1)
    assert counts.targets == Counter(clearing=1)
    assert counts.crises == Counter(diversity=3, stagnation=1)
    assert counts.episodes == Counter(diversity=2, stagnation=1)
    assert counts.interventions == 1


def test_a_run_of_one_generation_has_no_decisions() -> None:
    """Nothing is counted where nothing was decided."""
    assert decisions([()]).total == 0
