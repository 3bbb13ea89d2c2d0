"""Section 3.7: how often each pattern, phase, target and crisis came."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from islandgp.study import paper
from islandgp.study.arms import Comparison
from islandgp.study.notation import NONE, number, percent
from islandgp.study.paper import MARK
from islandgp.study.table import Table
from islandgp.supervision.decisions import decisions


def decisions_table(study: Comparison) -> Table:
    """Section 3.7: how often each pattern, phase, target and crisis came."""
    each = [decisions(run.guidance for run in arm.runs) for arm in study.arms]
    totals = [d.total for d in each]
    rows: list[tuple[str, ...]] = [("Decisions", *map(number, totals), NONE)]
    for title, kinds in (
        ("Pattern", [d.patterns for d in each]),
        ("Phase", [d.phases for d in each]),
        ("Injected for", [d.targets for d in each]),
    ):
        names = sorted({name for kind in kinds for name in kind})
        rows += [
            (f"{title}: {_words(name)}", *_shares(name, kinds, totals), _theirs(name))
            for name in names
        ]
    rows += [
        (
            f"Crises: {reason}",
            *(f"{d.episodes[reason]} ({d.crises[reason]} generations)" for d in each),
            f"{paper.DECISIONS['crises']}" if reason == "diversity" else NONE,
        )
        for reason in ("diversity", "stagnation")
    ]
    rows.append(("Interventions", *(number(d.interventions) for d in each), NONE))
    return Table(
        "decisions",
        "Supervision decisions, all runs together",
        ("Decision", *(arm.name for arm in study.arms), MARK),
        tuple(rows),
        (
            "Shares are of all decisions of the arm. A crisis (Eq. 7) overrides the rate; one that"
            " lasts several generations counts once. An intervention is a decision in which the"
            " supervisor itself says that it has to step in (the expert in the phases crisis"
            " intervention and aggressive exploration); it is no crisis of the run's.",
            "The paper counts exploration-oriented decisions (26.3 %) and exploitation-oriented"
            " ones (16.2 %) without saying which labels those are; they stand beside the labels of"
            " those names.",
            paper.NOTE,
        ),
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _theirs(name: str) -> str:
    known = {"exploration_phase": "exploration", "exploitation": "exploitation"}
    return percent(paper.DECISIONS[known[name]]).lstrip("+") if name in known else NONE


def _shares(name: str, kinds: Sequence[Counter[str]], totals: Sequence[int]) -> list[str]:
    """Of all decisions, those without a label included; a dash where an arm names none at all."""
    return [
        percent(kind[name] / total).lstrip("+") if kind else NONE
        for kind, total in zip(kinds, totals, strict=True)
    ]
