"""The tables that a report has once for each pair of arms."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from islandgp.study import paper
from islandgp.study.arms import Comparison
from islandgp.study.findings import Finding
from islandgp.study.measures import FAMILY, FURTHER, TABLE_9, TABLE_10, TABLE_11, Measure
from islandgp.study.table import Table
from islandgp.study.tables.claims import claims_table
from islandgp.study.tables.diversity import diversity_table
from islandgp.study.tables.emergence import emergence_table
from islandgp.study.tables.fitness import fitness_table
from islandgp.study.tables.medians import median_table


class PairTables:
    """The tables that exist once for each pair of arms."""

    def __init__(self, study: Comparison, main: Sequence[Finding], more: Sequence[Finding]) -> None:
        self.pairs = [(a.name, b.name) for a, b in study.pairs]
        self.main, self.more = main, more

    def each(self, make: Callable[[tuple[str, str], str, str], Table]) -> tuple[Table, ...]:
        """One table a pair; with several pairs, their keys and titles name it."""
        if len(self.pairs) == 1:
            return (make(self.pairs[0], "", ""),)
        return tuple(make(p, f"-{p[0]}-{p[1]}", f": {p[0]} against {p[1]}") for p in self.pairs)

    def of(self, pair: tuple[str, str], measures: Sequence[Measure]) -> list[Finding]:
        """A pair's findings of some measures."""
        return [f for f in (*self.main, *self.more) if f.arms == pair and f.measure in measures]

    def claims(self, pair: tuple[str, str], key: str, title: str) -> Table:
        """Claims."""
        every = (*self.main, *self.more)
        return claims_table(f"claims{key}", f"The paper's claims{title}", every, pair)

    def table_9(self, pair: tuple[str, str], key: str, title: str) -> Table:
        """Table 9."""
        return fitness_table(
            f"table-9{key}",
            f"Table 9. Fitness performance{title}",
            self.of(pair, TABLE_9),
            paper.TABLE_9,
            family=len(self.main),
        )

    def table_10(self, pair: tuple[str, str], key: str, title: str) -> Table:
        """Table 10."""
        return fitness_table(
            f"table-10{key}",
            f"Table 10. Fitness by training stage{title}",
            self.of(pair, TABLE_10),
            paper.TABLE_10,
            family=len(self.main),
        )

    def table_11(self, pair: tuple[str, str], key: str, title: str) -> Table:
        """Table 11."""
        return emergence_table(
            f"table-11{key}",
            f"Table 11. First emergence{title}",
            self.of(pair, TABLE_11),
            family=len(self.main),
        )

    def table_12(self, pair: tuple[str, str], key: str, title: str) -> Table:
        """Table 12."""
        return diversity_table(
            f"table-12{key}",
            f"Table 12. Behavioural diversity and mutation rate{title}",
            self.of(pair, FURTHER),
            family=len(self.more),
        )

    def medians(self, pair: tuple[str, str], key: str, title: str) -> Table:
        """Medians."""
        return median_table(
            f"medians{key}",
            f"Medians, intervals and paired tests{title}",
            self.of(pair, (*FAMILY, *FURTHER)),
        )
