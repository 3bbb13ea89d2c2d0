"""A report's files: page, Markdown, tables, figures, exact numbers."""

from __future__ import annotations

import re
from base64 import b64encode
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from islandgp.study.arms import Comparison
from islandgp.study.data import champions_csv, runs_csv, tests_csv
from islandgp.study.paper import MARK
from islandgp.study.report import Report
from islandgp.study.table import to_csv

if TYPE_CHECKING:
    from jinja2 import Template


def to_page(report: Report) -> str:
    """The page; its figures are inside as SVG."""
    return _template("page.html").render(report=report)


def to_markdown(report: Report) -> str:
    """The whole report as Markdown; figures are links to their files."""
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
    """A cell whose numbers are kept in one piece where a line wraps."""
    return re.sub(r" (±|%|:) ?", lambda m: m[0].replace(" ", "\N{NO-BREAK SPACE}"), text)


def write(report: Report, study: Comparison, folder: Path) -> list[Path]:
    """Writes the report's files; other files of the folder stay. Returns the paths written."""
    files: dict[str, bytes] = {
        "index.html": to_page(report).encode(),
        "report.md": to_markdown(report).encode(),
        "runs.csv": runs_csv(study).encode(),
        "tests.csv": tests_csv(report.findings).encode(),
    }
    if report.unseen:
        files["champions.csv"] = champions_csv(report.unseen).encode()
    for table in report.tables:
        files[f"tables/{table.key}.csv"] = to_csv(table.columns, table.rows).encode()
    for picture in report.pictures:
        files[f"figures/{picture.key}.svg"] = picture.svg.encode()
        files[f"figures/{picture.key}.png"] = picture.png
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return [folder / name for name in files]
