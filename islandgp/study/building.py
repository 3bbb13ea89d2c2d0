"""From a comparison to its report: every table and figure, in the order of the paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from islandgp.study.arms import Comparison
from islandgp.study.comparable import paired
from islandgp.study.figures import emergence as emergence_figures
from islandgp.study.figures import fitness as fitness_figures
from islandgp.study.figures import population as population_figures
from islandgp.study.figures import supervision as supervision_figures
from islandgp.study.figures import trees as tree_figures
from islandgp.study.findings import family
from islandgp.study.generalise import Generalisation
from islandgp.study.measures import FAMILY, FURTHER
from islandgp.study.pairs import PairTables
from islandgp.study.report import Item, Report, Section
from islandgp.study.select import spans
from islandgp.study.table import Table
from islandgp.study.tables.champions import components_table, generalisation_table
from islandgp.study.tables.decisions import decisions_table
from islandgp.study.tables.emergence import runs_table
from islandgp.study.tables.lineage import lineage_table, sources_table
from islandgp.study.tables.origins import champion_sources_table
from islandgp.study.tables.overhead import overhead_table
from islandgp.study.tables.power import power_table
from islandgp.study.tables.specialists import specialists_table

METHODS: Final = (
    "Two arms are compared by the Mann-Whitney U test, two-sided: exact, with ties by counting"
    " every split of the ranks; only beyond 100 values with ties it is the normal approximation"
    " corrected for ties and continuity, which the paper takes for all of them (section 3.1). The"
    " nine comparisons of Tables 9, 10 and 11, times the pairs of arms, are one family for"
    " Benjamini and Hochberg; what the paper does not test (diversity, mutation rate) is a second"
    " one. Tests of another kind of the same comparisons (paired, log-rank) are adjusted among"
    " themselves.",
    "Generations count from 0, the initial population. Early, mid and late training are epochs"
    " 1-2, 3-5 and 6-8.",
)


def build(study: Comparison, unseen: Sequence[Generalisation], worlds: int) -> Report:
    """The report; `unseen` may be empty when generalisation was left out."""
    main, more = family(study, FAMILY), family(study, FURTHER)
    pairs = PairTables(study, main, more)
    return Report(
        title=" against ".join(arm.name for arm in study.arms),
        doubts=study.doubts,
        sections=(
            Section("What was compared", tuple(_compared(study))),
            Section("The paper's claims", pairs.each(pairs.claims)),
            Section(
                "Fitness (section 3.2)",
                (*pairs.each(pairs.table_9), fitness_figures.figure_4(study)),
            ),
            Section(
                "Convergence (section 3.3)",
                (*pairs.each(pairs.table_10), fitness_figures.figure_5(study)),
            ),
            Section(
                "Complete and Excellent Robots (section 3.4)",
                (
                    *pairs.each(pairs.table_11),
                    runs_table(study),
                    emergence_figures.figure_6(study),
                    emergence_figures.emergence_curves(study),
                ),
            ),
            Section(
                "Diversity (section 3.5)",
                (
                    *pairs.each(pairs.table_12),
                    population_figures.diversity(study),
                    population_figures.classes(study),
                ),
            ),
            Section(
                "Supervision (sections 3.6 and 3.7)",
                _there(
                    supervision_figures.figure_7(study),
                    supervision_figures.figure_8(study),
                    decisions_table(study),
                ),
            ),
            Section("Specialists (section 3.8)", (specialists_table(study),)),
            Section("Overhead (section 3.9)", (overhead_table(study),)),
            Section("Trees (section 3.10)", tuple(_trees(study))),
            Section("Beyond the paper", tuple(_beyond(study, tuple(unseen), worlds))),
            Section(
                "How the statistics are done",
                (
                    *METHODS,
                    *pairs.each(pairs.medians),
                    power_table(study, len(main)),
                ),
            ),
        ),
        findings=(*main, *more),
    )


def _compared(study: Comparison) -> Iterator[Item]:
    yield Table(
        "arms",
        "Arms",
        ("Arm", "selection", "runs", "seeds", "supervisor", "generations", "population"),
        tuple(
            (
                arm.name,
                arm.selection,
                str(len(arm.runs)),
                spans(sorted(set(arm.seeds))),
                ", ".join(sorted({run.supervisor for run in arm.runs})),
                str(arm.generations),
                ", ".join(sorted({str(run.flat.get("gp.population")) for run in arm.runs})),
            )
            for arm in study.arms
        ),
    )
    if all(paired(a, b) for a, b in study.pairs):
        yield (
            "All arms ran on the same seeds and from the same start: runs of one seed share their"
            " initial population and their worlds, so paired tests stand beside the paper's."
        )
    yield from study.notes
    if study.sources:
        yield f"Runs were read from {', '.join(study.sources)}."


def _trees(study: Comparison) -> Iterator[Item]:
    early = tree_figures.early_injected(study)
    if early is None:
        yield "No arm injects trees, so there is no Figure 9."
    else:
        yield tree_figures.drawn("figure-9", "Figure 9. A tree injected early", early)
    late = tree_figures.late_evolved(study)
    yield tree_figures.drawn("figure-10", "Figure 10. A tree evolved late", late)


def _beyond(study: Comparison, unseen: tuple[Generalisation, ...], worlds: int) -> Iterator[Item]:
    yield fitness_figures.components(study)
    yield components_table(study)
    yield champion_sources_table(study)
    survival = population_figures.lineage(study)
    if survival is not None:
        yield survival
        yield lineage_table(study)
        yield sources_table(study)
    if unseen:
        yield generalisation_table(unseen, worlds)
        yield population_figures.generalisation(unseen, study)


def _there(*items: Item | None) -> tuple[Item, ...]:
    return tuple(item for item in items if item is not None)
