"""The report of a comparison: tables and figures, in the order of the paper."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from islandgp.study.arms import Arm, Comparison
from islandgp.study.comparable import paired
from islandgp.study.figures import emergence, episodes, generations, newcomers, profiles
from islandgp.study.figures.drawing import Picture
from islandgp.study.findings import Finding, examine_all, finding
from islandgp.study.generalise import Control, Generalisation
from islandgp.study.measures import (
    MEAN_MAX,
    TABLE_9,
    TABLE_10,
    UNTESTED_IN_PAPER,
    all_measures,
    examined,
)
from islandgp.study.measures import emergence as first_emergence
from islandgp.study.plan import DEFAULT_PLAN, AnalysisPlan, families, in_sentences
from islandgp.study.profiles import ScoreRow, Scores
from islandgp.study.select import in_short
from islandgp.study.table import Row, Table
from islandgp.study.tables import champions, claims, comparisons, origins, scores, supervision
from islandgp.study.texts import note
from islandgp.text import title

Item = Table | Picture | str  # a string is a paragraph
Findings = Sequence[Finding]


@dataclass(frozen=True, slots=True)
class Section:
    """A section: a heading with its items."""

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class ComparisonReport:
    """The content of a comparison's report."""

    title: str
    comparability_warnings: tuple[str, ...]
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...]  # family by family
    unseen: tuple[Generalisation, ...] = ()  # best robots and reference trees in unseen worlds
    scores: tuple[ScoreRow, ...] = ()  # of the best robots

    @property
    def tables(self) -> list[Table]:
        """All, in the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Table)]

    @property
    def pictures(self) -> list[Picture]:
        """All, in the order of the page."""
        return [i for s in self.sections for i in s.items if isinstance(i, Picture)]


def build(
    study: Comparison,
    unseen: Sequence[Generalisation],
    worlds: int,
    controls: Sequence[Control] = (),
    plan: AnalysisPlan = DEFAULT_PLAN,
) -> ComparisonReport:
    """Build the report; `unseen` and `controls` are empty if they were left out."""
    requested = {*plan.margins, *filter(None, [plan.primary])}
    findings = examine_all(study, families(study, plan), examined(study, requested))
    robots = f"{' and '.join(map(title, study.milestones))} {study.classes.agent}s"
    first_pair = study.names[0], study.names[1]
    with_library = any(control.injectable for control in controls)
    of_champions = scores.champion_scores(study, unseen)
    rows = scores.champion_rows(study, of_champions)
    tables = partial(comparisons.paper_tables, study, findings)
    firsts = [m for m in all_measures(study) if m.emergence]
    chapters: dict[str, Iterable[Item | None]] = {
        "Result": [*result(study, plan, findings), generations.figure_4(study)],
        "Primary endpoint": [
            claims.primary_table(finding(findings, key, first_pair), plan.margins.get(key))
            for key in filter(None, [plan.primary])
        ],
        "What was compared": _compared(study),
        "Controls without evolution": [
            champions.controls_table(study, controls) if with_library else None
        ],
        "Further questions": _questions(study, plan, findings),
        "Scores of the best robots": _scores(study, of_champions, rows),
        "Fitness (section 3.2)": [
            *tables("table-9", "Table 9. Fitness performance", TABLE_9, comparisons.fitness_row),
            "Figure 4 is at the top, with the result.",
        ],
        "Convergence (section 3.3)": [
            *tables(
                "table-10", "Table 10. Fitness by training stage", TABLE_10, comparisons.fitness_row
            ),
            generations.figure_5(study),
        ],
        f"{robots} (section 3.4)": [
            *tables(
                "table-11",
                "Table 11. First emergence",
                firsts,
                comparisons.emergence_row,
                note("without"),
            ),
            comparisons.runs_table(study),
            emergence.figure_6(study),
            emergence.emergence_curves(study),
        ],
        "Diversity (section 3.5)": [
            *tables(
                "table-12",
                "Table 12. Behavioural diversity and mutation rate",
                UNTESTED_IN_PAPER,
                comparisons.diversity_row,
                note("untested"),
            ),
            generations.diversity_by_generation(study),
            generations.classes(study),
        ],
        "Cost in episodes": [supervision.episodes_table(study), episodes.by_episodes(study)],
        "Supervision (sections 3.6 and 3.7)": [
            generations.figure_7(study),
            generations.figure_8(study),
            supervision.decisions_table(study),
        ],
        "Specialists (section 3.8)": [champions.specialists_table(study)],
        "Overhead (section 3.9)": [supervision.overhead_table(study)],
        "Beyond the paper": _beyond(study, unseen, worlds),
        "How the statistics are done": [
            note("methods"),
            *in_sentences(plan, study),
            note("generations"),
            *comparisons.median_tables(study, findings),
            comparisons.power_table(study, findings[0].size),
        ],
    }
    sections = (
        Section(heading, tuple(item for item in items if item is not None))
        for heading, items in chapters.items()
    )
    return ComparisonReport(
        title=" against ".join(study.names),
        comparability_warnings=study.comparability_warnings,
        sections=tuple(section for section in sections if section.items),
        findings=findings,
        unseen=tuple(unseen),
        scores=rows,
    )


def _questions(study: Comparison, plan: AnalysisPlan, findings: Findings) -> Iterator[Item]:
    for k, family in enumerate(families(study, plan)[1:], 1):
        selected = [f for f in findings if f.family == family.name]
        yield claims.questions_table(f"questions-{k}", family.name, selected, plan.margins)


def _scores(study: Comparison, of_champions: Scores, rows: Sequence[ScoreRow]) -> Iterator[Item]:
    if any(run.constraints for arm in study.arms for run in arm.runs):
        yield champions.constraints_table(study)
    if not of_champions:
        yield note("not-validated")
        return
    validated = note("validated" if scores.VALIDATED in of_champions else "not-validated")
    heading = "Scores of the best robots (points)"
    yield scores.score_table(rows, title=heading, world="Score", notes=(validated,))
    yield profiles.profile_picture(of_champions, label="Points")


def _compared(study: Comparison) -> Iterator[Item]:
    yield Table.of("arms", "Arms", map(_arm, study.arms))
    if all(paired(a, b) for a, b in study.pairs):
        yield note("same-start")
    yield from study.notes
    if study.sources:
        yield f"Runs were read from {', '.join(study.sources)}."


def _arm(arm: Arm) -> Row:
    yield "Arm", arm.name
    yield "selection", arm.selection
    yield "runs", str(len(arm.runs))
    yield "seeds", in_short(sorted(set(arm.seeds)))
    yield "supervisor", ", ".join(sorted({run.supervisor for run in arm.runs}))
    yield "generations", str(arm.generations)
    yield "population", ", ".join(sorted({str(r.flat.get("gp.population")) for r in arm.runs}))


def _beyond(
    study: Comparison, unseen: Sequence[Generalisation], worlds: int
) -> Iterator[Item | None]:
    yield generations.components(study)
    yield champions.components_table(study)
    yield origins.champion_sources_table(study)
    if champions.one_grid(study):
        yield champions.archive_table(study)
        yield generations.archive_by_generation(study)
    if survival := newcomers.lineage(study):
        yield survival
        yield origins.lineage_table(study)
        yield origins.edits_table(study)
        yield origins.sources_table(study)
    if unseen:
        yield champions.generalisation_table(unseen, worlds)
        yield newcomers.generalisation(unseen, study)


def result(study: Comparison, plan: AnalysisPlan, findings: Sequence[Finding]) -> Iterator[str]:
    """A sentence for each pair of arms and measure.

    The measure is the plan's primary endpoint. Without one, there are two: the mean over
    generations of the highest fitness, and the first robot of the easiest milestone.
    """
    without_plan = [MEAN_MAX.key, *(first_emergence(tier).key for tier in study.milestones[:1])]
    for key in without_plan if plan.primary is None else [plan.primary]:
        for a, b in study.pairs:
            f = finding(findings, key, (a.name, b.name))
            p = f.test.p if plan.primary == key and (a, b) == study.pairs[0] else None
            yield _sentence(f, claims.comparison_verdict(f, plan.margins.get(key), p))


def _sentence(f: Finding, verdict: str) -> str:
    cells = dict(claims.estimate_cells(f))
    a, b = f.arms
    if f.never or f.equal:
        return f"{f.measure.label}, {a} minus {b}: {verdict}."
    difference = f"{cells['difference [95 %]']} {cells['unit']}"
    return f"{f.measure.label}, {a} minus {b}: {difference} ({claims.test_name(f)}); {verdict}."
