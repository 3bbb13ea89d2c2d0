"""The tables of a report: frames of texts, and the formats of numbers in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isnan
from typing import TYPE_CHECKING, Final

import numpy as np

from islandgp.compare.arms import Arm, in_short
from islandgp.compare.comparable import Comparison
from islandgp.compare.findings import Row, decisive, verdict
from islandgp.compare.measures import COSTS
from islandgp.scoring.constraints import in_words, recorded_constraints
from islandgp.statistics import UNTESTED, Interval, mean_interval, mean_sd
from islandgp.text import title

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart


MINUS: Final = "\N{MINUS SIGN}"
NONE: Final = "\N{EN DASH}"
DIGITS: Final = {"points": 0, "generations without one": 1, "Eq. (3)": 3, "rate": 3, "count": 1}
"""Number of decimals by unit."""


def number(x: float, digits: int = 0, sign: str = "") -> str:
    """A number as 12,345 or 12,345.6; a dash for nan."""
    if isnan(x):
        return NONE
    text = f"{x:{sign},.{digits}f}"
    if not text.strip("+-0.,"):
        text = text.lstrip("+-")  # no "-0"
    return text.replace("-", MINUS)


def spread(values: Iterable[float], digits: int = 0) -> str:
    """Mean ± standard deviation of the known values; the mean alone of one, a dash of none."""
    known = [x for x in np.asarray([*values], float).tolist() if not isnan(x)]
    if not known:
        return NONE
    mean, sd = mean_sd(known)
    return number(mean, digits) + ("" if isnan(sd) else f" ± {number(sd, digits)}")


def interval(i: Interval, digits: int = 0, sign: str = "") -> str:
    """An estimate with its interval; a dash for unknown values."""
    if isnan(i.estimate):
        return NONE
    ends = NONE if isnan(i.low) else f"{number(i.low, digits)}, {number(i.high, digits)}"
    return f"{number(i.estimate, digits, sign)} [{ends}]"


def percent(share: float) -> str:
    """A share in percent; a dash for nan."""
    if isnan(share):
        return NONE
    return f"{share:.1%}".replace("%", " %")


def probability(p: float) -> str:
    """A p-value with three decimals, or more for a small one; a dash for nan."""
    if isnan(p):
        return NONE
    if p < 1e-4:
        return "< 0.0001"
    return f"{p:.3f}" if p >= 0.0095 else f"{p:.4f}"


def arms_table(study: Comparison) -> DataFrame:
    """Runs, seeds, settings and validation of each arm."""
    from pandas import DataFrame

    return DataFrame([_arm(study, arm) for arm in study.arms]).dropna(axis="columns")


def _arm(study: Comparison, arm: Arm) -> Mapping[str, str | None]:
    runs = study.of_arm(arm.name)
    limits = {in_words(recorded_constraints(run.config)) or "none" for run in arm.runs}
    own = len(study.tasks) > 1 and runs["validation_mean"].notna().any()
    kept = "constraints.feasible" in study.runs
    return {
        "Arm": arm.name,
        "selection": arm.selection,
        "runs": str(len(arm.runs)),
        "seeds": in_short(sorted(set(arm.seeds))),
        "supervisor": ", ".join(sorted(set(runs["supervisor"]))),
        "generations": in_short(sorted(set(runs["generations"]))),
        "population": ", ".join(sorted({str(run.flat["gp.population"]) for run in arm.runs})),
        "validation mean (points)": spread(runs["validation_mean"]) + " (own task)" * bool(own),
        "constraints": "; ".join(sorted(limits)) if kept else None,
        "kept in validation worlds": (
            percent(runs["constraints.feasible"].mean()) if kept else None
        ),
    }


def differences_table(rows: DataFrame, primary: str | None) -> DataFrame:
    """The comparisons of a pair of arms: one estimand per row."""
    from pandas import DataFrame

    return DataFrame(
        [_difference(row, row["measure"] == primary) for row in rows.to_dict("records")]
    )


def estimate(row: Row) -> str:
    """The difference with its interval; a dash if it is unknown."""
    if row["paired_kind"] == UNTESTED and not isnan(row["difference"]):
        return "0, equal in every pair"
    ends = Interval(*(row[f"difference{end}"] for end in ("", "_low", "_high")))
    return interval(ends, DIGITS[row["unit"]], "+")


def _difference(row: Row, planned: bool) -> Mapping[str, str]:
    digits = DIGITS[row["unit"]]
    p, q, test = decisive(row)
    cells = {"Measure": row["label"] + " (primary)" * planned}
    for side in ("first", "second"):
        censored, n = row[f"censored_{side}"], row[f"n_{side}"]
        never = f"; never in {censored} of {n}" if censored else ""
        mean, sd = (number(row[f"{name}_{side}"], digits) for name in ("mean", "sd"))
        cells[row[side]] = f"{mean} ± {sd}{never}"
    return {
        **cells,
        "unit": row["unit"],
        "difference [95 %]": estimate(row),
        "P(first higher)": number(row["U"] / row["n_first"] / row["n_second"], 2),
        "test": test,
        "p": probability(p),
        "p BH": NONE if planned else probability(q),
        "verdict": verdict(row, planned=planned),
    }


def effects_table(effects: DataFrame) -> DataFrame:
    """Main effects and interactions of the factors."""
    ends = effects[["difference", "difference_low", "difference_high"]].itertuples(index=False)
    return effects[["measure", "effect", "seeds"]].assign(
        **{
            "difference [95 %]": [interval(Interval(*each), 3, "+") for each in ends],
            "p": effects["p"].map(probability),
            "p BH": effects["p_bh"].map(probability),
        }
    )


def unseen_table(study: Comparison, tested: DataFrame) -> DataFrame:
    """Best robots and library trees in unseen worlds; with several tasks, a cross table."""
    by_arm = tested.groupby("arm", sort=False)
    if len(study.tasks) > 1:
        table = (by_arm.size() // len(study.tasks)).astype(str).to_frame("number")
        for task in study.tasks:
            points = tested[tested["task"] == task.label].groupby("arm", sort=False)["points"]
            cells = {arm: spread(v) + " *" * (arm in task.arms) for arm, v in points}
            table[f"under {task.label} (points)"] = table.index.map(cells)
        return table.reset_index(names="Trees")
    from scipy.stats import trim_mean  # type: ignore[import-untyped] # scipy ships no types

    trained = {arm: spread(v) for arm, v in study.runs.groupby("arm")["champion_fitness"]}
    table = by_arm.size().astype(str).to_frame("number")
    table["unseen (points)"] = by_arm["points"].agg(spread)
    table["IQM"] = by_arm["points"].agg(lambda v: number(float(trim_mean(v, 0.25))))
    table["worst world"] = by_arm["worst"].min().map(number)
    table["trained (points)"] = [trained.get(arm, NONE) for arm in table.index]
    if "perturbed" in tested:
        table["perturbed (points)"] = by_arm["perturbed"].agg(spread)
        table["worst perturbed"] = by_arm["perturbed_worst"].min().map(number)
    for tier in study.classes.milestones:
        share = by_arm[f"reached.{tier}"].mean().map(percent)
        table[f"{title(tier)} in"] = share + " of the worlds"
    for _, tree in tested[tested["run"].isna()].head(1).iterrows():
        robots = tested[tested["run"].notna()].groupby("arm")["points"]
        apart = {a: interval(mean_interval([*(v - tree["points"])]), 0, "+") for a, v in robots}
        table[f"minus {tree['arm']} [95 %]"] = [apart.get(arm, NONE) for arm in table.index]
    return table.reset_index(names="Trees")


def behaviours_table(study: Comparison) -> DataFrame:
    """Table 13: number of individuals with a behaviour, over all generations of all runs."""
    classes = study.classes
    columns = {
        f"{'specialists' if name in classes.specialists.of else 'behaviour_counts'}.{name}": title(
            name
        )
        for name in classes.behaviours
    }
    return _by_arm(study, study.generations, columns, "Behaviour")


def components_table(study: Comparison) -> DataFrame:
    """The best robots' fitness by component, Eq. (1)."""
    names = [name for name in study.runs if name.startswith("components.")]
    columns = {name: title(name.removeprefix("components.")) for name in names}
    columns["champion_fitness"] = "Fitness"
    return _by_arm(study, study.runs, columns, "Component", 0)


def costs_table(study: Comparison) -> DataFrame:
    """Table 14, with a column per arm."""
    columns = {k: v for k, v in COSTS.items() if k in study.runs and study.runs[k].any()}
    return _by_arm(study, study.runs, columns, "Cost of a run", 2)


def _by_arm(
    study: Comparison, frame: DataFrame, columns: Mapping[str, str], heading: str, digits: int = 1
) -> DataFrame:
    """A row for each column of a frame with its mean and deviation in each arm."""
    from pandas import DataFrame

    values = {arm: frame[frame["arm"] == arm] for arm in study.names}
    cells = {arm: [spread(v[name], digits) for name in columns] for arm, v in values.items()}
    return DataFrame({heading: [*columns.values()], **cells})


def origins_table(study: Comparison) -> DataFrame:
    """The source of each run's best robot, by arm: drawn, bred, or advised by a supervisor."""
    counts = study.runs.groupby(["origin", "arm"]).size().unstack(fill_value=0)
    return counts[[*study.names]].astype(str).reset_index(names="Source")
