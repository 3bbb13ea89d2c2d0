"""Writes a report's files: page, Markdown, tables, figures, and CSV with exact numbers."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from functools import cache
from math import nan
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

from islandgp.statistics import mean_sd
from islandgp.study.arms import Arm, Comparison, Run
from islandgp.study.emergence import quantile
from islandgp.study.findings import Finding
from islandgp.study.generalise import Generalisation
from islandgp.study.measures import OVERHEAD, Measure, all_measures
from islandgp.study.report import ComparisonReport
from islandgp.study.table import CsvRow, interval_values, known, to_csv, values_csv
from islandgp.study.tables.scores import scores_csv

if TYPE_CHECKING:
    from jinja2 import Template


def to_page(report: ComparisonReport) -> str:
    """The report as an HTML page with embedded SVG figures."""
    return _template("page.html").render(report=report)


def to_markdown(report: ComparisonReport) -> str:
    """The report as Markdown with links to the figures' files."""
    return _template("report.md").render(report=report)


@cache
def _template(name: str) -> Template:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters["unbroken"] = _unbroken
    environment.filters["literal"] = lambda text: text.replace("*", "\\*")
    environment.filters["base64"] = lambda text: b64encode(text.encode()).decode()
    return environment.get_template(name)


def _unbroken(text: str) -> str:
    """A cell in which numbers are not broken at line ends."""
    return re.sub(r" (±|%|:) ?", lambda m: m[0].replace(" ", "\N{NO-BREAK SPACE}"), text)


def write(report: ComparisonReport, study: Comparison, folder: Path) -> list[Path]:
    """Writes the report's files, and keeps other files in the folder. Returns the written paths."""
    files: dict[str, bytes] = {
        "index.html": to_page(report).encode(),
        "report.md": to_markdown(report).encode(),
        "runs.csv": runs_csv(study).encode(),
        "tests.csv": tests_csv(report.findings).encode(),
    }
    if report.scores:
        files["scores.csv"] = scores_csv(report.scores, "score").encode()
    if report.unseen:
        files["champions.csv"] = champions_csv(report.unseen).encode()
    for table in report.tables:
        files[f"tables/{table.key}.csv"] = to_csv(table.columns, table.rows).encode()
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    figures = [path for picture in report.pictures for path in picture.save(folder / "figures")]
    return [*(folder / name for name in files), *figures]


def runs_csv(study: Comparison) -> str:
    """The measures of every run; a cell is empty without emergence or validation."""
    measures = all_measures(study)
    return values_csv(_run_row(arm, run, measures) for arm in study.arms for run in arm.runs)


def _run_row(arm: Arm, run: Run, measures: Sequence[Measure]) -> CsvRow:
    yield "arm", arm.name
    yield "seed", run.seed
    yield "supervisor", run.supervisor
    yield "name", run.name
    yield from ((measure.key, measure.of(run)) for measure in measures)
    yield from ((name, of(run)) for name, of in OVERHEAD.items())
    yield "validation_mean", run.validation_mean


def champions_csv(results: Sequence[Generalisation]) -> str:
    """Best robots in unseen worlds, with paired differences to each reference tree, in points."""
    reference_trees = [g for g in results if g.seed is None]
    return values_csv(_champion_row(g, reference_trees) for g in results if g.seed is not None)


def _champion_row(g: Generalisation, reference_trees: Sequence[Generalisation]) -> CsvRow:
    yield "arm", g.arm
    yield "seed", g.seed
    yield "champion_fitness", g.trained
    yield "worlds", g.worlds
    yield "unseen", g.unseen
    yield "worst", g.worst
    yield from g.reached.items()
    for tree in reference_trees:
        yield from interval_values(f"minus {tree.arm}", g.minus(tree), ", ")


def tests_csv(findings: Sequence[Finding]) -> str:
    """All comparisons. The mean of a sample with censored runs is empty.

    Its median is empty if half of the runs or more are censored.
    """
    return values_csv(map(_finding_row, findings))


def _finding_row(f: Finding) -> CsvRow:
    t, p, emergence = f.rank, f.paired, f.measure.emergence
    yield from zip(("first", "second"), f.arms, strict=True)
    yield "measure", f.measure.key
    yield "unit", f.measure.unit
    yield "family", f.family  # what the adjusted p-values belong to, and its comparisons
    yield "family_size", f.size
    yield from _two("n", t.n)
    for arm, values, sample in zip(("first", "second"), f.numbers, f.samples, strict=True):
        mean, sd = (nan, nan) if None in sample else mean_sd(values)
        yield f"mean_{arm}", known(mean)
        yield f"sd_{arm}", known(sd)
    yield from _two("median", (quantile(sample, 0.5) for sample in f.samples))
    yield from _two("censored", (sample.count(None) for sample in f.samples))
    yield "U", t.u
    yield "z", t.z
    yield "p", t.p
    yield "kind", t.kind
    yield "p_bh", f.rank_q
    yield "r", t.r
    yield "paired_p", p and p.p
    yield "paired_kind", p and p.kind
    yield "paired_p_bh", f.paired_q
    yield "log_rank_p", f.log_rank
    yield "log_rank_p_bh", f.log_rank_q
    # Above 1: sooner in the first arm.
    yield from interval_values("hazard_ratio", f.hazard if emergence else None)
    # For emergence: mean generations lived through without one.
    yield from _two("without", map(fmean, f.numbers) if emergence else (None, None))
    # Of the means, or of the two before, with its 95 % interval.
    yield from interval_values("difference", f.shift)


def _two(name: str, values: Iterable[object]) -> CsvRow:
    return zip((f"{name}_first", f"{name}_second"), values, strict=True)
