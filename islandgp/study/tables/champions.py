"""Tables on individuals: behaviours (Table 13), best robots, and library trees as controls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from statistics import fmean

from islandgp.gp.archive import ArchiveSettings
from islandgp.scoring.constraints import in_words
from islandgp.statistics import mean_interval, mean_sd, rank_test
from islandgp.study.arms import Arm, Comparison
from islandgp.study.generalise import Control, Generalisation, best_of, champions_by_arm
from islandgp.study.measures import SPANS, individuals_with
from islandgp.study.table import NONE, Row, Table, labelled, number, p_is, signed_interval, spread
from islandgp.study.texts import note
from islandgp.text import title


def specialists_table(study: Comparison) -> Table:
    """Table 13: number of individuals with a behaviour, over all generations of all runs."""
    classes = study.classes
    labels = [name for name in classes.behaviours if name not in classes.specialists.of]
    rows: list[Row] = []
    for name in classes.behaviours:
        cells = [("Type", title(name))]
        for arm in study.arms:
            counts = [individuals_with(name, s, classes) for run in arm.runs for s in run.snapshots]
            cells.append((f"{arm.name} mean ± SD", spread(*mean_sd(counts), 1)))
            cells.append((f"{arm.name} range", f"{min(counts)}-{max(counts)}"))
        rows.append(cells)
    sizes = {str(run.flat.get("gp.population")) for arm in study.arms for run in arm.runs}
    text = f"{_list(classes.specialists.of)}: individuals of that exclusive class."
    if labels:
        text += f" {_list(labels)}: labels that any individual can carry."
    return Table.of(
        "table-13",
        f"Table 13. Specialists in a population of {' and '.join(sorted(sizes))}",
        rows,
        f"{text} SD over all generations of all runs.",
    )


def _list(names: Sequence[str]) -> str:
    return " and ".join(map(title, names))


def components_table(study: Comparison) -> Table:
    """The best robots' fitness by component, Eq. (1)."""
    champions = [[run.champion.record for run in arm.runs] for arm in study.arms]
    points = [
        (title(name), [[r.components[name] for r in records] for records in champions])
        for name in champions[0][0].components
    ]
    points.append(("Fitness", [[r.fitness for r in records] for records in champions]))
    rows = (
        labelled("Component", label, study.names, (spread(*mean_sd(values)) for values in by_arm))
        for label, by_arm in points
    )
    heading = "Fitness of the best robots by component (points)"
    return Table.of("components", heading, rows, note("components"))


def generalisation_table(results: Sequence[Generalisation], worlds: int) -> Table:
    """Best robots and reference trees in unseen worlds."""
    champions = champions_by_arm(results)
    reference_trees = [g for g in results if g.seed is None]
    rows = [
        [*_in_unseen_worlds(arm, of_arm), *_minus(of_arm, reference_trees)]
        for arm, of_arm in champions.items()
    ]
    rows += [
        [*_in_unseen_worlds(g.arm, [g]), *_minus([], reference_trees)] for g in reference_trees
    ]
    notes = [note("unseen", worlds=worlds)]
    if len(champions) < len(rows):
        notes.append(note("reference_trees"))
    replicated = [pair for pair in champions.items() if len(pair[1]) > 1]
    for (a, first), (b, second) in combinations(replicated, 2):
        t = rank_test([g.unseen for g in first], [g.unseen for g in second])
        notes.append(note("unseen-test", a=a, b=b, u=number(t.u, 1), p=p_is(t)))
    return Table.of("generalisation", f"Best robots in {worlds} unseen worlds", rows, *notes)


def _in_unseen_worlds(arm: str, results: Sequence[Generalisation]) -> Row:
    trained = [g.trained for g in results if g.trained is not None]
    yield "Trees", arm
    yield "number", str(len(results))
    yield "worlds", str(results[0].worlds)
    yield "trained (points)", spread(*mean_sd(trained)) if trained else NONE
    yield "unseen (points)", _mean([g.unseen for g in results])
    yield "worst world (points)", number(min(g.worst for g in results))
    if all(g.perturbed for g in results):
        yield "perturbed (points)", _mean([fmean(g.perturbed) for g in results])
        yield "worst perturbed (points)", number(min(min(g.perturbed) for g in results))
    for tier in results[0].reached:
        share = fmean(g.reached[tier] for g in results)
        yield f"{title(tier)} in", f"{share:.0%} of the worlds"


def _mean(points: Sequence[float]) -> str:
    """Mean ± standard deviation; a single number alone."""
    return spread(*mean_sd(points)) if len(points) > 1 else number(points[0])


def _minus(results: Sequence[Generalisation], reference_trees: Sequence[Generalisation]) -> Row:
    """Mean difference of the best robots to each reference tree, with its interval over runs."""
    for y in reference_trees:
        over = [g.minus(y).estimate for g in results]
        cell = signed_interval(mean_interval(over)) if over else NONE
        yield f"minus {y.arm} (points) [95 %]", cell


def controls_table(study: Comparison, trees: Sequence[Control]) -> Table:
    """Highest fitness of each arm, and of the library's trees."""
    seeds = sorted(trees[0].fitness)
    best = {seed: best_of(trees, seed) for seed in seeds}
    rows = [
        *(_highest(arm.name, _series(arm), _to_the_best(arm, best)) for arm in study.arms),
        _highest("best of the library, not evolved", [best[seed] for seed in seeds]),
    ]
    for control in trees:
        name = f"{'library' if control.injectable else 'reference tree'}: {control.name}"
        rows.append(_highest(name, [control.fitness[seed] for seed in seeds]))
    return Table.of("controls", "What evolution adds (points)", rows, note("controls"))


def _highest(name: str, series: Sequence[Sequence[float]], difference: str = NONE) -> Row:
    """The row of a tree or an arm, from the highest fitness of each generation of each run."""
    yield "Highest fitness of", name
    for span in SPANS:
        means = [fmean(v[g] for g in span.generations(len(v))) for v in series]
        yield span.label, spread(*mean_sd(means))
    yield "all generations", spread(*mean_sd(list(map(fmean, series))))
    yield "paired difference to the best of the library", difference


def _series(arm: Arm) -> list[list[float]]:
    return [[s.best for s in run.snapshots] for run in arm.runs]


def _to_the_best(arm: Arm, best: Mapping[int, Sequence[float]]) -> str:
    """The difference over all generations by seed; a dash if a run's worlds were not evaluated."""
    if any(run.seed not in best for run in arm.runs):
        return NONE
    pairs = zip(arm.runs, _series(arm), strict=True)
    return signed_interval(
        mean_interval([fmean(series) - fmean(best[run.seed]) for run, series in pairs])
    )


def constraints_table(study: Comparison) -> Table:
    """Feasibility of the best robots in validation worlds."""
    rows = map(_constraints, study.arms)
    return Table.of("constraints", "Constraints that the best robots keep", rows)


def _constraints(arm: Arm) -> Row:
    shares = [run.feasible for run in arm.runs if run.feasible is not None]
    limits = {in_words(run.constraints) or "none" for run in arm.runs}
    yield "Arm", arm.name
    yield "constraints", "; ".join(sorted(limits))
    yield "validated runs", str(len(shares))
    yield "worlds in which all are kept", f"{fmean(shares):.0%}" if shares else NONE
    yield "fewest of a run", f"{min(shares):.0%}" if shares else NONE


def one_grid(study: Comparison) -> bool:
    """True if the archives of all runs have the same grid and floor."""
    grids = []
    for run in (run for arm in study.arms for run in arm.runs):
        settings = ArchiveSettings.model_validate(run.config["archive"])
        grids.append((settings.axes(run.classes), settings.floor))
    return all(grid == grids[0] for grid in grids)


def archive_table(study: Comparison) -> Table:
    """Coverage and QD score after the last generation that all runs have, without tests."""
    rows = (_archive(arm, study.generations - 1) for arm in study.arms)
    title = "Archives of elites after the last generation"
    return Table.of("archive", title, rows, note("archive"))


def _archive(arm: Arm, generation: int) -> Row:
    archives = [run.archives[generation] for run in arm.runs]
    challenges = {str(run.flat.get("archive.reevaluations", 0)) for run in arm.runs}
    yield "Arm", arm.name
    yield "coverage, %", spread(*mean_sd([100 * a.coverage for a in archives]), 1)
    yield "QD score, points", spread(*mean_sd([a.qd_score for a in archives]))
    yield "episodes of a challenge", " and ".join(sorted(challenges))
