"""The report of a comparison: what it says, its page, CSV files and figures."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Final

from islandgp.compare import figures, tables
from islandgp.compare.arms import arms_of_sweep, in_short, named, select_arms
from islandgp.compare.champions import (
    Make,
    TreeResult,
    champion_keys,
    champion_measures,
    evaluate_champions,
    library_trees,
)
from islandgp.compare.comparable import Comparison, compare_arms, shared_seeds
from islandgp.compare.figures import Picture
from islandgp.compare.findings import (
    DEFAULT_PLAN,
    FIRST,
    AnalysisPlan,
    Row,
    check_plan,
    decisive,
    effects,
    examine_all,
    factors,
    families,
    finding,
    parse_plan,
    verdict,
)
from islandgp.compare.measures import MEAN_MAX, OVERHEAD, POINTS, Measure, training_measures
from islandgp.compare.runs import find
from islandgp.compare.table import Table, note, number, probability
from islandgp.records.parameters import short_key
from islandgp.statistics import UNTESTED, smallest_difference

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

Item = Table | Picture | str  # a string is a paragraph

LINES: Final = 3  # results in the terminal
FEW: Final = 4  # most arms, doubts and notes there


@dataclass(frozen=True, slots=True)
class CompareOptions:
    """What to compare, and how."""

    arms: tuple[str, ...] = ()  # NAME=SELECTION, or a printed name; (): those of the sweep
    runs: tuple[Path, ...] = (Path("runs"),)  # folders
    name: str | None = None  # of a sweep
    out: Path | None = None  # folder of the report; None: study/NAME
    primary: str | None = None
    families: tuple[str, ...] = ()
    margins: tuple[str, ...] = ()
    force: bool = False
    worlds: int = 100  # unseen ones; 0: none
    workers: int = 0  # processes; 0: one per core


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the page: a heading with its items."""

    title: str
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """The content of a comparison's report."""

    study: Comparison
    plan: AnalysisPlan
    measures: tuple[Measure, ...]
    rows: tuple[Row, ...]  # of tests.csv
    tested: tuple[TreeResult, ...]  # best robots and library trees in unseen worlds
    sections: tuple[Section, ...]

    @property
    def endpoint(self) -> Measure:
        """The primary endpoint, or the one that is shown first without a plan."""
        keys = [m.key for m in self.measures]
        points = [m.key for m in self.measures if m.unit == POINTS]
        unseen = [key for key in keys if key.startswith("unseen")]
        usual = [*unseen, *([MEAN_MAX.key] if MEAN_MAX.key in keys else points)]
        return self.measures[keys.index(self.plan.primary or [*usual, "diversity_overall"][0])]

    @property
    def question(self) -> str:
        """What the comparison asks."""
        keys = factors(self.study)
        if not keys:
            return f"How do {' and '.join(self.study.names)} differ?"
        names = " and ".join(short_key(key, keys).removesuffix(".name") for key in keys)
        return f"Do {names} matter?" if len(keys) > 1 else f"Does {names} matter?"

    def results(self) -> list[str]:
        """Sentences: the endpoint for each pair of arms, then more of the first pair."""
        pairs = [(a.name, b.name) for a, b in self.study.pairs]
        more = [
            m.key for m in self.measures if (m.emergence and m.main) or m.key.startswith("unseen")
        ]
        chosen = [finding(self.rows, self.endpoint.key, pair) for pair in pairs]
        chosen += [finding(self.rows, key, pairs[0]) for key in more if key != self.endpoint.key]
        return [self._sentence(row) for row in chosen[: max(LINES, len(pairs))]]

    def _sentence(self, row: Row) -> str:
        is_endpoint = row["measure"] == self.endpoint.key
        planned = self.plan.primary == row["measure"] and row["family"] == FIRST
        p, q, test = decisive(row)
        said = verdict(row, self.plan.margins.get(row["measure"]), planned=planned)
        start = f"{row['first']} minus {row['second']}"
        start += "" if is_endpoint else f", {row['label']}"
        if isnan(row["difference"]) or row["paired_kind"] == UNTESTED:
            return f"{start}: {said}"
        value = f"p {probability(p)}" if planned else f"p BH {probability(q)}"
        return f"{start}: {tables.estimate(row)} {row['unit']}, {value} ({test}): {said}"

    def screen(self, folder: Path) -> str:
        """One screen for the terminal."""
        study = self.study
        runs = [
            f"{arm.name} ({len(arm.runs)} runs, seeds {in_short(sorted(set(arm.seeds)))})"
            for arm in study.arms
        ]
        arms = "; ".join(runs[:FEW]) + f"; {len(runs) - FEW} more" * (len(runs) > FEW)
        planned = "planned" if self.plan.primary else "not planned: --primary MEASURE states it"
        results = self.results()
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
    def files(self) -> dict[str, DataFrame]:
        """The CSV files, by name."""
        from pandas import DataFrame

        shown = [i for s in self.sections for i in s.items if isinstance(i, Table)]
        frames = {f"tables/{_file_name(table.key)}.csv": table.frame for table in shown}
        champions = ({**asdict(t), "mean": t.mean, "worst": min(t.points)} for t in self.tested)
        return {
            "runs.csv": runs_frame(self.study, self.measures),
            "tests.csv": DataFrame(list(self.rows)),
            **({"champions.csv": _flat(champions)} if self.tested else {}),
            **frames,
        }


def _flat(rows: Iterable[dict[str, object]]) -> DataFrame:
    """Rows with nested values in columns of their own; without the single worlds."""
    from pandas import json_normalize

    return json_normalize(list(rows)).drop(columns=["points", "perturbed", "own"])


def _file_name(key: str) -> str:
    return re.sub(r"[^\w.+-]+", "-", key).strip("-.")[:100]


def select_study(options: CompareOptions) -> tuple[Comparison, AnalysisPlan, Path]:
    """The chosen arms, the plan, and the folder for the report.

    Raises:
        StudyError: there are no such arms, they are not comparable, or the plan does not fit them.
    """
    plan = parse_plan(options.families, options.primary, options.margins)
    entries = (run for folder in options.runs for run in find(folder))
    runs = list({run.path.resolve(): run for run in entries}.values())
    runs = runs if options.name is None else named(options.name, runs)
    arms, notes = select_arms(options.arms, runs) if options.arms else arms_of_sweep(runs)
    study = compare_arms(arms, force=options.force, notes=notes, sources=[*map(str, options.runs)])
    later = champion_keys(study) if options.worlds else ()
    check_plan(plan, study, [*(m.key for m in study_measures(study)), *later])
    name = "-".join(study.names) if options.arms else str(study.arms[0].runs[0].config["name"])
    return study, plan, options.out or Path("study") / _file_name(name)


def study_measures(study: Comparison, tested: Sequence[TreeResult] = ()) -> tuple[Measure, ...]:
    """The measures that are comparable: no points of training if the arms' tasks differ."""
    training = training_measures(study.classes)
    if not study.same_training:
        training = tuple(m for m in training if m.unit != POINTS)
    return (*training, *champion_measures(study, tested))


def build(
    study: Comparison,
    plan: AnalysisPlan = DEFAULT_PLAN,
    *,
    worlds: int = 0,
    make: Make | None = None,
) -> Report:
    """Build the report.

    Args:
        study: the arms.
        plan: endpoint, families and margins.
        worlds: number of unseen worlds for the best robots and the library's trees.
        make: creates an evaluator for these worlds; None: without them.

    Raises:
        StudyError: the domain cannot be imported, or the plan has another arm or measure.
        EvaluationError: an episode cannot be run.
    """
    tested: tuple[TreeResult, ...] = ()
    if worlds and make is not None:
        trees = library_trees(study)
        tested = evaluate_champions(study, make, worlds=worlds, trees=trees)
    measures = study_measures(study, tested)
    check_plan(plan, study, [m.key for m in measures])
    requested = {plan.primary, *plan.margins}
    examined = tuple(m for m in measures if m.main or m.key in requested)
    rows = tuple(examine_all(study, plan, examined))
    report = Report(study, plan, measures, rows, tested, ())
    sections = (Section(heading, tuple(items(report))) for heading, items in _SECTIONS.items())
    return replace(report, sections=tuple(section for section in sections if section.items))


def _result(report: Report) -> Iterator[Item]:
    yield from report.results()
    if not report.study.same_training:
        yield note("own-fitness")
    if report.tested:
        yield tables.unseen_table(report.study, report.tested)


def _training(report: Report) -> Iterator[Item]:
    study = report.study
    yield figures.curves(study)
    yield tables.arms_table(study)
    if all(shared_seeds(a, b) == a.seeds == b.seeds for a, b in study.pairs):
        yield note("same-start")
    yield from study.notes
    yield f"Runs were read from {', '.join(study.sources)}."


def _factors(report: Report) -> Iterator[Item]:
    chosen = [m for m in report.measures if m.main and (m.emergence or m.unit == POINTS)]
    frame = effects(report.study, [report.endpoint, *(m for m in chosen if m != report.endpoint)])
    if len(frame):
        yield tables.effects_table(frame)


def _differences(report: Report) -> Iterator[Item]:
    for a, b in ((a.name, b.name) for a, b in report.study.pairs):
        rows = [row for row in report.rows if (row["first"], row["second"]) == (a, b)]
        planned = report.plan.primary if (a, b) == report.study.names[:2] else None
        yield tables.differences_table(rows, report.plan.margins, planned or "")
    if report.study.classes.milestones:
        yield figures.first_robots(report.study)


def _unseen(report: Report) -> Iterator[Item]:
    if report.tested:
        yield figures.best_robots(report.study, report.tested)
    yield tables.components_table(report.study)
    yield tables.origins_table(report.study)


def _behaviour(report: Report) -> Iterator[Item]:
    yield tables.behaviours_table(report.study)
    yield tables.decisions_table(report.study)
    yield tables.costs_table(report.study)


def _methods(report: Report) -> Iterator[Item]:
    yield note("methods")
    for name, pairs in families(report.study, report.plan).items():
        yield note("family", name=name, pairs=", ".join(f"{a.name} and {b.name}" for a, b in pairs))
    for n in sorted({(len(a.runs), len(b.runs)) for a, b in report.study.pairs}):
        power = smallest_difference(*n)
        least = probability(power.least_p)
        yield note("power", a=n[0], b=n[1], shift=number(power.shift, 2), least=least)


_SECTIONS: Final[dict[str, Callable[[Report], Iterator[Item]]]] = {
    "Result": _result,
    "Best robots": _unseen,
    "Factors": _factors,
    "Differences (Tables 9 to 12)": _differences,
    "Training": _training,
    "Behaviours, decisions and costs": _behaviour,
    "How the statistics are done": _methods,
}


def runs_frame(study: Comparison, measures: Sequence[Measure]) -> DataFrame:
    """A row per run: its arm, factors, measures and costs; nan without emergence or validation."""
    from pandas import DataFrame

    return DataFrame(
        {
            "arm": arm.name,
            "seed": run.seed,
            "supervisor": run.supervisor,
            "name": str(run.config["name"]),
            **arm.levels,
            "task": study.task(arm.name).label,
            **{measure.key: measure.of(run) for measure in measures},
            **{key: of(run) for key, (_, of) in OVERHEAD.items()},
            "validation_mean": run.validation_mean,  # under its task
        }
        for arm, run in study.runs
    )


def write(report: Report, folder: Path) -> list[Path]:
    """Writes the report's files, and keeps other files in the folder. Returns the written paths."""
    files = {"index.html": to_page(report)}
    files |= {name: frame.to_csv(index=False) for name, frame in report.files.items()}
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
    pictures = [i for s in report.sections for i in s.items if isinstance(i, Picture)]
    drawn = [path for picture in pictures for path in picture.save(folder / "figures")]
    return [*(folder / name for name in files), *drawn]


def to_page(report: Report) -> str:
    """The report as an HTML page with embedded SVG figures."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters["unbroken"] = _unbroken
    environment.filters["base64"] = lambda text: b64encode(text.encode()).decode()
    return environment.get_template("page.html").render(report=report)


def _unbroken(text: str) -> str:
    """A cell in which numbers are not broken at line ends."""
    return re.sub(r" (±|%|:) ?", lambda m: m[0].replace(" ", "\N{NO-BREAK SPACE}"), text)
