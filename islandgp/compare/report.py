"""The report of a comparison: what it says, its page, CSV files and figures."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.compare import champions, figures, findings, tables
from islandgp.compare.arms import arms_of_sweep, find, in_short, select_arms
from islandgp.compare.comparable import Comparison, compare_arms, shared_seeds
from islandgp.compare.findings import Row
from islandgp.compare.measures import COSTS, MEAN_MAX, POINTS, Measure, training_measures
from islandgp.records.parameters import short_key
from islandgp.statistics import LEVEL, UNTESTED, detectable_shift, least_p
from islandgp.viewer.page import filled

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

LINES: Final = 3  # results in the terminal
TEMPLATES: Final = Path(__file__).parent / "templates"
FEW: Final = 4  # most arms, doubts and notes there


@dataclass(frozen=True, slots=True)
class CompareOptions:
    """What to compare, and how."""

    runs: tuple[Path, ...] = ()  # folders
    folders: tuple[Path, ...] = ()  # more of them; without any: runs
    name: str | None = None  # of a sweep
    arms: tuple[str, ...] = ()  # NAME=SELECTION, or a printed name; (): those of the sweep
    out: Path | None = None  # folder of the report; None: study/NAME
    primary: str | None = None
    force: bool = False
    worlds: int = 100  # unseen ones; 0: none
    workers: int = 0  # processes; 0: one per core


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """The content of a comparison's report."""

    study: Comparison
    primary: str | None  # key of the measure that is the primary endpoint
    measures: tuple[Measure, ...]
    rows: DataFrame  # of tests.csv
    champions: DataFrame | None  # best robots and library trees in unseen worlds
    worlds: int  # number of these
    tables: dict[str, DataFrame] = field(default_factory=dict)  # of texts, by key
    figures: dict[str, str] = field(default_factory=dict)  # SVG by key

    @property
    def endpoint(self) -> Measure:
        """The primary endpoint, or the one that is shown first without a plan."""
        keys = [m.key for m in self.measures]
        points = [m.key for m in self.measures if m.unit == POINTS]
        unseen = [key for key in keys if key.startswith("unseen")]
        usual = [*unseen, *([MEAN_MAX.key] if MEAN_MAX.key in keys else points)]
        return self.measures[keys.index(self.primary or [*usual, "mean_diversity"][0])]

    @property
    def question(self) -> str:
        """What the comparison asks."""
        keys = findings.factors(self.study)
        if not keys:
            return f"How do {' and '.join(self.study.names)} differ?"
        names = " and ".join(short_key(key, keys).removesuffix(".name") for key in keys)
        return f"Do {names} matter?" if len(keys) > 1 else f"Does {names} matter?"

    @property
    def results(self) -> list[str]:
        """Sentences: the endpoint for each pair of arms, then more of the first pair."""
        pairs = [(a.name, b.name) for a, b in self.study.pairs]
        more = [
            m.key for m in self.measures if (m.emergence and m.main) or m.key.startswith("unseen")
        ]
        chosen = [findings.row_of(self.rows, self.endpoint.key, pair) for pair in pairs]
        chosen += [
            findings.row_of(self.rows, key, pairs[0]) for key in more if key != self.endpoint.key
        ]
        return [self._sentence(row) for row in chosen[: max(LINES, len(pairs))]]

    def _sentence(self, row: Row) -> str:
        is_endpoint = row["measure"] == self.endpoint.key
        planned = self.primary == row["measure"] and row["family"] == findings.FIRST
        p, q, test = findings.decisive(row)
        said = findings.verdict(row, planned=planned)
        start = f"{row['first']} minus {row['second']}"
        start += "" if is_endpoint else f", {row['label']}"
        if isnan(row["difference"]) or row["paired_kind"] == UNTESTED:
            return f"{start}: {said}"
        value = f"p {tables.probability(p)}" if planned else f"p BH {tables.probability(q)}"
        return f"{start}: {tables.estimate(row)} {row['unit']}, {value} ({test}): {said}"

    def screen(self, folder: Path) -> str:
        """One screen for the terminal."""
        study, results = self.study, self.results
        runs = [
            f"{arm.name} ({len(arm.runs)} runs, seeds {in_short(sorted(set(arm.seeds)))})"
            for arm in study.arms
        ]
        arms = "; ".join(runs[:FEW]) + f"; {len(runs) - FEW} more" * (len(runs) > FEW)
        planned = "planned" if self.primary else "not planned: --primary MEASURE states it"
        doubts = [f"Not comparable: {doubt}" for doubt in study.comparability_warnings]
        lines = [
            *doubts[:FEW],
            f"Question: {self.question}",
            f"Arms: {arms}",
            f"Endpoint: {self.endpoint.label} ({planned})",
            *(f"  {line}" for line in results[:LINES]),
        ]
        if len(results) > LINES:
            lines.append(f"  {len(results) - LINES} more pairs are in the report.")
        if not study.same_training:
            tasks = f"; the report has all best robots under {len(study.tasks)} tasks"
            lines.append(
                "Points of training under different rewards, worlds or curricula are not compared"
                f"{tasks * (len(study.tasks) > 1)}."
            )
        notes = [line for line in study.notes if not line.startswith("The arms differ in")]
        return "\n".join([*lines, *notes[:FEW], f"Report: {folder / 'index.html'}"])

    @property
    def power(self) -> list[str]:
        """What tests of two arms can show, by their numbers of runs and pairs."""
        sizes = {(len(shared_seeds(a, b)), len(a.runs), len(b.runs)) for a, b in self.study.pairs}
        lines = []
        for pairs, *n in sorted(sizes):
            least = least_p(pairs) if pairs else least_p(*n)
            text = f"With {pairs} pairs" if pairs else f"With {n[0]} and {n[1]} runs"
            text += f", the least p of a test is {tables.probability(least)}"
            if least < LEVEL:
                shift = detectable_shift(pairs) if pairs else detectable_shift(*n)
                text += f"; it finds a shift of {shift:.2g} standard deviations with 80 % power"
            lines.append(f"{text}. Smaller differences may exist without being shown.")
        return lines

    @property
    def files(self) -> dict[str, str]:
        """The contents of the files, by name."""
        columns = ["arm", "seed", "task", "supervisor", "name", *findings.factors(self.study)]
        columns += [*(m.key for m in self.measures), *COSTS, "validation_mean"]
        runs = self.study.runs
        frames = {
            "runs.csv": runs[[name for name in dict.fromkeys(columns) if name in runs]],
            "tests.csv": self.rows,
            **(
                {}
                if self.champions is None
                else {"champions.csv": self.champions.drop(columns=["tree", "own"])}
            ),
            **{f"tables/{_file_name(key)}.csv": table for key, table in self.tables.items()},
        }
        return {
            "index.html": filled("page.html", folder=TEMPLATES, report=self, study=self.study),
            **{name: frame.to_csv(index=False) for name, frame in frames.items()},
            **{f"figures/{key}.svg": svg for key, svg in self.figures.items()},
        }


def _file_name(key: str) -> str:
    return re.sub(r"[^\w.+-]+", "-", key).strip("-.")[:100]


def select_study(options: CompareOptions) -> tuple[Comparison, Path]:
    """The chosen arms, and the folder for the report.

    Raises:
        StudyError: there are no such arms, they are not comparable, or have no such endpoint.
        RunError: a run is damaged.
    """
    folders = (*options.runs, *options.folders) or (Path("runs"),)
    runs = find(folders, options.name)
    arms, notes = select_arms(options.arms, runs) if options.arms else arms_of_sweep(runs)
    study = compare_arms(arms, force=options.force, notes=notes)
    measures = study_measures(study, with_worlds=options.worlds > 0)
    findings.check_primary(options.primary, measures)
    name = "-".join(study.names) if options.arms else str(study.arms[0].runs[0].config["name"])
    return study, options.out or Path("study") / _file_name(name)


def study_measures(study: Comparison, *, with_worlds: bool) -> tuple[Measure, ...]:
    """The comparable measures of training (no points if the arms' tasks differ), and of champions.

    `with_worlds`: best robots are evaluated in unseen worlds.
    """
    measures = training_measures(study.classes)
    trained = (m for m in measures if study.same_training or m.unit != POINTS)
    return (*trained, *(champions.champion_measures(study) if with_worlds else ()))


def build(
    study: Comparison,
    primary: str | None = None,
    *,
    worlds: int = 0,
    make: champions.Make | None = None,
) -> Report:
    """Build the report.

    Args:
        study: the arms.
        primary: key of the measure that is the primary endpoint; None: none was planned.
        worlds: number of unseen worlds for the best robots and the library's trees.
        make: creates an evaluator for these worlds; None: without them.

    Raises:
        StudyError: the domain cannot be imported, or there is no such measure.
        EvaluationError: an episode cannot be run.
    """
    tested = None
    if worlds and make is not None:
        trees: dict[str, str] = {}
        for arm in study.arms:
            trees |= champions.library_trees(arm.runs[0].config)
        tested = champions.evaluate_champions(study, make, worlds=worlds, trees=trees)
        study = replace(study, runs=champions.with_champions(study, tested))
    measures = study_measures(study, with_worlds=tested is not None)
    findings.check_primary(primary, measures)
    rows = findings.examine_all(study, [m for m in measures if m.main or m.key == primary])
    report = Report(study, primary, measures, rows, tested, worlds)
    report.tables.update(_tables(report))
    report.figures["curves"] = figures.curves(study)
    if study.classes.milestones:
        report.figures["first-robots"] = figures.first_robots(study)
    if tested is not None:
        report.figures["best-robots"] = figures.best_robots(study, tested)
    return report


def _tables(report: Report) -> dict[str, DataFrame]:
    study, rows = report.study, report.rows
    found = {
        "arms": tables.arms_table(study),
        "components": tables.components_table(study),
        "origins": tables.origins_table(study),
        "behaviours": tables.behaviours_table(study),
        "costs": tables.costs_table(study),
    }
    for a, b in study.pairs:
        of_pair = rows[(rows["first"] == a.name) & (rows["second"] == b.name)]
        planned = report.primary if (a.name, b.name) == study.names[:2] else None
        found[f"differences {a.name} {b.name}"] = tables.differences_table(of_pair, planned)
    if report.champions is not None:
        found["unseen"] = tables.unseen_table(study, report.champions)
    chosen = [m for m in report.measures if m.main and (m.emergence or m.unit == POINTS)]
    endpoint = report.endpoint
    changes = findings.effects(study, [endpoint, *(m for m in chosen if m != endpoint)])
    return found | ({"effects": tables.effects_table(changes)} if len(changes) else {})


def write(report: Report, folder: Path) -> list[Path]:
    """Writes the report's files, and keeps other files in the folder. Returns the written paths."""
    paths = {folder / name: content for name, content in report.files.items()}
    for path, content in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    return [*paths]
