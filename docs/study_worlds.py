"""The study of the other worlds: expert, baseline and random search, 20 paired seeds each.

    python docs/study_worlds.py

runs what is missing in `runs/`, lets the best robots meet 100 unseen seeds of each level, and
writes docs/study_worlds.md. The plan, made before the runs, stands in docs/log.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import numpy as np

import islandgp
from islandgp.domain import Outcome
from islandgp.evolution.validation import interval
from islandgp.study.statistics import benjamini_hochberg, bootstrap, paired_test

ROOT: Final = Path(__file__).resolve().parent.parent
DOMAINS: Final = ROOT / "islandgp" / "domains"
PAGE: Final = ROOT / "docs" / "study_worlds.md"

SEEDS: Final = range(6000, 6020)  # of runs; nothing was tried on them
UNSEEN: Final = range(10_000, 10_100)  # of worlds, for the tables of trees
FEWER: Final = range(20_000, 20_020)  # of worlds a level, for each of a study's 60 best robots
QUIET: Final = ("tracking=off", "evaluator=serial", "progress=off")

ARMS: Final[dict[str, tuple[str, ...]]] = {
    "expert": ("supervisor=expert",),
    "baseline": ("supervisor=baseline",),
    "random search": ("experiment=random_search",),
}
PAIRS: Final = (
    ("expert", "baseline"),
    ("expert", "random search"),
    ("baseline", "random search"),
)


@dataclass(frozen=True, slots=True)
class Study:
    """One domain's."""

    title: str
    domain: str
    budget: tuple[str, ...]  # overrides
    counter: str  # what is measured
    unit: str  # of the measure
    by_hand: Path
    levels: tuple[str, ...] = ()  # () where there is only one


STUDIES: Final = (
    Study(
        "MiniGrid",
        "minigrid",
        ("gp.population=20", "gp.generations=16", "gp.episodes=3"),
        "solved",
        "share of missions done",
        DOMAINS / "minigrid" / "trees" / "by_hand.bt",
        (
            *("DoorKey-8x8", "MultiRoom-N6", "LockedRoom", "UnlockPickup", "KeyCorridorS3R3"),
            *("BlockedUnlockPickup", "DoorKey-16x16", "KeyCorridorS4R3"),
        ),
    ),
    Study(
        "LunarLander",
        "lunarlander",
        ("gp.population=20", "gp.generations=21", "gp.episodes=3"),
        "return",
        "mean return",
        DOMAINS / "gymnasium" / "trees" / "lunarlander.bt",
    ),
    Study(
        "CartPole",
        "cartpole",
        ("gp.population=20", "gp.generations=11", "gp.episodes=2"),
        "return",
        "mean return",
        DOMAINS / "gymnasium" / "trees" / "cartpole.bt",
    ),
)
TRAINED: Final = 6  # levels of MiniGrid that runs train on; the others are told beside them


def best_robots(study: Study, arm: str) -> list[dict[str, Any]]:
    """A row for each seed's run: its best robot, and what the run itself thinks of it."""
    rows = []
    for seed in SEEDS:
        name = f"name=worlds-{study.domain}-{arm.replace(' ', '_')}"
        words = (f"domain={study.domain}", *ARMS[arm], *study.budget, name, f"seed={seed}")
        rows += islandgp.run(*words, *QUIET).runs.to_dict("records")
    return rows


def episodes(study: Study, tree: str, seeds: Sequence[int], level: str = "") -> list[Outcome]:
    """The outcomes of a tree in the worlds of these seeds."""
    words = [f"domain={study.domain}", *([f"world.levels=[{level}]"] if level else [])]
    return islandgp.compose(*words, *QUIET).evaluate(tree, seeds)


def measured(study: Study, tree: str) -> float:
    """A run's measure: the mean over all levels that runs train on."""
    return fmean(
        o.counters[study.counter]
        for level in study.levels[:TRAINED] or ("",)
        for o in episodes(study, tree, FEWER, level)
    )


def told(study: Study, outcomes: Sequence[Outcome]) -> str:
    """A measure with its 95 % interval: Wilson's for shares, Student's t for means."""
    values = [o.counters[study.counter] for o in outcomes]
    if study.counter != "solved":
        return "{:.0f} ({:.0f} to {:.0f})".format(*interval(values))
    n, p, z = len(values), fmean(values), 1.96
    middle, half = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = (100 * (middle + side * half) / (1 + z * z / n) for side in (-1, 1))
    return f"{100 * p:.0f} % ({low:.0f} to {high:.0f})"


def main() -> None:
    """Runs, measures and writes."""
    parts, tests = [], []
    for study in STUDIES:
        runs = {arm: best_robots(study, arm) for arm in ARMS}
        found = {arm: [measured(study, row["tree"]) for row in runs[arm]] for arm in ARMS}
        for one, other in PAIRS:
            differences = np.subtract(found[one], found[other])
            mean = bootstrap([differences], lambda x: np.mean(x, axis=-1))
            p = paired_test(found[one], found[other])
            tests.append((study, one, other, mean, p))
        parts.append((study, runs, found))
    adjusted = benjamini_hochberg([p.p for *_, p in tests])
    lines = [_row("study", "measure", *ARMS), _rule(5)]
    for study, _, found in parts:
        cells = (bootstrap([found[arm]], lambda x: np.mean(x, axis=-1)) for arm in ARMS)
        shown = (_numbers(study, c.estimate, c.low, c.high) for c in cells)
        lines.append(_row(study.title, study.unit, *shown))
    lines += [
        "",
        _row("study", "comparison", "mean difference", "better in", "p", "p BH"),
        _rule(6),
    ]
    for (study, one, other, mean, p), q in zip(tests, adjusted, strict=True):
        lines.append(
            _row(
                study.title,
                f"{one} - {other}",
                _numbers(study, mean.estimate, mean.low, mean.high, sign="+"),
                f"{p.higher} of {p.pairs}",
                f"{p.p:.3f}",
                f"{q:.3f}",
            )
        )
    text = PAGE.read_text(encoding="utf-8")
    text = _replaced(text, "comparison", "\n".join(lines))
    text = _replaced(text, "trees", "\n".join(_trees(study, runs) for study, runs, _ in parts))
    PAGE.write_text(text, encoding="utf-8")
    print(f"wrote {PAGE}")


def _trees(study: Study, runs: dict[str, list[dict[str, Any]]]) -> str:
    """The table of one study: the best of each arm, as validation says, and the one by hand."""
    best = {arm: max(rows, key=lambda row: float(row["best"])) for arm, rows in runs.items()}
    trees = {f"best of {arm}": str(row["tree"]) for arm, row in best.items()}
    trees["written by hand"] = study.by_hand.read_text(encoding="utf-8")
    lines = [f"### {study.title}", "", _row(study.unit, *trees), _rule(1 + len(trees))]
    for level in study.levels or ("",):
        cells = [told(study, episodes(study, tree, UNSEEN, level)) for tree in trees.values()]
        lines.append(_row(level or study.title, *cells))
    seed, tree = max(
        ((row["seed"], row["tree"], float(row["best"])) for arm in PAIRS[0] for row in runs[arm]),
        key=lambda found: found[2],
    )[:2]
    lines += ["", f"The best evolved tree (seed {seed}):", "", "```", tree.strip(), "```", ""]
    return "\n".join(lines)


def _numbers(study: Study, value: float, low: float, high: float, sign: str = "") -> str:
    scale, digits, unit = (100, 1, " %") if study.counter == "solved" else (1, 1, "")
    middle, least, most = (f"{scale * x:{sign}.{digits}f}" for x in (value, low, high))
    return f"{middle}{unit} ({least} to {most})"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _rule(columns: int) -> str:
    return "|---" * columns + "|"


def _replaced(text: str, part: str, content: str) -> str:
    begin, end = f"<!-- begin {part} -->\n", "<!-- end -->"
    before, _, rest = text.partition(begin)
    return f"{before}{begin}{content}\n{end}{rest.partition(end)[2]}"


if __name__ == "__main__":
    main()
