"""The study of the other worlds: expert, baseline and random search, 20 paired seeds each.

    python studies/worlds/study.py

runs what is missing in `runs/`, lets the best robots meet 100 unseen seeds of each level, and
writes studies/worlds/README.md, and the gallery of docs/domains.md. The plan, made before the
runs, is in studies/log.md.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import sqrt
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import numpy as np

import islandgp
from islandgp.domain import Outcome, Scene
from islandgp.statistics import benjamini_hochberg, mean_interval, paired_test
from studies.resampling import bootstrap

ROOT: Final = Path(__file__).resolve().parents[2]
DOMAINS: Final = ROOT / "islandgp" / "domains"
PAGE: Final = Path(__file__).with_name("README.md")
CONF: Final = ROOT / "studies" / "conf"  # its domain/minigrid.yaml is a link to that of the example
MINIGRID: Final = ROOT / "examples" / "minigrid"
GALLERY: Final = ROOT / "docs" / "domains.md"

SEEDS: Final = range(6000, 6020)  # of runs; nothing was tried on them
UNSEEN: Final = range(10_000, 10_100)  # of worlds, for the tables of trees
FEWER: Final = range(20_000, 20_020)  # of worlds a level, for each of a study's 60 best robots
QUIET: Final = ("tracking=off", "evaluator=serial", "progress=off")
TREES: Final = ("gp.trees.kinds.parallel=0.5",)  # as when these studies were planned

ARMS: Final[dict[str, tuple[str, ...]]] = {
    "expert": ("search=paper", "supervisor=expert"),
    "baseline": ("search=paper", "supervisor=baseline"),
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
    shown: str = ""  # the level of the picture
    seed: int = 0  # of the world of the picture


STUDIES: Final = (
    Study(
        "MiniGrid",
        "minigrid",
        ("gp.population=20", "gp.generations=16", "gp.episodes=3"),
        "solved",
        "share of missions done",
        MINIGRID / "by_hand.bt",
        (
            *("DoorKey-8x8", "MultiRoom-N6", "LockedRoom", "UnlockPickup", "KeyCorridorS3R3"),
            *("BlockedUnlockPickup", "DoorKey-16x16", "KeyCorridorS4R3"),
        ),
        "KeyCorridorS3R3",
        4,
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
TRAINED: Final = 6  # levels of MiniGrid that runs train on; the others are listed beside them


def _p(p: float) -> str:
    """A probability as people read it."""
    return f"{p:.3f}" if p >= 0.0005 else "< 0.001"


def best_robot(study: Study, arm: str, seed: int) -> dict[str, Any]:
    """A run, made where it is missing: its best robot, and what the run itself thinks of it."""
    name = f"name=worlds-{study.domain}-{arm.replace(' ', '_')}"
    overrides = (f"domain={study.domain}", *ARMS[arm], *study.budget, *TREES, name, f"seed={seed}")
    (row,) = islandgp.run(*overrides, *QUIET, config_dir=CONF).runs.to_dict("records")
    return dict(row)


def episodes(study: Study, tree: str, seeds: Sequence[int], level: str = "") -> list[Outcome]:
    """The outcomes of a tree in the worlds of these seeds."""
    return experiment(study.domain, level).evaluate(tree, seeds)


@cache
def experiment(domain: str, level: str = "") -> islandgp.Experiment:
    """A domain as it comes, with one level or all."""
    overrides = [f"domain={domain}", *([f"world.levels=[{level}]"] if level else [])]
    return islandgp.compose(*overrides, *QUIET, config_dir=CONF)


def measured(study: Study, tree: str) -> float:
    """A run's measure: the mean over all levels that runs train on."""
    return fmean(
        o.counters[study.counter]
        for level in study.levels[:TRAINED] or ("",)
        for o in episodes(study, tree, FEWER, level)
    )


def success_cell(study: Study, outcomes: Sequence[Outcome]) -> str:
    """A measure with its 95 % interval: Wilson's for shares, Student's t for means."""
    values = [o.counters[study.counter] for o in outcomes]
    if study.counter != "solved":
        mean = mean_interval(values)
        return f"{mean.estimate:.0f} ({mean.low:.0f} to {mean.high:.0f})"
    n, p, z = len(values), fmean(values), 1.96
    middle, half = p + z * z / (2 * n), z * sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = (100 * (middle + side * half) / (1 + z * z / n) for side in (-1, 1))
    return f"{100 * p:.0f} % ({low:.0f} to {high:.0f})"


def main() -> None:
    """Runs, measures and writes; the number of seeds may be given, at least 2."""
    seeds = SEEDS[: int(sys.argv[1])] if len(sys.argv) > 1 else SEEDS
    for seed in seeds:  # seed by seed: a study that is stopped has as many of each arm
        for study in STUDIES:
            for arm in ARMS:
                best_robot(study, arm, seed)
        print(f"seed {seed} is done", flush=True)
    parts, tests = [], []
    for study in STUDIES:
        runs = {arm: [best_robot(study, arm, seed) for seed in seeds] for arm in ARMS}
        scores = {arm: [measured(study, row["tree"]) for row in runs[arm]] for arm in ARMS}
        for one, other in PAIRS:
            differences = [a - b for a, b in zip(scores[one], scores[other], strict=True)]
            mean = bootstrap([differences], lambda x: np.mean(x, axis=-1))
            p = paired_test(scores[one], scores[other])
            tests.append((study, one, other, mean, p))
        parts.append((study, runs, scores))
    adjusted = benjamini_hochberg([p.p for *_, p in tests])
    lines = [f"{len(seeds)} paired seeds.", "", _row("study", "measure", *ARMS), _rule(5)]
    for study, _, scores in parts:
        cells = (bootstrap([scores[arm]], lambda x: np.mean(x, axis=-1)) for arm in ARMS)
        intervals = (_numbers(study, c.estimate, c.low, c.high) for c in cells)
        lines.append(_row(study.title, study.unit, *intervals))
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
                _p(p.p),
                _p(q),
            )
        )
    replace_parts(
        PAGE,
        comparison="\n".join(lines),
        trees="\n".join(_trees(study, runs) for study, runs, _ in parts),
    )
    for study, runs, _ in parts:
        picture(study, str(evolved(runs)["tree"]))
    gallery = "\n".join(_gallery_entry(study, runs) for study, runs, _ in parts)
    replace_parts(GALLERY, gallery=gallery)


def evolved(runs: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """The row of the best evolved robot, by validation."""
    rows = [row for arm in PAIRS[0] for row in runs[arm]]
    return max(rows, key=lambda row: float(row["best"]))


def picture(study: Study, tree: str) -> None:
    """Keeps the frame two thirds into an episode of a tree, in docs/img."""
    domain = experiment(study.domain, study.shown).domain
    node, frames = experiment(study.domain, study.shown).parse(tree), _Frames()
    domain.run_episode(node, study.seed, {}, frames)
    frame = frames.pictures[2 * len(frames.pictures) // 3]
    (ROOT / "docs" / "img" / f"world-{study.domain}.png").write_bytes(frame)


class _Frames:
    """Collects the pictures of an episode."""

    def __init__(self) -> None:
        self.pictures: list[bytes] = []

    def node(self, place: int, status: int) -> None: ...

    def tick(self, _board: Sequence[float], scene: Scene | None) -> None:
        if scene is not None and scene.frame is not None:
            self.pictures.append(scene.frame())

    def credit(self, component: str, points: float, event: str, action: str) -> None: ...


def _gallery_entry(study: Study, runs: dict[str, list[dict[str, Any]]]) -> str:
    """A domain of the gallery: picture, vocabulary, best tree, score."""
    schema, tree = experiment(study.domain).domain.schema, str(evolved(runs)["tree"])
    levels = study.levels[:TRAINED] or ("",)

    def score(text: str) -> str:
        return success_cell(
            study, [o for level in levels for o in episodes(study, text, UNSEEN, level)]
        )

    seeds = f"100 unseen seeds{' of each of the six levels' if study.levels else ''}"
    return "\n".join(
        (
            f"### {study.title}: `domain={study.domain}`",
            "",
            f"![{study.title}: a frame of an episode](img/world-{study.domain}.png)",
            "",
            schema.task,
            "",
            f"- actions: {', '.join(f'`{name}`' for name in schema.vocabulary.actions)}",
            f"- keys: {', '.join(f'`{name}`' for name in schema.vocabulary.keys)}",
            f"- score, the {study.unit} on {seeds}: best tree of"
            " [the study](../studies/worlds/README.md),"
            f" with the paper's algorithm, {score(tree)},"
            f" [by hand](../{study.by_hand.relative_to(ROOT)})"
            f" {score(study.by_hand.read_text(encoding='utf-8'))}",
            "",
            "The best evolved tree:",
            "",
            "```bt",
            tree.strip(),
            "```",
            "",
        )
    )


def _trees(study: Study, runs: dict[str, list[dict[str, Any]]]) -> str:
    """The table of one study: the best of each arm, by validation, and the one by hand."""
    best = {arm: max(rows, key=lambda row: float(row["best"])) for arm, rows in runs.items()}
    trees = {f"best of {arm}": str(row["tree"]) for arm, row in best.items()}
    trees["written by hand"] = study.by_hand.read_text(encoding="utf-8")
    lines = [f"### {study.title}", "", _row(study.unit, *trees), _rule(1 + len(trees))]
    for level in study.levels or ("",):
        cells = [
            success_cell(study, episodes(study, tree, UNSEEN, level)) for tree in trees.values()
        ]
        lines.append(_row(level or study.title, *cells))
    best_of_all = evolved(runs)
    seed, tree = best_of_all["seed"], str(best_of_all["tree"])
    lines += ["", f"The best evolved tree (seed {seed}):", "", "```bt", tree.strip(), "```", ""]
    return "\n".join(lines)


def _numbers(study: Study, value: float, low: float, high: float, sign: str = "") -> str:
    scale, digits, unit = (100, 1, " %") if study.counter == "solved" else (1, 1, "")
    middle, least, most = (f"{scale * x:{sign}.{digits}f}" for x in (value, low, high))
    return f"{middle}{unit} ({least} to {most})"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


def _rule(columns: int) -> str:
    return "|---" * columns + "|"


def replace_parts(page: Path, **parts: str) -> None:
    """Rewrites a page between its markers."""
    text = page.read_text(encoding="utf-8")
    for part, content in parts.items():
        begin, end = f"<!-- begin {part} -->\n", "<!-- end -->"
        before, marker, rest = text.partition(begin)
        assert marker, f"{page} has no {begin}"
        text = f"{before}{begin}{content}\n{end}{rest.partition(end)[2]}"
    page.write_text(text, encoding="utf-8")
    print(f"wrote {page}")


if __name__ == "__main__":
    sys.path.insert(0, str(MINIGRID))
    main()
