"""Figures 9 and 10, a tree that was injected early and one that evolved late.

    python -m studies.paper.trees [RUNS] [FOLDER]

Reads the runs of `make study` (default: runs/study), and draws both trees into FOLDER (default:
results/figures) as `islandgp show` does.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Final

import pandas as pd  # type: ignore[import-untyped] # its stubs are a package apart

import islandgp

HERE: Final = Path(__file__).parent
EARLY: Final = 2  # the generation of the paper's example
BEST: Final = "excellent"  # the tier of a late tree, if there is one


def early_injected(individuals: pd.DataFrame) -> pd.Series:
    """The first injected tree from generation 2 on, in the order of runs."""
    injected = (individuals["origin"] == "injected") & (individuals["generation"] >= EARLY)
    return individuals[injected].sort_values(["run", "generation"], kind="stable").iloc[0]


def late_evolved(individuals: pd.DataFrame, generations: pd.DataFrame) -> pd.Series:
    """The fittest bred tree of the last stage, an Excellent one if there is any."""
    last = generations[generations["stage"] == generations["stage"].max()]
    late = individuals.merge(last[["run", "generation"]])
    bred = late[~late["tree"].isin(late.loc[late["origin"] == "injected", "tree"])]
    best = bred[bred["best_tier"] == BEST]
    return (best if len(best) else bred).sort_values("fitness", kind="stable").iloc[-1]


def main(arguments: list[str]) -> None:
    """Draw both trees, and print where they come from."""
    defaults = ("runs/study", HERE / "results/figures")
    runs, folder = map(Path, [*arguments, *defaults[len(arguments) :]])
    results = islandgp.load(runs)
    individuals = results.individuals
    trees = {9: early_injected(individuals), 10: late_evolved(individuals, results.generations)}
    folder.mkdir(parents=True, exist_ok=True)
    for number, tree in trees.items():
        file = folder / f"figure-{number}.svg"
        command = [str(Path(sys.executable).with_name("islandgp")), "show", "-", "-o", str(file)]
        subprocess.run(command, input=tree["tree"], text=True, check=True)
        print(
            f"{file}: {tree['run']}, generation {tree['generation']}, {tree['origin']},"
            f" {tree['nodes']} nodes, depth {tree['depth']}, fitness {tree['fitness']:,.0f}"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
