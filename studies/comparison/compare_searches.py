"""All searches at equal episodes in five worlds: `make comparators`; the plan is in studies/log.md.

    python -m studies.comparison.compare_searches [--seeds N] [--worlds A,B] [--arms "A;B"]
    python -m studies.comparison.compare_searches --report
    python -m studies.comparison.compare_searches --random-trees [--worlds A,B]

Does the missing runs in `runs/`, evaluates each run's best robot in unseen worlds, and writes
results/: raw scores, tables, profiles, curves. It can be stopped and started again at any
time: unfinished runs are resumed, and scores in scores/WORLD.json are kept. Several processes can
run at the same time, each for other worlds.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from time import process_time
from typing import Any, Final

import numpy as np

import islandgp
from islandgp.scoring.classes import tiers
from islandgp.statistics import (
    Interval,
    benjamini_hochberg,
    mean_interval,
    paired_difference,
    paired_test,
)
from studies.comparison.profile_figure import profile_picture
from studies.comparison.profiles import Scores, summarise
from studies.comparison.score_table import score_table, scores_csv

HERE: Final = Path(__file__).resolve().parent
ROOT: Final = HERE.parent.parent
FOLDER: Final = HERE / "results"
SEEDS: Final = range(9600, 9620)  # of runs; nothing was tuned on them
UNSEEN: Final = range(200_000, 200_100)  # of worlds
RANDOM: Final = 400  # random trees of each kind
UNSEEN_OF_RANDOM: Final = range(300_000, 300_000 + RANDOM)  # a world for each of them
REFERENCE: Final = "random"
BY_HAND: Final = "by hand"
FEWEST: Final = 10  # seeds of an arm that is compared
POINTS: Final = 8  # of a curve
CURVE_WORLDS: Final = UNSEEN[:20]  # in which a point's tree is evaluated
CURVES: Final = ("racing", "racing, library", "decision_list", "paper", "random")
"""Arms with a curve, five at most."""

QUIET: Final = ("tracking=off", "progress=off", "evaluator=serial")

OTHER_SEARCHES: Final = ("hill", "lexicase", "map_elites", "novelty", "nsga2")
ARMS: Final[dict[str, tuple[str, ...]]] = {
    "racing": ("search=racing", "supervisor=baseline", "search.policy.library=0"),
    **{
        name: (f"search={name}", "supervisor=baseline")
        for name in ("paper", *OTHER_SEARCHES, "random", "random_paper")
    },
    "decision_list": ("search=decision_list", "supervisor=baseline", "gp.population=12"),
    "paper, expert": ("search=paper", "supervisor=expert"),
    "racing, library": ("search=racing", "supervisor=baseline"),
    "racing, expert": ("search=racing", "supervisor=expert"),
    "paper, editor": ("search=paper", "supervisor=editor"),
    "racing, editor": ("search=racing", "supervisor=editor"),
    "compose": ("search=compose", "supervisor=baseline"),
    "paper, last stage": ("search=paper", "supervisor=baseline", "++curriculum.last_only=true"),
    "racing, paper's operators": (
        *("search=racing", "search/breeding=paper"),
        *("supervisor=baseline", "search.policy.library=0"),
    ),
}
CONTROLS: Final = ("paper, last stage", "racing, paper's operators")
"""Arms that run only on the island."""

PAIRS: Final = (
    *(
        ("racing", other)
        for other in ("random", "random_paper", "paper", *OTHER_SEARCHES, *CONTROLS)
    ),
    ("decision_list", "racing"),
    ("racing, expert", "compose"),
    ("racing, expert", "racing, library"),
    ("racing, library", "compose"),
    ("racing, expert", "racing"),
    ("paper, expert", "paper"),
    ("paper, editor", "paper"),
    ("racing, editor", "racing, library"),
)
"""Pairs of arms in the second table, which also compares each arm with the hand-written tree."""

WITH_LIBRARY: Final = (
    *("paper, expert", "paper, editor", "compose"),
    *("racing, library", "racing, expert", "racing, editor"),
)
"""Arms that use the trees of a library; only for domains with one."""


@dataclass(frozen=True, slots=True)
class World:
    """A domain with its budget."""

    overrides: tuple[str, ...]
    by_hand: Path  # a tree for comparison
    config_dir: Path | None = None
    library: bool = False
    numeric: bool = False  # True: its keys are numbers
    arms: tuple[str, ...] = ()  # that run in this world; (): all
    seeds: range = SEEDS


ALL_ROUNDER: Final = ROOT / "grammar" / "examples" / "all_rounder.bt"
DOMAINS: Final = ROOT / "islandgp" / "domains"
PICK_PLACE: Final = ROOT / "examples" / "pick_place"
MINIGRID: Final = ROOT / "examples" / "minigrid"
WORLDS: Final[dict[str, World]] = {
    "island": World(("domain=island", "budget.episodes=1414"), ALL_ROUNDER, library=True),
    "cartpole": World(
        ("domain=cartpole", "budget.episodes=3000"),
        DOMAINS / "gymnasium" / "trees" / "cartpole.bt",
        numeric=True,
    ),
    "pick_place": World(
        ("domain=pick_place", "budget.episodes=3000"), PICK_PLACE / "carry.bt", PICK_PLACE / "conf"
    ),
    "lunarlander": World(
        ("domain=lunarlander", "budget.episodes=12000", "gp.population=60", "gp.episodes=4"),
        DOMAINS / "gymnasium" / "trees" / "lunarlander.bt",
        numeric=True,
        arms=("decision_list", "racing", "random", "paper"),
        seeds=range(9720, 9740),
    ),
    "swimmer": World(
        ("domain=swimmer", "budget.episodes=400"),
        DOMAINS / "gymnasium" / "trees" / "swimmer.bt",
        numeric=True,
    ),
    "minigrid": World(
        ("domain=minigrid", "budget.episodes=10000", "gp.population=60", "gp.episodes=2"),
        *(MINIGRID / "by_hand.bt", MINIGRID / "conf"),
    ),
    "island_default": World(
        *(("domain=island",), ALL_ROUNDER),
        library=True,
        arms=("racing, expert", "compose"),
        seeds=range(9700, 9720),
    ),
    "island_4000": World(("domain=island", "budget.episodes=4000"), ALL_ROUNDER, arms=("racing",)),
    "island_best": World(
        ("experiment=best",), ALL_ROUNDER, arms=("racing",), seeds=range(9660, 9670)
    ),
}


def arms_of(world: World) -> Iterator[str]:
    """The arms that can run in a world."""
    for arm in world.arms or ARMS:
        if not world.library and arm in (*WITH_LIBRARY, *CONTROLS):
            continue
        if world.numeric or arm != "decision_list":
            yield arm


def measured(name: str, arm: str, seed: int) -> dict[str, Any]:
    """Does a run if it is missing, and evaluates its best robot in the unseen worlds."""
    world, began = WORLDS[name], process_time()
    overrides = (*world.overrides, *ARMS[arm], f"name=comparators-{name}", f"seed={seed}", *QUIET)
    results = islandgp.run(*overrides, config_dir=world.config_dir)
    (row,) = results.runs.to_dict("records")
    experiment = islandgp.compose(*overrides, config_dir=world.config_dir)
    outcomes = experiment.evaluate(str(row["tree"]), UNSEEN)
    counters = {key: fmean(o.counters[key] for o in outcomes) for key in outcomes[0].counters}
    classes = experiment.plan.classes
    reached = [tiers(o, classes) for o in outcomes]
    curve = curve_of(results.path / str(row["run"]), experiment) if arm in CURVES else None
    return {
        "score": fmean(o.fitness for o in outcomes),
        "counters": counters,
        "tiers": {tier: fmean(tier in found for found in reached) for tier in classes.tiers},
        **({"curve": curve} if curve else {}),
        "tree": row["tree"],
        "seconds": row["seconds"],
        "main_process_cpu_s": round(process_time() - began, 3),
    }


def curve_of(folder: Path, experiment: islandgp.Experiment) -> list[tuple[int, float]]:
    """Episodes so far, and the mean in unseen worlds of the fittest tree so far, POINTS at most.

    The fittest is that of the highest fitness in training, of the present stage, as rewards differ
    between stages. The first point is generation 0, in all UNSEEN worlds.
    """
    records = islandgp.load(folder)
    generations, individuals = records.generations, records.individuals
    fittest = individuals.loc[individuals.groupby("generation")["fitness"].idxmax()]
    best = fittest.merge(generations[["generation", "stage"]], on="generation")
    points = list(zip(generations["generation"], generations["episodes"].cumsum(), strict=True))
    curve = []
    for i in sorted({*np.linspace(0, len(points) - 1, POINTS).round().astype(int)}):
        generation, episodes = points[i]
        so_far = best[best["generation"] <= generation]
        so_far = so_far[so_far["stage"] == so_far["stage"].iloc[-1]]
        tree = so_far.loc[so_far["fitness"].idxmax(), "tree"]
        outcomes = experiment.evaluate(str(tree), CURVE_WORLDS if i else UNSEEN)
        curve.append((int(episodes), round(fmean(o.fitness for o in outcomes), 3)))
    return curve


def by_hand(name: str) -> float:
    """The mean of the hand-written tree in the unseen worlds."""
    world = WORLDS[name]
    experiment = islandgp.compose(*world.overrides, *QUIET, config_dir=world.config_dir)
    text = world.by_hand.read_text(encoding="utf-8")
    return fmean(o.fitness for o in experiment.evaluate(text, UNSEEN))


def raw_file(name: str) -> Path:
    """The file of a world's raw scores."""
    return FOLDER / "scores" / f"{name}.json"


def read_raw(name: str) -> dict[str, Any]:
    """A world's raw scores: `by_hand`, and by arm and seed."""
    if not raw_file(name).exists():
        return {"by_hand": None, "arms": {}}
    raw: dict[str, Any] = json.loads(raw_file(name).read_text(encoding="utf-8"))
    return raw


def write_raw(name: str, raw: dict[str, Any]) -> None:
    """Writes a world's raw scores atomically."""
    file = raw_file(name)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(json.dumps(raw, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    part.replace(file)


def seeds_of(raw: dict[str, Any], arms: Iterable[str]) -> dict[str, list[str]]:
    """The arms of a world with the most seeds, and the seeds that all of these have.

    These are arms with FEWEST seeds and two thirds of the most.
    """
    measured_arms = {arm: {*raw["arms"].get(arm, ())} for arm in arms}
    least = max(FEWEST, max(map(len, measured_arms.values())) * 2 / 3)
    seeds_by_arm = {arm: seeds for arm, seeds in measured_arms.items() if len(seeds) >= least}
    common = sorted(set.intersection(*seeds_by_arm.values())) if seeds_by_arm else []
    return dict.fromkeys(seeds_by_arm, common)


def report() -> None:
    """The tables, the profiles and the curves."""
    raws = {name: read_raw(name) for name in WORLDS}
    scores: dict[str, dict[str, list[float]]] = {}
    means = []  # of arms with fewer seeds
    for name, world in WORLDS.items():
        arms = raws[name]["arms"]
        compared = seeds_of(raws[name], arms_of(world))
        if compared:
            scores[name] = {
                arm: [arms[arm][seed]["score"] for seed in seeds] for arm, seeds in compared.items()
            }
        means += [
            f"- {name}, {arm}: {fmean(run['score'] for run in arms[arm].values()):,.1f}"
            f" ({len(arms[arm])} seeds)"
            for arm in arms_of(world)
            if arms.get(arm) and arm not in compared
        ]
    by_world: Scores = scores
    rows = summarise(by_world, reference=REFERENCE, paired=True)
    table = score_table(rows, title="Best robots in unseen worlds, by search")
    lines = [
        "| " + " | ".join(table.frame.columns) + " |",
        "|---" * len(table.frame.columns) + "|",
        *("| " + " | ".join(row) + " |" for row in table.frame.to_numpy()),
        "",
        *table.notes,
        "",
        *differences({name: raws[name] for name in scores}),
    ]
    if means:
        lines += [
            "",
            "Means of arms with fewer seeds than the arms of the first table:",
            "",
            *means,
        ]
    (FOLDER / "table.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (FOLDER / "scores.csv").write_text(scores_csv(rows), encoding="utf-8")
    profile_picture(by_world, label="Mean in unseen worlds").save(FOLDER)
    draw_curves({name: raws[name] for name in scores})
    if {"island", "island_default"} <= scores.keys():
        draw_island(raws)


def differences(raws: dict[str, dict[str, Any]]) -> Iterator[str]:
    """The table of the differences of PAIRS, and of each arm from the tree written by hand.

    Each has the seeds that both arms have, at least FEWEST.
    """
    rows: list[tuple[str, str, int, Interval, float]] = []
    for name, raw in raws.items():
        by_arm = {
            arm: {seed: run["score"] for seed, run in raw["arms"].get(arm, {}).items()}
            for arm in arms_of(WORLDS[name])
        }
        pairs = [pair for pair in PAIRS if {*pair} <= {*by_arm}]
        pairs += [(arm, BY_HAND) for arm in by_arm if arm != REFERENCE]
        by_arm[BY_HAND] = dict.fromkeys(
            {s for runs in by_arm.values() for s in runs}, raw["by_hand"]
        )
        for first, second in pairs:
            seeds = sorted({*by_arm[first]} & {*by_arm[second]})
            if len(seeds) < FEWEST:
                continue
            scores, others = ([by_arm[arm][seed] for seed in seeds] for arm in (first, second))
            test = paired_test(scores, others)
            label = f"{name}: {first} - {second}"
            difference = paired_difference(scores, others)
            rows.append((label, f"{fmean(scores):,.1f}", len(scores), difference, test.p))
    adjusted = benjamini_hochberg([row[-1] for row in rows])
    yield "| difference | mean of the first | runs | mean difference [95 %] | p | p BH |"
    yield "|---|---:|---:|---:|---:|---:|"
    for (label, mean, n, difference, p), p_bh in zip(rows, adjusted, strict=True):
        interval = f"{difference.estimate:,.1f} [{difference.low:,.1f}, {difference.high:,.1f}]"
        yield f"| {label} | {mean} | {n} | {interval} | {p:.2g} | {p_bh:.2g} |"
    hands = ", ".join(f"{name} {raw['by_hand']:,.1f}" for name, raw in raws.items())
    yield ""
    yield (
        "p: Wilcoxon's signed-rank test over seeds, two-sided; p BH: adjusted for all rows. Trees"
        " written by hand are no runs: they are compared by their means in the same worlds"
        f" ({hands})."
    )


def draw_curves(raws: dict[str, dict[str, Any]]) -> None:
    """The fittest tree so far in unseen worlds against episodes: means over runs, a panel a world.

    Bands are Student's intervals of 95 %.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    raws = {name: raw for name, raw in raws.items() if {*CURVES} & {*arms_of(WORLDS[name])}}
    figure = Figure(figsize=(9, 2.9 * len(raws)), layout="constrained")
    for axes, (name, raw) in zip(
        figure.subplots(len(raws), 1, squeeze=False).flat, raws.items(), strict=True
    ):
        for place, arm in enumerate(CURVES):
            curves = [run.get("curve") or [] for run in raw["arms"].get(arm, {}).values()]
            runs = [np.array(curve) for curve in curves if len(curve) > 1]
            if runs:
                at = np.linspace(max(r[0, 0] for r in runs), min(r[-1, 0] for r in runs), POINTS)
                lines = np.array([np.interp(at, run[:, 0], run[:, 1]) for run in runs])
                mean, low, high = np.array([mean_interval(list(column)) for column in lines.T]).T
                axes.plot(at, mean, color=f"C{place}", label=f"{arm} ({len(runs)})")
                axes.fill_between(at, low, high, color=f"C{place}", alpha=0.15)
        axes.axhline(raw["by_hand"], color="black", linestyle=":", label="by hand")
        axes.set(title=name, xlabel="episodes", ylabel="mean in unseen worlds")
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=8, frameon=False)
    with rc_context({"svg.hashsalt": "islandgp"}):  # the same ids in each file
        figure.savefig(FOLDER / "curves.svg", metadata={"Date": None, "Creator": None})
    figure.savefig(FOLDER / "curves.png", dpi=150, metadata={"Software": None})


README_ARMS: Final = (
    ("island_default", "racing, expert", "default run: evolution with the library"),
    ("island_default", "compose", "the library joined, no evolution"),
    ("island", "hill", "hill climber, from nothing, 1,414 episodes"),
    ("island", "racing", "evolution from nothing, 1,414 episodes"),
    ("island", "random", "random trees, no evolution, 1,414 episodes"),
    ("island", "paper", "the paper's baseline, from nothing, 1,414 episodes"),
)
"""World and arm of the lines of the README's figure, and what they are in words."""


def draw_island(raws: dict[str, dict[str, Any]]) -> None:
    """The README's figure: each run of an arm is a dot, its mean a line with Student's interval."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 3.0), layout="constrained")
    axes = figure.subplots()
    for row, (world, arm, _) in enumerate(reversed(README_ARMS)):
        points = [run["score"] / 1000 for run in raws[world]["arms"][arm].values()]
        spread = np.linspace(-0.22, 0.22, len(points))
        axes.plot(points, row + spread, "o", color="C0", markersize=3, alpha=0.5, linewidth=0)
        mean, low, high = mean_interval(points)
        axes.plot([low, high], [row, row], color="black", linewidth=2)
        axes.plot([mean], [row], "|", color="black", markersize=12, markeredgewidth=2)
    axes.axvline(
        raws["island"]["by_hand"] / 1000, color="C3", linestyle="--", label="tree written by hand"
    )
    axes.set_yticks(range(len(README_ARMS)), [words for *_, words in reversed(README_ARMS)])
    axes.set_xlabel("points in 100 unseen worlds, in thousands")
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    with rc_context({"svg.hashsalt": "islandgp"}):
        figure.savefig(FOLDER / "island.svg", metadata={"Date": None, "Creator": None})
    figure.savefig(FOLDER / "island.png", dpi=150, metadata={"Software": None})


def random_trees(names: Sequence[str]) -> None:
    """Writes the table of random trees: RANDOM of each kind, each in its own world."""
    lines = [
        "| world | random trees | earn points | show a behaviour | highest fitness |",
        "|---|---|---:|---:|---:|",
    ]
    for name in names:
        world = WORLDS[name]
        for kind in ("branches", "paper"):
            overrides = ("search=racing", f"search/breeding={kind}", "search.policy.library=0")
            experiment = islandgp.compose(
                *(*overrides, *world.overrides, f"gp.population={RANDOM}", *QUIET),
                config_dir=world.config_dir,
            )
            search, classes = experiment.search(), experiment.plan.classes
            trees = search.ask(search.start(), islandgp.Streams(9000))
            outcomes = [
                experiment.evaluate(islandgp.to_text(i.tree), [world_seed])[0]
                for i, world_seed in zip(trees, UNSEEN_OF_RANDOM, strict=True)
            ]
            earn = fmean(any(v > 0 for v in o.components.values()) for o in outcomes)
            show = fmean(bool(classes.behaviours_of(o.counters)) for o in outcomes)
            best = max(o.fitness for o in outcomes)
            lines.append(f"| {name} | {kind} | {earn:.0%} | {show:.0%} | {best:,.0f} |")
            print(lines[-1], flush=True)
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "random_trees.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Runs, measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many, at most 20")
    parser.add_argument("--worlds", default=",".join(WORLDS), help="names, with commas")
    parser.add_argument("--arms", default=";".join(ARMS), help="names, with semicolons")
    parser.add_argument("--report", action="store_true", help="only write the report")
    parser.add_argument("--random-trees", action="store_true", help="only the table of these")
    options = parser.parse_args()
    sys.path[:0] = [str(PICK_PLACE), str(MINIGRID)]
    names = options.worlds.split(",")
    if unknown := [name for name in names if name not in WORLDS]:
        parser.error(f"expected worlds among {', '.join(WORLDS)}, found {unknown[0]}")
    arms = options.arms.split(";")
    if unknown := [arm for arm in arms if arm not in ARMS]:
        parser.error(f"expected arms among {'; '.join(ARMS)}, found {unknown[0]}")
    if options.random_trees:
        random_trees(names)
    else:
        compare_searches(names, arms, 0 if options.report else options.seeds)


def compare_searches(names: Sequence[str], arms: Sequence[str], seeds: int) -> None:
    """Measure the missing runs of the first `seeds` seeds of each world, and write the report."""
    for i in range(seeds):
        for name in names:  # seed by seed, so that arms have equal numbers of runs if it is stopped
            if i >= len(WORLDS[name].seeds):
                continue
            seed = WORLDS[name].seeds[i]
            raw = read_raw(name)
            if raw["by_hand"] is None:
                raw["by_hand"] = by_hand(name)
            for arm in (arm for arm in arms_of(WORLDS[name]) if arm in arms):
                if str(seed) not in raw["arms"].get(arm, {}):
                    run = measured(name, arm, seed)
                    raw = {**read_raw(name), "by_hand": raw["by_hand"]}  # others may have written
                    raw["arms"].setdefault(arm, {})[str(seed)] = run
                    write_raw(name, raw)
                    print(f"{name} {arm} {seed}: {run['score']:,.1f}", flush=True)
    report()


if __name__ == "__main__":
    main()
