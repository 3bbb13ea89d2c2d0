"""A report as Markdown."""

from __future__ import annotations

from collections.abc import Iterator

from islandgp.study.figures.style import Picture
from islandgp.study.report import Report
from islandgp.study.table import Table, to_markdown


def to_text(report: Report) -> str:
    """The whole report; figures are links to their files."""
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
