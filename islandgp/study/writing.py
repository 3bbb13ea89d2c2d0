"""A report's files: page, Markdown, tables, figures, exact numbers."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from html import escape
from pathlib import Path
from string import Template
from typing import Final

from islandgp.study.arms import Comparison
from islandgp.study.data import champions_csv, runs_csv, tests_csv
from islandgp.study.figures.drawing import Picture
from islandgp.study.report import Item, Report, Section
from islandgp.study.table import Table, to_csv, to_html, to_markdown

PAGE: Final = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
:root { --ink: #1d2733; --soft: #5b6875; --line: #d9dfe5; --paper: #f4f1e8; --link: #0b5f94; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.25rem 4rem; max-width: 78rem; color: var(--ink);
  background: #fff; font: 16px/1.55 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .5rem; }
h2 { font-size: 1.3rem; margin: 2.6rem 0 .8rem; padding-top: .6rem;
  border-top: 1px solid var(--line); }
a { color: var(--link); }
nav ul { columns: 18rem; padding-left: 1.2rem; margin: .5rem 0; }
figure { margin: 1.5rem 0; }
figcaption { font-weight: 600; margin-bottom: .4rem; }
figure.picture img { display: block; max-width: 100%; height: auto; margin: 0 auto; }
section > p, .note, figure.picture p { max-width: 60rem; }
figure.picture p, .note { color: var(--soft); font-size: .86rem; margin: .4rem 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .84rem; font-variant-numeric: tabular-nums;
  min-width: 50%; }
th, td { padding: .3rem .45rem; text-align: right; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0;
  background: #fff; min-width: 9rem; }
thead th { border-bottom: 2px solid var(--ink); vertical-align: bottom; }
.paper { background: var(--paper); color: #5d5334; font-style: italic; }
.doubts { border: 2px solid #b3261e; border-radius: 6px; padding: .6rem 1rem; background: #fdf2f1; }
.doubts strong { color: #8c1d18; }
@media print {
  body { max-width: none; font-size: 10pt; padding: 0; }
  nav { display: none; } .scroll { overflow: visible; } table { font-size: 7pt; }
  th, td { padding: .15rem .3rem; }
  figure { break-inside: avoid; } .paper { background: none; }
}
</style>
</head>
<body>
<h1>$title</h1>
$doubts
<nav><ul>
$contents
</ul></nav>
$sections
</body>
</html>
""")


def to_page(report: Report) -> str:
    """The page; its figures are inside as SVG."""
    contents = "\n".join(
        f'<li><a href="#s{i}">{escape(s.title)}</a></li>' for i, s in enumerate(report.sections)
    )
    return PAGE.substitute(
        title=escape(report.title),
        doubts=_doubts(report.doubts),
        contents=contents,
        sections="\n".join(_section(i, s) for i, s in enumerate(report.sections)),
    )


def _doubts(doubts: tuple[str, ...]) -> str:
    if not doubts:
        return ""
    lines = "".join(f"<li>{escape(doubt)}</li>" for doubt in doubts)
    return (
        '<div class="doubts"><strong>These arms are not comparable; the comparison was'
        f" forced.</strong><ul>{lines}</ul></div>"
    )


def _section(i: int, section: Section) -> str:
    body = "\n".join(map(_item, section.items))
    return f'<section><h2 id="s{i}">{escape(section.title)}</h2>\n{body}\n</section>'


def _item(item: Item) -> str:
    if isinstance(item, Table):
        return to_html(item)
    if isinstance(item, Picture):
        data = b64encode(item.svg.encode()).decode()
        return (
            f'<figure class="picture" id="{item.key}"><figcaption>{escape(item.title)}</figcaption>'
            f'<img alt="{escape(item.title)}" src="data:image/svg+xml;base64,{data}">'
            f"<p>{escape(item.caption)}</p></figure>"
        )
    return f"<p>{escape(item)}</p>"


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
