"""A table as a value, and as Markdown, CSV and HTML."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from islandgp.study.paper import MARK


@dataclass(frozen=True, slots=True)
class Table:
    """Cells are text as people read it; exact numbers are in runs.csv and tests.csv."""

    key: str  # file name without its ending
    title: str
    columns: tuple[str, ...]  # those that begin with paper.MARK hold the paper's figures
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


def to_markdown(table: Table) -> str:
    """A heading, the table, and its notes below it."""
    lines = [
        f"### {table.title}",
        "",
        _row(table.columns),
        _row([":--", *["--:"] * (len(table.columns) - 1)]),
        *map(_row, table.rows),
        "",
        *(f"{_plain(note)}\n" for note in table.notes),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(_plain(cell).replace("|", "\\|") for cell in cells) + " |"


def _plain(text: str) -> str:
    return text.replace("*", "\\*")


def to_csv(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Comma-separated, a header line first."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue()


def to_html(table: Table) -> str:
    """A `figure` with the table and its notes; the paper's columns have a class of their own."""
    theirs = [column.startswith(MARK) for column in table.columns]

    def cells(tag: str, texts: Sequence[str]) -> str:
        return "".join(
            f'<{tag} class="paper">{_cell(text)}</{tag}>'
            if paper
            else f"<{tag}>{_cell(text)}</{tag}>"
            for text, paper in zip(texts, theirs, strict=True)
        )

    body = "\n".join(f"<tr>{cells('td', row)}</tr>" for row in table.rows)
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in table.notes)
    return (
        f'<figure class="table" id="{table.key}"><figcaption>{escape(table.title)}</figcaption>'
        f'<div class="scroll"><table><thead><tr>{cells("th", table.columns)}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>{notes}</figure>"
    )


def _cell(text: str) -> str:
    """Escaped, with the numbers kept in one piece where a line wraps."""
    kept = re.sub(r" (±|%|:) ?", lambda m: m[0].replace(" ", "\N{NO-BREAK SPACE}"), text)
    return escape(kept)
