"""A report's files: page, Markdown, tables, figures, exact numbers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from islandgp.study.arms import Comparison
from islandgp.study.data import champions_csv, runs_csv, tests_csv
from islandgp.study.figures.style import Picture
from islandgp.study.page import to_page
from islandgp.study.report import Report
from islandgp.study.table import Table, to_csv, to_markdown


def write(report: Report, study: Comparison, folder: Path) -> list[Path]:
    """Writes the report's files; other files of the folder stay. Returns the paths written."""
    files: dict[str, bytes] = {
        "index.html": to_page(report).encode(),
        "report.md": markdown(report).encode(),
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


def markdown(report: Report) -> str:
    """The whole report as Markdown; figures are links to their files."""
    return "\n".join(_blocks(report)).rstrip() + "\n"


def _blocks(report: Report) -> Iterator[str]:
    yield f"# {report.title}\n"
    if report.doubts:
        yield "**These arms are not comparable; the comparison was forced:**\n"
        yield from (f"- {doubt}" for doubt in report.doubts)
        yield ""
    for section in report.sections:
        yield f"## {section.title}\n"
        for item in section.items:
            if isinstance(item, Table):
                yield to_markdown(item)
            elif isinstance(item, Picture):
                yield f"![{item.title}](figures/{item.key}.png)\n"
                yield f"*{item.title}.* {item.caption}\n"
            else:
                yield f"{item}\n"
