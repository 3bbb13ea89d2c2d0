"""The champions: fitness by component, and fitness on unseen worlds."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from islandgp.scoring.rewards import Component
from islandgp.study.arms import Comparison
from islandgp.study.generalise import Generalisation
from islandgp.study.notation import NONE, number, p_is, spread
from islandgp.study.statistics import mean_sd, rank_test
from islandgp.study.table import Table


def components_table(study: Comparison) -> Table:
    """Where the champions' fitness comes from, Eq. (1)."""
    rows = [
        (
            component.name.capitalize(),
            *(
                spread(*mean_sd([r.champion.record.components[component] for r in arm.runs]))
                for arm in study.arms
            ),
        )
        for component in Component
    ]
    total = [spread(*mean_sd([r.champion.record.fitness for r in a.runs])) for a in study.arms]
    return Table(
        "components",
        "Fitness of the champions by component (points)",
        ("Component", *(arm.name for arm in study.arms)),
        (*rows, ("Fitness", *total)),
        ("A run's champion is the individual with its highest fitness ever; ± is over runs.",),
    )


def generalisation_table(found: Sequence[Generalisation], worlds: int) -> Table:
    """Champions on unseen worlds, with trees from elsewhere as yardsticks."""
    arms = list(dict.fromkeys(g.arm for g in found if g.seed is not None))
    champions = {a: [g for g in found if g.arm == a and g.seed is not None] for a in arms}
    rows = [_generalisation_row(arm, mine) for arm, mine in champions.items()]
    rows += [_generalisation_row(g.arm, [g]) for g in found if g.seed is None]
    notes = [
        f"Each run's champion in the same {worlds} worlds that no run used, in the last stage of"
        " the curriculum. 'Trained' is the fitness that made it champion, in one world and perhaps"
        " under an earlier stage's multipliers. ± is over runs.",
        "The yardsticks are trees of grammar/examples, by file name: all_rounder, written by hand"
        " to be good at everything, and the one that the supervisors injected most often. They"
        " meet the champions' worlds, and more of them where those are few.",
    ]
    samples = [(arm, [g.unseen for g in mine]) for arm, mine in champions.items()]
    real = [(arm, values) for arm, values in samples if len(values) > 1]
    for i, (a, x) in enumerate(real):
        for b, y in real[i + 1 :]:
            t = rank_test(x, y)
            notes.append(
                f"Unseen fitness, {a} against {b}: U = {number(t.u, 1)}, {p_is(t)}, not"
                " adjusted: it belongs to no family."
            )
    return Table(
        "generalisation",
        f"Champions on {worlds} unseen worlds",
        (
            "Trees",
            "number",
            "worlds",
            "trained",
            "unseen",
            "worst world",
            "Complete in",
            "Excellent in",
        ),
        tuple(rows),
        tuple(notes),
    )


def _generalisation_row(arm: str, mine: Sequence[Generalisation]) -> tuple[str, ...]:
    trained = [g.trained for g in mine if g.trained is not None]
    return (
        arm,
        str(len(mine)),
        str(mine[0].worlds),
        spread(*mean_sd(trained)) if trained else NONE,
        spread(*mean_sd([g.unseen for g in mine])) if len(mine) > 1 else number(mine[0].unseen),
        number(min(g.worst for g in mine)),
        f"{fmean(g.complete for g in mine):.0%} of the worlds",
        f"{fmean(g.excellent for g in mine):.0%} of the worlds",
    )
