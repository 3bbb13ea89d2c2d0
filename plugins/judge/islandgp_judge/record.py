"""`python -m islandgp_judge.record FILE`: records the populations that `islandgp judge` ships.

Short runs without a supervisor's trees; of some generations the fittest tree and five others.
"""

from __future__ import annotations

import gzip
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from islandgp import compose

DOMAINS: Final = {"island": 14, "lunarlander": 13, "cartpole": 13}
"""Runs of each domain, each with GENERATIONS populations."""
GENERATIONS: Final = (1, 3, 5, 7, 9)
TREES: Final = 6  # of a population
MAX_NODES: Final = 30  # of a recorded tree


def populations(domain: str, seed: int) -> Iterator[dict[str, Any]]:
    """Populations of one run."""
    run = compose(
        *(f"domain={domain}", "search=map_elites", "supervisor=baseline", "gp.population=20"),
        *(f"gp.generations={max(GENERATIONS) + 1}", f"gp.max_nodes={MAX_NODES}", f"seed={seed}"),
        "tracking=off",
    )
    for step in run:
        record = step.record
        if record.snapshot.generation in GENERATIONS:
            order = sorted(record.individuals, key=lambda i: -i.fitness)
            trees = list({i.tree: i for i in (order[0], *order[2:])})[:TREES]
            g = record.snapshot.generation
            yield {"domain": domain, "generation": g, "world": record.worlds[0], "trees": trees}


def main(path: Path) -> None:
    """Writes the file; equal seeds give equal bytes."""
    lines = [
        json.dumps(each, separators=(",", ":"))
        for domain, runs in DOMAINS.items()
        for seed in range(runs)
        for each in populations(domain, 1000 + seed)
    ]
    path.write_bytes(gzip.compress("\n".join(lines).encode(), mtime=0))
    print(f"{len(lines)} populations in {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
