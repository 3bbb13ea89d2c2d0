"""Table 13: how many individuals show a behaviour."""

from __future__ import annotations

from islandgp.study import paper
from islandgp.study.arms import Comparison
from islandgp.study.notation import spread
from islandgp.study.paper import MARK
from islandgp.study.specialists import SPECIALISTS
from islandgp.study.statistics import mean_sd
from islandgp.study.table import Table


def specialists_table(study: Comparison) -> Table:
    """Table 13: how many individuals show a behaviour, over all generations of all runs."""
    rows = []
    for name, count in SPECIALISTS.items():
        cells = [name.capitalize()]
        for arm in study.arms:
            counts = [count(s) for run in arm.runs for s in run.snapshots]
            mean, sd = mean_sd(counts)
            cells += [spread(mean, sd, 1), f"{min(counts)}-{max(counts)}"]
        mean, sd, (low, high) = paper.TABLE_13[name]
        rows.append((*cells, spread(mean, sd, 1), f"{low}-{high}"))
    columns = [f"{arm.name}{what}" for arm in study.arms for what in (" mean ± SD", " range")]
    sizes = " and ".join(
        sorted({str(run.flat.get("gp.population")) for arm in study.arms for run in arm.runs})
    )
    return Table(
        "table-13",
        f"Table 13. Specialists in a population of {sizes}",
        ("Type", *columns, f"{MARK} mean ± SD", f"{MARK} range"),
        tuple(rows),
        (
            "Pickup and humanoid specialists are exclusive classes; charging and clearing are"
            " labels that any individual can carry. SD over all generations of all runs.",
            paper.NOTE,
        ),
    )
