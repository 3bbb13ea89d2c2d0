"""What a comparison has to say: every table and figure, in the order of the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from islandgp.study.arms import Comparison
from islandgp.study.comparable import paired
from islandgp.study.figures import emergence as emergence_figures
from islandgp.study.figures import fitness as fitness_figures
from islandgp.study.figures import population as population_figures
from islandgp.study.figures import supervision as supervision_figures
from islandgp.study.figures import trees as tree_figures
from islandgp.study.figures.drawing import Picture
from islandgp.study.findings import Finding, examine_all, finding
from islandgp.study.generalise import Control, Generalisation
from islandgp.study.measures import FURTHER, TABLE_9, TABLE_10, Measure
from islandgp.study.plan import NOTHING, AnalysisPlan, Family, all_measures, families, said
from islandgp.study.select import in_short
from islandgp.study.table import Table
from islandgp.study.tables.champions import (
    components_table,
    controls_table,
    generalisation_table,
    specialists_table,
)
from islandgp.study.tables.claims import claims_table, primary_table, questions_table
from islandgp.study.tables.comparisons import (
    diversity_table,
    fitness_table,
    median_table,
    power_table,
)
from islandgp.study.tables.emergence import emergence_table, runs_table
from islandgp.study.tables.origins import champion_sources_table, lineage_table, sources_table
from islandgp.study.tables.supervision import decisions_table, overhead_table
from islandgp.supervision.state_json import title

Item = Table | Picture | str  # a string is a paragraph


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with what stands below it."""

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that a comparison has to say."""

    title: str
    doubts: tuple[str, ...]
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...]  # family by family
    unseen: tuple[Generalisation, ...] = ()  # champions and yardsticks in unseen worlds

    @property
    def tables(self) -> list[Table]:
        """In the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Table)]

    @property
    def pictures(self) -> list[Picture]:
        """In the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Picture)]


SPLIT: Final = (
    "Generations count from 0, the initial population. Early, mid and late training are epochs"
    " 1-2, 3-5 and 6-8."
)


METHODS: Final = (
    "Two arms are compared by the Mann-Whitney U test, two-sided: exact, with ties by counting"
    " every split of the ranks; only beyond 100 values with ties it is the normal approximation"
    " corrected for ties and continuity, which the paper takes for all of them (section 3.1)."
    " Where arms share seeds, Wilcoxon's signed-rank test of the pairs stands beside it and"
    " decides the verdicts. p-values of each kind of test are adjusted over their family by"
    " Benjamini and Hochberg; measures that a family does not ask for are adjusted apart."
)


def build(
    study: Comparison,
    unseen: Sequence[Generalisation],
    worlds: int,
    controls: Sequence[Control] = (),
    plan: AnalysisPlan = NOTHING,
) -> Report:
    """The report; `unseen` and `controls` are empty where they were left out."""
    measures, groups = all_measures(study), families(study, plan)
    findings = examine_all(study, groups, measures)
    tables = PairTables(study, findings)
    by_fitness, by_emergence, by_diversity = (
        partial(table, paper=study.paper)
        for table in (fitness_table, emergence_table, diversity_table)
    )
    first_seen = [m for m in measures if m.emergence]
    sections = (
        Section("Primary endpoint", tuple(_primary(study, plan, findings))),
        Section("What was compared", tuple(_compared(study))),
        Section(
            "Controls without evolution",
            (controls_table(study, controls),) if any(c.given for c in controls) else (),
        ),
        Section("The paper's claims", tuple(_claims(study, plan, findings))),
        Section("Further questions", tuple(_questions(plan, groups, findings))),
        Section(
            "Fitness (section 3.2)",
            (
                *tables(by_fitness, "table-9", "Table 9. Fitness performance", TABLE_9),
                fitness_figures.figure_4(study),
            ),
        ),
        Section(
            "Convergence (section 3.3)",
            (
                *tables(by_fitness, "table-10", "Table 10. Fitness by training stage", TABLE_10),
                fitness_figures.figure_5(study),
            ),
        ),
        Section(
            f"{' and '.join(map(title, study.milestones))} Robots (section 3.4)",
            (
                *tables(by_emergence, "table-11", "Table 11. First emergence", first_seen),
                runs_table(study),
                emergence_figures.figure_6(study),
                emergence_figures.emergence_curves(study),
            ),
        ),
        Section(
            "Diversity (section 3.5)",
            (
                *tables(
                    by_diversity,
                    "table-12",
                    "Table 12. Behavioural diversity and mutation rate",
                    FURTHER,
                ),
                population_figures.diversity(study),
                population_figures.classes(study),
            ),
        ),
        Section("Supervision (sections 3.6 and 3.7)", tuple(_supervision(study))),
        Section("Specialists (section 3.8)", (specialists_table(study),)),
        Section("Overhead (section 3.9)", (overhead_table(study),)),
        Section("Trees (section 3.10)", tuple(_trees(study))),
        Section("Beyond the paper", tuple(_beyond(study, tuple(unseen), worlds))),
        Section(
            "How the statistics are done",
            (
                METHODS,
                *said(plan, study),
                SPLIT,
                *tables(median_table, "medians", "Medians, intervals and paired tests", measures),
                power_table(study, findings[0].size),
            ),
        ),
    )
    return Report(
        title=" against ".join(arm.name for arm in study.arms),
        doubts=study.doubts,
        sections=tuple(section for section in sections if section.items),
        findings=findings,
        unseen=tuple(unseen),
    )


@dataclass(frozen=True, slots=True)
class PairTables:
    """The tables that exist once for each pair of arms."""

    study: Comparison
    findings: tuple[Finding, ...]  # for all pairs

    def __call__(
        self, make: Callable[..., Table], key: str, title: str, measures: Sequence[Measure]
    ) -> tuple[Table, ...]:
        """A table of these measures for each pair, by `make(key, title, findings)`."""
        keys = {m.key for m in measures}
        return tuple(
            make(
                f"{key}{end}",
                f"{title}{of}",
                [f for f in self.findings if f.arms == pair and f.measure.key in keys],
            )
            for pair, end, of in self.pairs()
        )

    def pairs(self) -> Iterator[tuple[tuple[str, str], str, str]]:
        """Each pair, and what names it at the end of keys and of titles where there are several."""
        pairs = [(a.name, b.name) for a, b in self.study.pairs]
        for a, b in pairs:
            yield (
                ((a, b), f"-{a}-{b}", f": {a} against {b}") if len(pairs) > 1 else ((a, b), "", "")
            )


def _primary(study: Comparison, plan: AnalysisPlan, findings: Sequence[Finding]) -> Iterator[Item]:
    if plan.primary is not None:
        a, b = study.pairs[0]
        f = finding(findings, plan.primary, (a.name, b.name))
        yield primary_table(f, plan.margins.get(plan.primary))


def _claims(study: Comparison, plan: AnalysisPlan, findings: Sequence[Finding]) -> Iterator[Item]:
    if study.paper is not None and study.paper.claims:
        a, b = study.pairs[0]
        yield claims_table(findings, (a.name, b.name), study.paper, plan.margins)


def _questions(
    plan: AnalysisPlan, groups: Sequence[Family], findings: Sequence[Finding]
) -> Iterator[Item]:
    for k, group in enumerate(groups[1:], 1):
        mine = [f for f in findings if f.family == group.name]
        yield questions_table(f"questions-{k}", group.name, mine, plan.margins)


def _compared(study: Comparison) -> Iterator[Item]:
    rows = [
        {
            "Arm": arm.name,
            "selection": arm.selection,
            "runs": str(len(arm.runs)),
            "seeds": in_short(sorted(set(arm.seeds))),
            "supervisor": ", ".join(sorted({run.supervisor for run in arm.runs})),
            "generations": str(arm.generations),
            "population": ", ".join(sorted({str(r.flat.get("gp.population")) for r in arm.runs})),
        }
        for arm in study.arms
    ]
    yield Table.of("arms", "Arms", rows)
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


def _supervision(study: Comparison) -> Iterator[Item]:
    yield supervision_figures.figure_7(study)
    patterns = supervision_figures.figure_8(study)
    if patterns is not None:
        yield patterns
    yield decisions_table(study)
