"""The tables of a report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from math import isnan
from statistics import fmean
from typing import TYPE_CHECKING, Any

from islandgp.compare.arms import Arm, in_short
from islandgp.compare.champions import TreeResult
from islandgp.compare.comparable import Comparison
from islandgp.compare.findings import Row, decisive, verdict
from islandgp.compare.library import library_names
from islandgp.compare.measures import OVERHEAD, advised, original, with_advised_ancestor
from islandgp.compare.runs import Run
from islandgp.compare.table import (
    DIGITS,
    NONE,
    Table,
    change,
    interval,
    note,
    number,
    percent,
    probability,
    spread,
)
from islandgp.gp.population import Origin
from islandgp.scoring.constraints import in_words
from islandgp.statistics import UNTESTED, Interval, mean_interval
from islandgp.supervision.decisions import decisions
from islandgp.text import title

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart


def arms_table(study: Comparison) -> Table:
    """Runs, seeds, settings and validation of each arm."""
    notes = [note("own-validation")] if len(study.tasks) > 1 else []
    return Table.of("arms", "Arms", (_arm(study, arm) for arm in study.arms), *notes)


def _arm(study: Comparison, arm: Arm) -> Mapping[str, str]:
    means = [run.validation_mean for run in arm.runs if run.validation_mean is not None]
    shares = [run.feasible for run in arm.runs if run.feasible is not None]
    several = len(study.tasks) > 1
    row = {
        "Arm": arm.name,
        "selection": arm.selection,
        "runs": str(len(arm.runs)),
        "seeds": in_short(sorted(set(arm.seeds))),
        "supervisor": ", ".join(sorted({run.supervisor for run in arm.runs})),
        "generations": str(arm.generations),
        "population": ", ".join(sorted({str(r.flat.get("gp.population")) for r in arm.runs})),
        "validation mean (points)": spread(means) + " (own task)" * (several and bool(means)),
    }
    if any(run.constraints for _, run in study.runs):
        row["constraints"] = "; ".join(
            sorted({in_words(r.constraints) or "none" for r in arm.runs})
        )
        row["kept in validation worlds"] = percent(fmean(shares)) if shares else NONE
    return row


def differences_table(rows: Sequence[Row], margins: Mapping[str, float], primary: str) -> Table:
    """The comparisons of a pair of arms: one estimand per row."""
    a, b = rows[0]["first"], rows[0]["second"]
    sizes = {row["family"]: row["family_size"] for row in rows}
    families = "; ".join(f"'{name}', {size} comparisons" for name, size in sizes.items())
    cells = (_difference(row, margins.get(row["measure"]), primary) for row in rows)
    notes = note("reading"), f"p BH: over the family {families}."
    return Table.of(f"differences {a} {b}", f"{a} minus {b}", cells, *notes)


def estimate(row: Row) -> str:
    """The difference with its interval; a dash if it is unknown."""
    if isnan(row["difference"]):
        return NONE
    if row["paired_kind"] == UNTESTED:
        return "0, equal in every pair"
    ends = Interval(*(row[f"difference{end}"] for end in ("", "_low", "_high")))
    return interval(ends, DIGITS[row["unit"]], "+")


def _difference(row: Row, margin: float | None, primary: str) -> Mapping[str, str]:
    digits = DIGITS[row["unit"]]
    p, q, test = decisive(row)
    share = change(row["mean_first"], row["mean_second"], row["sd_second"])
    cells = {"Measure": row["label"] + (" (primary)" if row["measure"] == primary else "")}
    for side in ("first", "second"):
        censored, n = row[f"censored_{side}"], row[f"n_{side}"]
        never = f"; never in {censored} of {n}" if censored else ""
        mean, sd = (number(row[f"{name}_{side}"], digits) for name in ("mean", "sd"))
        cells[row[side]] = f"{mean} ± {sd}{never}"
    return {
        **cells,
        "unit": row["unit"],
        "difference [95 %]": estimate(row),
        "in percent": percent(share, "+"),
        "P(first higher)": number(row["U"] / row["n_first"] / row["n_second"], 2),
        "test": test,
        "p": probability(p),
        "p BH": NONE if row["measure"] == primary else probability(q),
        "margin": NONE if margin is None else f"±{margin:,g}",
        "verdict": verdict(row, margin, planned=row["measure"] == primary),
    }


def effects_table(effects: DataFrame) -> Table:
    """Main effects and interactions of the factors."""
    rows = (
        {
            "Measure": row["measure"],
            "effect": row["effect"],
            "seeds": str(row["seeds"]),
            "difference [95 %]": interval(
                Interval(row["difference"], row["difference_low"], row["difference_high"]), 3, "+"
            ),
            "p": probability(row["p"]),
            "p BH": probability(row["p_bh"]),
        }
        for _, row in effects.iterrows()
    )
    return Table.of("effects", "Main effects and interactions", rows, note("effects"))


def unseen_table(study: Comparison, results: Sequence[TreeResult]) -> Table:
    """Best robots and library trees in unseen worlds; with several tasks, a cross table."""
    names = list(dict.fromkeys(r.arm for r in results))
    cross = len(study.tasks) > 1
    make: Callable[..., Mapping[str, str]] = _crossed if cross else _unseen
    rows = (make(study, name, [r for r in results if r.arm == name], results) for name in names)
    worlds = len(results[0].points)
    heading = f"Best robots in {worlds} unseen worlds" + ", under the task of each arm" * cross
    return Table.of("unseen", heading, rows, note("cross" if cross else "unseen"))


def _crossed(
    study: Comparison, name: str, of_arm: Sequence[TreeResult], results: Sequence[TreeResult]
) -> Mapping[str, str]:
    del results
    row = {"Trees": name, "number": str(len(of_arm) // len(study.tasks))}
    for task in study.tasks:
        points = [r.mean for r in of_arm if r.task == task.label]
        row[f"under {task.label} (points)"] = spread(points) + " *" * (name in task.arms)
    return row


def _unseen(
    study: Comparison, name: str, of_arm: Sequence[TreeResult], results: Sequence[TreeResult]
) -> Mapping[str, str]:
    from scipy.stats import trim_mean  # type: ignore[import-untyped] # scipy ships no types

    trained = [run.champion.record.fitness for arm, run in study.runs if arm.name == name]
    means = [r.mean for r in of_arm]
    row = {
        "Trees": name,
        "number": str(len(of_arm)),
        "unseen (points)": spread(means),
        "IQM": number(float(trim_mean(means, 0.25))),
        "worst world": number(min(min(r.points) for r in of_arm)),
        "trained (points)": spread(trained),
    }
    if of_arm[0].perturbed:
        row["perturbed (points)"] = spread([fmean(r.perturbed) for r in of_arm])
        row["worst perturbed"] = number(min(min(r.perturbed) for r in of_arm))
    for tier in of_arm[0].reached:
        row[f"{title(tier)} in"] = (
            percent(fmean(r.reached[tier] for r in of_arm)) + " of the worlds"
        )
    for tree in [r for r in results if r.run is None][:1]:
        apart = mean_interval([r.mean - tree.mean for r in of_arm])
        row[f"minus {tree.arm} [95 %]"] = interval(apart, 0, "+") if of_arm[0].run else NONE
    return row


def behaviours_table(study: Comparison) -> Table:
    """Table 13: number of individuals with a behaviour, over all generations of all runs."""
    classes = study.classes

    def counts(behaviour: str, run: Run) -> Sequence[float]:
        exclusive = behaviour in classes.specialists.of
        return [
            (s.specialists if exclusive else s.behaviour_counts)[behaviour] for s in run.snapshots
        ]

    values = {title(name): partial(counts, name) for name in classes.behaviours}
    rows = _by_arm(study, values, "Behaviour")
    heading = "Table 13. Individuals of a population with a behaviour"
    return Table.of("behaviours", heading, rows, note("behaviours"))


def components_table(study: Comparison) -> Table:
    """The best robots' fitness by component, Eq. (1)."""
    names = study.arms[0].runs[0].champion.record.components
    values: dict[str, Callable[[Run], Sequence[float]]] = {
        title(name): partial(_component, name) for name in names
    }
    values["Fitness"] = lambda run: [run.champion.record.fitness]
    notes = [note("components")] + [note("own-task")] * (not study.same_training)
    heading = "Fitness of the best robots by component (points)"
    return Table.of("components", heading, _by_arm(study, values, "Component", 0), *notes)


def costs_table(study: Comparison) -> Table:
    """Table 14, with a column per arm."""
    values = {
        label: partial(_known, of)
        for label, of in OVERHEAD.values()
        if any(of(run) for _, run in study.runs)
    }
    rows = _by_arm(study, values, "Cost of a run", 2)
    return Table.of("costs", "Table 14. Costs", rows, note("costs"))


def _component(name: str, run: Run) -> Sequence[float]:
    return [run.champion.record.components[name]]


def _known(of: Callable[[Run], float | None], run: Run) -> Sequence[float]:
    value = of(run)
    return [] if value is None else [value]


def _by_arm(
    study: Comparison,
    values: Mapping[str, Callable[[Run], Sequence[float]]],
    heading: str,
    digits: int = 1,
) -> Iterator[Mapping[str, str]]:
    """A row for each value with its mean and deviation in each arm."""
    for label, of in values.items():
        cells = {a.name: spread([x for r in a.runs for x in of(r)], digits) for a in study.arms}
        yield {heading: label, **cells}


def decisions_table(study: Comparison) -> Table:
    """Section 3.7: the shares of patterns, phases and targets, and the number of crises."""
    rows: dict[str, dict[str, str]] = {}
    for arm in study.arms:
        made = decisions(run.guidance for run in arm.runs)
        groups = {"Pattern": made.patterns, "Phase": made.phases, "Injected for": made.targets}
        cells = {"Decisions": number(made.total), "Interventions": number(made.interventions)}
        cells |= {f"Crises: {reason}": number(n) for reason, n in made.episodes.items()}
        cells |= {
            f"{group}: {name.replace('_', ' ')}": percent(count / made.total)
            for group, counts in groups.items()
            for name, count in counts.items()
        }
        for label, cell in cells.items():
            rows.setdefault(label, {"Decision": label})[arm.name] = cell
    ordered = (rows[label] for label in sorted(rows, key=lambda label: (":" in label, label)))
    heading = "Decisions of the supervisors, all runs together"
    return Table.of("decisions", heading, ordered, note("decisions"))


def origins_table(study: Comparison) -> Table:
    """The source of each run's best robot: drawn, bred, or advised by a supervisor."""
    counts = {arm.name: Counter(map(origin_of_best, arm.runs)) for arm in study.arms}
    sources = sorted({source for each in counts.values() for source in each})
    rows = (
        {"Source": source, **{arm: str(each[source]) for arm, each in counts.items()}}
        for source in sources
    )
    return Table.of("origins", "Origins of the best robots (runs)", rows, note("origins"))


def origin_of_best(run: Run) -> str:
    """The source of a run's best robot; an unchanged copy has that of the original.

    An injected tree has the name of its library file, or that of the supervisor that wrote it.
    """
    by_id: dict[str, Any] = {i.id: i for record in run.records for i in record.individuals}
    best = by_id.get(run.champion.record.id, run.champion.record)
    i = original(best, by_id)
    if i.origin == Origin.INJECTED and advised(i):
        generation = int(i.id.partition(".")[0])
        guidance = run.records[generation - 1].guidance if generation else None
        names = library_names(run.config)
        if guidance is None or guidance.tree is None:
            return f"injected, unchanged: {names.get(i.tree, 'no supervisor')}"
        return f"injected, unchanged: {names.get(guidance.tree, guidance.source)}"
    if i.origin == Origin.EDITED and advised(i):
        return "edited by the supervisor"
    if i.id in with_advised_ancestor(run):
        return "bred, with an advised ancestor"
    return "a random tree" if i.origin == Origin.RANDOM and not i.mutation else "bred"
