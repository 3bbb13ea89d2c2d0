"""Individuals: how many show a behaviour (Table 13), the champions, and trees without evolution."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean

from islandgp.evolution.validation import interval as mean_and_ends
from islandgp.study.arms import Arm, Comparison
from islandgp.study.generalise import Control, Generalisation, best_of
from islandgp.study.measures import SPANS, shown
from islandgp.study.paper import Paper
from islandgp.study.statistics import mean_interval, mean_sd, rank_test
from islandgp.study.table import NONE, Table, interval, number, p_is, signed, spread
from islandgp.study.tables.comparisons import footnotes, published
from islandgp.supervision.state_json import title


def specialists_table(study: Comparison) -> Table:
    """Table 13: how many individuals show a behaviour, over all generations of all runs."""
    classes = study.classes
    labels = [name for name in classes.behaviours if name not in classes.specialists.of]
    rows = []
    for name in classes.behaviours:
        cells = [title(name)]
        for arm in study.arms:
            counts = [shown(name, s, classes) for run in arm.runs for s in run.snapshots]
            cells += [spread(*mean_sd(counts), 1), f"{min(counts)}-{max(counts)}"]
        rows.append((*cells, *_published_count(study.paper, name)))
    columns = [f"{arm.name}{what}" for arm in study.arms for what in (" mean ± SD", " range")]
    sizes = " and ".join(
        sorted({str(run.flat.get("gp.population")) for arm in study.arms for run in arm.runs})
    )
    note = f"{_list(classes.specialists.of)}: individuals of that exclusive class."
    if labels:
        note += f" {_list(labels)}: labels that any individual can carry."
    return Table(
        "table-13",
        f"Table 13. Specialists in a population of {sizes}",
        ("Type", *columns, *published(study.paper, ("mean ± SD", "range"))),
        tuple(rows),
        (f"{note} SD over all generations of all runs.", *footnotes(study.paper)),
    )


def _published_count(paper: Paper | None, behaviour: str) -> tuple[str, ...]:
    if paper is None:
        return ()
    if (row := paper.specialists.get(behaviour)) is None:
        return NONE, NONE
    return spread(row.mean, row.sd, 1), f"{row.least}-{row.most}"


def _list(names: Sequence[str]) -> str:
    return " and ".join(map(title, names))


def components_table(study: Comparison) -> Table:
    """Where the champions' fitness comes from, Eq. (1)."""
    champions = [[run.champion.record for run in arm.runs] for arm in study.arms]
    rows = [
        (title(name), *(spread(*mean_sd([r.components[name] for r in mine])) for mine in champions))
        for name in champions[0][0].components
    ]
    total = [spread(*mean_sd([r.fitness for r in mine])) for mine in champions]
    return Table(
        "components",
        "Fitness of the champions by component (points)",
        ("Component", *(arm.name for arm in study.arms)),
        (*rows, ("Fitness", *total)),
        ("A run's champion is its best robot, by its fitness in training; ± is over runs.",),
    )


def generalisation_table(found: Sequence[Generalisation], worlds: int) -> Table:
    """Champions on unseen worlds, with trees from elsewhere as yardsticks."""
    arms = list(dict.fromkeys(g.arm for g in found if g.seed is not None))
    champions = {a: [g for g in found if g.arm == a and g.seed is not None] for a in arms}
    yardsticks = [g for g in found if g.seed is None]
    rows = [
        (*_generalisation_row(arm, mine), *(_over_runs(mine, y) for y in yardsticks))
        for arm, mine in champions.items()
    ]
    rows += [(*_generalisation_row(g.arm, [g]), *(NONE for _ in yardsticks)) for g in yardsticks]
    notes = [
        f"Each run's champion in the same {worlds} worlds that no run used, in the last stage of"
        " the curriculum. 'Trained' is its fitness in the generation in which it lived. A run"
        " chooses its champion in validation worlds of its own. ± is over runs.",
    ]
    if len(champions) < len(rows):
        notes.append(
            "The yardsticks are trees of the library, by file name: those that library.yardsticks"
            " names, and the one that the supervisors injected most often. They meet the"
            " champions' worlds, and more of them where those are few. 'Minus' such a tree: mean"
            " over runs of the champions' mean paired differences in the worlds that both met,"
            " with Student's t interval over runs; champions.csv has them run by run, each with"
            " its interval over worlds."
        )
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
            "trained (points)",
            "unseen (points)",
            "worst world (points)",
            *(f"{title(tier)} in" for tier in found[0].reached),
            *(f"minus {y.arm} (points) [95 %]" for y in yardsticks),
        ),
        tuple(rows),
        tuple(notes),
    )


def _over_runs(mine: Sequence[Generalisation], yardstick: Generalisation) -> str:
    """Mean difference of the champions to a yardstick, with its interval over runs."""
    over = mean_interval([g.minus(yardstick).estimate for g in mine])
    return interval(over).replace(number(over.estimate), signed(over.estimate), 1)


def _generalisation_row(arm: str, mine: Sequence[Generalisation]) -> tuple[str, ...]:
    trained = [g.trained for g in mine if g.trained is not None]
    return (
        arm,
        str(len(mine)),
        str(mine[0].worlds),
        spread(*mean_sd(trained)) if trained else NONE,
        spread(*mean_sd([g.unseen for g in mine])) if len(mine) > 1 else number(mine[0].unseen),
        number(min(g.worst for g in mine)),
        *(f"{fmean(g.reached[tier] for g in mine):.0%} of the worlds" for tier in mine[0].reached),
    )


HEADINGS = ("Early", "Mid", "Late", "all generations")


def controls_table(study: Comparison, found: Sequence[Control]) -> Table:
    """Highest fitness of each arm, and of the library's trees, which are not evolved."""
    seeds = sorted(found[0].fitness)
    best = {seed: best_of(found, seed) for seed in seeds}
    rows = [_control_arm(arm, best) for arm in study.arms]
    rows.append(_control_row("best of the library, not evolved", [best[seed] for seed in seeds]))
    for control in found:
        what = "library" if control.given else "yardstick"
        rows.append(
            _control_row(f"{what}: {control.name}", [control.fitness[seed] for seed in seeds])
        )
    return Table(
        "controls",
        "What evolution adds (points)",
        ("Highest fitness of", *HEADINGS, "paired difference to the best of the library"),
        tuple(rows),
        (
            "Means over runs ± SD of the highest fitness of a generation. A tree that is not"
            " evolved has one episode in each generation's world, under its stage's multipliers."
            " The best of the library is the highest of its trees for targets in each generation."
            " The differences are of all generations' means, seed by seed, with their 95 %"
            " interval (Student's t).",
        ),
    )


def _control_arm(arm: Arm, best: dict[int, tuple[float, ...]]) -> tuple[str, ...]:
    runs = [run for run in arm.runs if run.seed in best]
    series = [[s.best for s in run.snapshots] for run in runs]
    if not runs or len(runs) < len(arm.runs):
        return _control_row(arm.name, series or [[]])
    pairs = [fmean(mine) - fmean(best[run.seed]) for run, mine in zip(runs, series, strict=True)]
    mean, low, high = mean_and_ends(pairs)
    return (*_control_row(arm.name, series)[:-1], f"{signed(mean)} [{number(low)}, {number(high)}]")


def _control_row(name: str, series: Sequence[Sequence[float]]) -> tuple[str, ...]:
    """A tree or an arm, by the highest fitness of each generation of each run."""
    whole = [values for values in series if values]
    spans = [[fmean(v[g] for g in span.generations(len(v))) for v in whole] for span in SPANS]
    means = [*spans, [fmean(values) for values in whole]]
    return (name, *(spread(*mean_sd(m)) if m else NONE for m in means), NONE)
