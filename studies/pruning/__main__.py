"""Makes runs and writes the table: python -m studies.pruning [--seeds 20] [--first 9100]."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from statistics import fmean, stdev

import islandgp
from islandgp.scoring.classes import tiers

HERE = Path(__file__).parent
UNSEEN = range(500_000, 500_200)  # world seeds

ARMS = {
    "island, default": ((), None),
    "island, 1,414 episodes, no library": (
        ("library.folder=null", "supervisor=baseline", "budget.episodes=1414"),
        None,
    ),
    "pick_place, 3,000 episodes": (
        ("domain=pick_place", "supervisor=baseline", "budget.episodes=3000"),
        "examples/pick_place/conf",
    ),
    "CartPole, 3,000 episodes": (
        ("domain=cartpole", "supervisor=baseline", "budget.episodes=3000"),
        None,
    ),
    "LunarLander, 12,000 episodes": (
        ("domain=lunarlander", "supervisor=baseline", "budget.episodes=12000"),
        None,
    ),
}
"""Overrides and configuration folder of each world."""


@dataclass(frozen=True, slots=True)
class Robot:
    """A best robot before and after its shortening."""

    nodes: tuple[int, int]
    difference: float  # share of the mean size of the fitness before
    lost_tiers: float  # largest loss of a tier's share of the worlds


def robots(
    overrides: Sequence[str], config_dir: str | None, seeds: Sequence[int]
) -> Iterator[Robot]:
    """The best robots of runs with these seeds."""
    for seed in seeds:
        experiment = islandgp.compose(
            *overrides, f"seed={seed}", "name=pruning", "tracking=off", "progress=off",
            config_dir=config_dir,
        )  # fmt: skip
        experiment.run()
        champion = json.loads((experiment.folder / "summary.json").read_text())["champion"]
        trees = [experiment.parse(champion["record"]["tree"]), experiment.parse(champion["tree"])]
        before, after = (experiment.evaluate(tree, UNSEEN) for tree in trees)
        size = fmean(abs(o.fitness) for o in before) or 1.0
        classes = experiment.settings.classes
        shares = [
            {name: fmean(name in tiers(o, classes) for o in outcomes) for name in classes.tiers}
            for outcomes in (before, after)
        ]
        yield Robot(
            nodes=(champion["record"]["nodes"], _nodes(champion)),
            difference=(fmean(o.fitness for o in after) - fmean(o.fitness for o in before)) / size,
            lost_tiers=max(shares[0][name] - shares[1][name] for name in classes.tiers),
        )


def _nodes(champion: dict[str, object]) -> int:
    front = champion["front"]
    assert isinstance(front, list)
    chosen = [tree["nodes"] for tree in front if tree["chosen"]]
    record = champion["record"]
    assert isinstance(record, dict)
    return int(chosen[0] if chosen else record["nodes"])


def row(name: str, found: Sequence[Robot]) -> str:
    """A row of the table."""
    before, after = ([robot.nodes[k] for robot in found] for k in range(2))
    shares = [100 * robot.difference for robot in found]
    half = 2.09 * stdev(shares) / sqrt(len(shares)) if len(shares) > 1 else float("nan")
    mean = fmean(shares)
    lost = max(robot.lost_tiers for robot in found)
    return (
        f"| {name} | {len(found)} | {fmean(before):.1f} | {fmean(after):.1f} | {max(after)}"
        f" | {mean:+.2f} % [{mean - half:+.2f}, {mean + half:+.2f}] | {lost:.1%} |"
    )


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.pruning", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=9100)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    head = (
        "| world | runs | nodes before | after | most | difference in 200 unseen worlds (95 %)"
        " | largest loss of a tier |\n|---|---:|---:|---:|---:|---:|---:|"
    )
    lines = [head]
    for name, (overrides, config_dir) in ARMS.items():
        lines.append(row(name, list(robots(overrides, config_dir, seeds))))
        print(lines[-1], flush=True)
        (HERE / "results").mkdir(exist_ok=True)
        (HERE / "results" / "table.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
