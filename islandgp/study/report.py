"""The report of a comparison: its tables and figures, in the order of the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from islandgp.study.arms import Comparison
from islandgp.study.comparable import paired
from islandgp.study.figures import generations, newcomers
from islandgp.study.figures import trees as tree_figures
from islandgp.study.figures.drawing import Picture
from islandgp.study.figures.emergence import emergence_curves, figure_6
from islandgp.study.figures.episodes import by_episodes
from islandgp.study.figures.profiles import profile_picture
from islandgp.study.findings import Finding, examine_all, finding
from islandgp.study.generalise import Control, Generalisation
from islandgp.study.measures import (
    FURTHER,
    MEAN_MAX,
    TABLE_9,
    TABLE_10,
    Measure,
    all_measures,
    emergence,
    examined,
)
from islandgp.study.plan import NOTHING, AnalysisPlan, families, in_sentences
from islandgp.study.profiles import ScoreRow, Scores
from islandgp.study.select import in_short
from islandgp.study.table import Table
from islandgp.study.tables.archives import archive_table, one_grid
from islandgp.study.tables.champions import (
    components_table,
    constraints_table,
    controls_table,
    generalisation_table,
    specialists_table,
)
from islandgp.study.tables.claims import (
    claims_table,
    comparison_verdict,
    estimate_cells,
    primary_table,
    questions_table,
    test_name,
)
from islandgp.study.tables.comparisons import (
    diversity_table,
    emergence_table,
    fitness_table,
    median_table,
    power_table,
    runs_table,
)
from islandgp.study.tables.origins import (
    champion_sources_table,
    edits_table,
    lineage_table,
    sources_table,
)
from islandgp.study.tables.scores import (
    VALIDATED,
    champion_rows,
    champion_scores,
    score_table,
)
from islandgp.study.tables.supervision import decisions_table, episodes_table, overhead_table
from islandgp.study.texts import note
from islandgp.text import title

Item = Table | Picture | str  # a string is a paragraph
Findings = Sequence[Finding]


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with the items below it."""

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class ComparisonReport:
    """The content of a comparison's report."""

    title: str
    comparability_warnings: tuple[str, ...]
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...]  # family by family
    unseen: tuple[Generalisation, ...] = ()  # champions and reference trees in unseen worlds
    scores: tuple[ScoreRow, ...] = ()  # of the best robots; (): they have none

    @property
    def tables(self) -> list[Table]:
        """In the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Table)]

    @property
    def pictures(self) -> list[Picture]:
        """In the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Picture)]


def build(
    study: Comparison,
    unseen: Sequence[Generalisation],
    worlds: int,
    controls: Sequence[Control] = (),
    plan: AnalysisPlan = NOTHING,
) -> ComparisonReport:
    """The report; `unseen` and `controls` are empty where they were left out."""
    wanted = {*plan.margins, *([] if plan.primary is None else [plan.primary])}
    findings = examine_all(study, families(study, plan), examined(study, wanted))
    robots = " and ".join(map(title, study.milestones))
    with_library = any(control.injectable for control in controls)
    scores = champion_scores(study, unseen)
    rows = champion_rows(study, scores)
    chapters: dict[str, Iterable[Item]] = {
        "Result": [*result(study, plan, findings), generations.figure_4(study)],
        "Primary endpoint": _primary(study, plan, findings),
        "What was compared": _compared(study),
        "Controls without evolution": [controls_table(study, controls)] if with_library else [],
        "The paper's claims": _claims(study, plan, findings),
        "Further questions": _questions(study, plan, findings),
        "Scores of the best robots": _scores(study, scores, rows),
        **_paper_s_tables(study, findings, f"{robots} {study.classes.agent}s (section 3.4)"),
        "Cost in episodes": [episodes_table(study), by_episodes(study)],
        "Supervision (sections 3.6 and 3.7)": _supervision(study),
        "Specialists (section 3.8)": [specialists_table(study)],
        "Overhead (section 3.9)": [overhead_table(study)],
        "Trees (section 3.10)": _trees(study),
        "Beyond the paper": _beyond(study, unseen, worlds),
        "How the statistics are done": _statistics(study, plan, findings),
    }
    sections = (Section(heading, tuple(items)) for heading, items in chapters.items())
    return ComparisonReport(
        title=" against ".join(arm.name for arm in study.arms),
        comparability_warnings=study.comparability_warnings,
        sections=tuple(section for section in sections if section.items),
        findings=findings,
        unseen=tuple(unseen),
        scores=rows,
    )


def _paper_s_tables(
    study: Comparison, findings: Findings, robots: str
) -> dict[str, Iterable[Item]]:
    """Sections 3.2 to 3.5: Tables 9 to 12, one for each pair of arms, and what goes with them."""
    by_fitness, by_emergence, by_diversity = (
        partial(_for_pairs, study, findings, partial(table, paper=study.paper))
        for table in (fitness_table, emergence_table, diversity_table)
    )
    firsts = [m for m in all_measures(study) if m.emergence]
    return {
        "Fitness (section 3.2)": [
            *by_fitness("table-9", "Table 9. Fitness performance", TABLE_9),
            "Figure 4 is at the top, with the result.",
        ],
        "Convergence (section 3.3)": [
            *by_fitness("table-10", "Table 10. Fitness by training stage", TABLE_10),
            generations.figure_5(study),
        ],
        robots: [
            *by_emergence("table-11", "Table 11. First emergence", firsts),
            runs_table(study),
            figure_6(study),
            emergence_curves(study),
        ],
        "Diversity (section 3.5)": [
            *by_diversity("table-12", "Table 12. Behavioural diversity and mutation rate", FURTHER),
            generations.diversity_by_generation(study),
            generations.classes(study),
        ],
    }


def _for_pairs(
    study: Comparison,
    findings: Findings,
    make: Callable[..., Table],
    key: str,
    title: str,
    measures: Sequence[Measure],
) -> Iterator[Table]:
    """A table of these measures for each pair of arms, by `make(key, title, findings)`."""
    keys, several = {m.key for m in measures}, len(study.pairs) > 1
    for a, b in ((a.name, b.name) for a, b in study.pairs):
        selected = [f for f in findings if f.arms == (a, b) and f.measure.key in keys]
        end, of = (f"-{a}-{b}", f": {a} against {b}") if several else ("", "")
        yield make(f"{key}{end}", f"{title}{of}", selected)


def _primary(study: Comparison, plan: AnalysisPlan, findings: Findings) -> Iterator[Item]:
    if plan.primary is not None:
        a, b = study.pairs[0]
        f = finding(findings, plan.primary, (a.name, b.name))
        yield primary_table(f, plan.margins.get(plan.primary))


def _claims(study: Comparison, plan: AnalysisPlan, findings: Findings) -> Iterator[Item]:
    if study.paper is not None and study.paper.claims:
        a, b = study.pairs[0]
        yield claims_table(findings, (a.name, b.name), study.paper, plan.margins)


def _questions(study: Comparison, plan: AnalysisPlan, findings: Findings) -> Iterator[Item]:
    for k, family in enumerate(families(study, plan)[1:], 1):
        selected = [f for f in findings if f.family == family.name]
        yield questions_table(f"questions-{k}", family.name, selected, plan.margins)


def _scores(study: Comparison, scores: Scores, rows: Sequence[ScoreRow]) -> Iterator[Item]:
    if any(run.constraints for arm in study.arms for run in arm.runs):
        yield constraints_table(study)
    if not scores:
        yield note("not-validated")
        return
    notes = (note("validated"),) if VALIDATED in scores else (note("not-validated"),)
    yield score_table(rows, title="Scores of the best robots (points)", world="Score", notes=notes)
    yield profile_picture(scores, label="Points")


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
    yield Table.of("arms", "Arms", map(dict.items, rows))
    if all(paired(a, b) for a, b in study.pairs):
        yield note("same-start")
    yield from study.notes
    if study.sources:
        yield f"Runs were read from {', '.join(study.sources)}."


def _trees(study: Comparison) -> Iterator[Item]:
    early = tree_figures.early_injected(study)
    if early is None:
        yield "No arm injects trees, so there is no Figure 9."
    else:
        yield tree_figures.drawn(early)
    yield tree_figures.drawn(tree_figures.late_evolved(study))


def _beyond(study: Comparison, unseen: Sequence[Generalisation], worlds: int) -> Iterator[Item]:
    yield generations.components(study)
    yield components_table(study)
    yield champion_sources_table(study)
    if one_grid(study):
        yield archive_table(study)
        yield generations.archive_by_generation(study)
    survival = newcomers.lineage(study)
    if survival is not None:
        yield survival
        yield lineage_table(study)
        edits = edits_table(study)
        if edits is not None:
            yield edits
        yield sources_table(study)
    if unseen:
        yield generalisation_table(unseen, worlds)
        yield newcomers.generalisation(unseen, study)


def _supervision(study: Comparison) -> Iterator[Item]:
    yield generations.figure_7(study)
    patterns = generations.figure_8(study)
    if patterns is not None:
        yield patterns
    yield decisions_table(study)


def _statistics(study: Comparison, plan: AnalysisPlan, findings: Findings) -> Iterator[Item]:
    yield note("methods")
    yield from in_sentences(plan, study)
    yield note("generations")
    heading = "Medians, intervals and paired tests"
    yield from _for_pairs(study, findings, median_table, "medians", heading, all_measures(study))
    yield power_table(study, findings[0].size)


def result(study: Comparison, plan: AnalysisPlan, findings: Sequence[Finding]) -> Iterator[str]:
    """A sentence for each pair of arms and measure.

    The measure is the plan's primary endpoint; without one these are the mean over generations of
    the highest fitness, and the first robot of the easiest milestone.
    """
    without_plan = [MEAN_MAX.key, *(emergence(tier).key for tier in study.milestones[:1])]
    for key in without_plan if plan.primary is None else [plan.primary]:
        for a, b in study.pairs:
            f = finding(findings, key, (a.name, b.name))
            p = f.test.p if plan.primary == key and (a, b) == study.pairs[0] else None
            yield _sentence(f, comparison_verdict(f, plan.margins.get(key), p))


def _sentence(f: Finding, verdict: str) -> str:
    cells = dict(estimate_cells(f))
    a, b = f.arms
    if f.never or f.equal:
        return f"{f.measure.label}, {a} minus {b}: {verdict}."
    difference = f"{cells['difference [95 %]']} {cells['unit']}"
    return f"{f.measure.label}, {a} minus {b}: {difference} ({test_name(f)}); {verdict}."
