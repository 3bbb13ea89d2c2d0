"""What so many runs can show at all."""

from __future__ import annotations

from islandgp.study.arms import Comparison
from islandgp.study.notation import NONE, number, probability
from islandgp.study.power import LEVEL, smallest_difference
from islandgp.study.table import Table


def power_table(study: Comparison, family: int) -> Table:
    """What so many runs can show at all."""
    sizes = list(dict.fromkeys((len(a.runs), len(b.runs)) for a, b in study.pairs))
    rows = []
    for n1, n2 in sizes:
        for label, level in ((f"{LEVEL:g}", LEVEL), (f"{LEVEL:g} / {family}", LEVEL / family)):
            p = smallest_difference(n1, n2, level)
            rows.append(
                (
                    f"{n1} and {n2}",
                    label,
                    "none" if p.shift is None else number(p.shift, 2),
                    NONE if p.superiority is None else f"{p.superiority:.0%}",
                    NONE if p.r is None else number(p.r, 2),
                    probability(p.least_p),
                )
            )
    return Table(
        "power",
        "Smallest difference that is found with 80 % power",
        (
            "Runs",
            "level of one test",
            "shift (SD)",
            "chance that the better arm's run is better",
            "|r|",
            "least p possible",
        ),
        tuple(rows),
        (
            "By simulation of the exact Mann-Whitney test on normal values that differ by a shift"
            " (4,000 pairs of samples a step, seeded). The second level is the strictest one of"
            " Benjamini and Hochberg's procedure, for the case that nothing else is found. Smaller"
            " differences than these can exist and stay unseen.",
        ),
    )
