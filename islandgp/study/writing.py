"""Writes a report's files: page, Markdown, tables, figures, and CSV with exact numbers."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterable, Sequence
from functools import cache
from math import isnan, nan
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

from islandgp.statistics import Interval, mean_sd
from islandgp.study.arms import Comparison
from islandgp.study.emergence import quantile
from islandgp.study.findings import Finding
from islandgp.study.generalise import Generalisation
from islandgp.study.measures import OVERHEAD, all_measures
from islandgp.study.paper import MARK
from islandgp.study.report import ComparisonReport
from islandgp.study.table import to_csv
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
    environment.globals["mark"] = MARK
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
    rows = []
    for arm in study.arms:
        for run in arm.runs:
            costs = [of(run) for of in OVERHEAD.values()]
            numbers = [m.of(run) for m in measures]
            named = (arm.name, run.seed, run.supervisor, run.name)
            rows.append([*named, *numbers, *costs, run.validation_mean])
    keys = (m.key for m in measures)
    return to_csv(("arm", "seed", "supervisor", "name", *keys, *OVERHEAD, "validation_mean"), rows)


def champions_csv(champions: Sequence[Generalisation]) -> str:
    """Best robots in unseen worlds, with paired differences to each reference tree, in points."""
    reference_trees = [g for g in champions if g.seed is None]
    columns = [
        "arm",
        "seed",
        "champion_fitness",
        "worlds",
        "unseen",
        "worst",
        *champions[0].reached,
    ]
    for y in reference_trees:
        columns += [f"minus {y.arm}{end}" for end in ("", ", low", ", high")]
    rows = []
    for g in champions:
        if g.seed is not None:
            plain = (g.arm, g.seed, g.trained, g.worlds, g.unseen, g.worst)
            row: list[object] = [*plain, *g.reached.values()]
            for y in reference_trees:
                d = g.minus(y)
                row += map(_known, (d.estimate, d.low, d.high))
            rows.append(row)
    return to_csv(columns, rows)


def tests_csv(findings: Sequence[Finding]) -> str:
    """All comparisons. The mean of a sample with censored runs is empty.

    Its median is empty if half of the runs or more are censored.
    """
    rows = [_row(f) for f in findings]
    return to_csv([*rows[0]], [[*row.values()] for row in rows])


def _row(f: Finding) -> dict[str, object]:
    t, p, shift = f.rank, f.paired, f.shift
    hazard = f.hazard if f.measure.emergence else Interval(nan, nan, nan)
    censored_counts = [sample.count(None) for sample in f.samples]
    means = [
        (None, None) if censored else tuple(map(_known, mean_sd(values)))
        for values, censored in zip(f.numbers, censored_counts, strict=True)
    ]
    without = map(fmean, f.numbers) if f.measure.emergence else (None, None)
    return {
        "first": f.arms[0],
        "second": f.arms[1],
        "measure": f.measure.key,
        "unit": f.measure.unit,
        "family": f.family,  # what the adjusted p-values belong to, and its comparisons
        "family_size": f.size,
        **_two("n", t.n),
        "mean_first": means[0][0],
        "sd_first": means[0][1],
        "mean_second": means[1][0],
        "sd_second": means[1][1],
        **_two("median", (quantile(sample, 0.5) for sample in f.samples)),
        **_two("censored", censored_counts),
        "U": t.u,
        "z": t.z,
        "p": t.p,
        "kind": t.kind,
        "p_bh": f.rank_q,
        "r": t.r,
        "paired_p": None if p is None else p.p,
        "paired_kind": None if p is None else p.kind,
        "paired_p_bh": f.paired_q,
        "log_rank_p": f.log_rank,
        "log_rank_p_bh": f.log_rank_q,
        "hazard_ratio": _known(hazard.estimate),  # above 1: sooner in the first arm
        "hazard_ratio_low": _known(hazard.low),
        "hazard_ratio_high": _known(hazard.high),
        **_two("without", without),  # for emergence: mean generations lived through without one
        # Of the means, or of the two before, with its 95 % interval.
        "difference": _known(shift.estimate),
        "difference_low": _known(shift.low),
        "difference_high": _known(shift.high),
    }


def _two(name: str, values: Iterable[object]) -> dict[str, object]:
    return dict(zip((f"{name}_first", f"{name}_second"), values, strict=True))


def _known(x: float) -> float | None:
    """None (an empty cell) for NaN."""
    return None if isnan(x) else x


def metrics(findings: Sequence[Finding]) -> dict[str, float]:
    """Adjusted p-values and effect sizes of a comparison, as metrics of its MLflow run."""
    has_several_pairs = len({f.arms for f in findings}) > 1
    values = {}
    for f in findings:
        name = f"{f.measure.key} {f.arms[0]} {f.arms[1]}" if has_several_pairs else f.measure.key
        values[f"p_bh/{name}"] = f.rank_q
        values[f"r/{name}"] = f.rank.r
    return values
