"""Makes runs and writes the table: python -m studies.pruning [--seeds 20] [--first 9400].

Runs that are in results/robots.jsonl are not repeated.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import islandgp
from islandgp.bt.core.node import size
from islandgp.scoring.classes import tiers
from islandgp.statistics import mean_interval

RESULTS = Path(__file__).parent / "results"
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


def robot(overrides: Sequence[str], config_dir: str | None, seed: int) -> dict[str, Any]:
    """The best robot of a run, before and after its shortening.

    Returns:
        `nodes` before and after; `difference` in unseen worlds, as a share of the mean size of the
        fitness before; `lost`, the largest loss of a tier's share of these worlds.
    """
    experiment = islandgp.compose(
        *overrides, f"seed={seed}", "name=pruning", "tracking=off", "progress=off",
        config_dir=config_dir,
    )  # fmt: skip
    if not (experiment.folder / "summary.json").exists():
        experiment.run()
    champion = json.loads((experiment.folder / "summary.json").read_text())["champion"]
    trees = [experiment.parse(champion["record"]["tree"]), experiment.parse(champion["tree"])]
    before, after = (experiment.evaluate(tree, UNSEEN) for tree in trees)
    settings = experiment.settings
    shares = [
        {
            name: fmean(name in tiers(o, settings.classes) for o in outcomes)
            for name in settings.classes.tiers
        }
        for outcomes in (before, after)
    ]
    points = [fmean(o.fitness for o in outcomes) for outcomes in (before, after)]
    return {
        "nodes": [size(tree) for tree in trees],
        "difference": (points[1] - points[0]) / (fmean(abs(o.fitness) for o in before) or 1.0),
        "lost": max(shares[0][name] - shares[1][name] for name in settings.classes.tiers),
    }


def row(name: str, robots: Sequence[Mapping[str, Any]]) -> str:
    """A row of the table."""
    before, after = ([robot["nodes"][k] for robot in robots] for k in range(2))
    shares = [100 * robot["difference"] for robot in robots]
    mean, low, high = mean_interval(shares)
    lost = max(robot["lost"] for robot in robots)
    return (
        f"| {name} | {len(robots)} | {fmean(before):.1f} | {fmean(after):.1f} | {max(after)}"
        f" | {mean:+.2f} % [{low:+.2f}, {high:+.2f}] | {lost:.1%} |"
    )


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(prog="python -m studies.pruning", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=9400)
    parser.add_argument("--world", choices=ARMS, help="only this one")
    options = parser.parse_args()
    RESULTS.mkdir(exist_ok=True)
    file = RESULTS / "robots.jsonl"
    known = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    found = {(each["world"], each["seed"]): each for each in known}
    for name, (overrides, config_dir) in ARMS.items():
        for seed in range(options.first, options.first + options.seeds):
            if (name, seed) in found or options.world not in (None, name):
                continue
            found[name, seed] = {"world": name, "seed": seed, **robot(overrides, config_dir, seed)}
            with file.open("a") as lines:
                lines.write(json.dumps(found[name, seed]) + "\n")
    table = [
        "| world | runs | nodes before | after | most | difference in 200 unseen worlds (95 %)"
        " | largest loss of a tier |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name in ARMS:
        robots = [each for (world, _), each in found.items() if world == name]
        table += [row(name, robots)] if robots else []
    (RESULTS / "table.md").write_text("\n".join(table) + "\n")
    print("\n".join(table))


if __name__ == "__main__":
    main()
