"""A report's files: page, Markdown, tables, figures, exact numbers."""

from __future__ import annotations

from pathlib import Path

from islandgp.study.arms import Comparison
from islandgp.study.data import runs_csv, tests_csv
from islandgp.study.markdown import to_text
from islandgp.study.page import to_page
from islandgp.study.report import Report
from islandgp.study.table import to_csv


def write(report: Report, study: Comparison, folder: Path) -> list[Path]:
    """Writes the report's files; other files of the folder stay. Returns the paths written."""
    files: dict[str, bytes] = {
        "index.html": to_page(report).encode(),
        "report.md": to_text(report).encode(),
        "runs.csv": runs_csv(study).encode(),
        "tests.csv": tests_csv(report.findings).encode(),
    }
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
