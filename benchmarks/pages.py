"""Puts the figures into the pages that quote them, so that nobody types a figure.

A page holds `<!-- begin benchmarks -->` or `<!-- begin goals -->`, and further
down `<!-- end -->`; what stands between them is written here.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from benchmarks.results import Result
from benchmarks.table import as_markdown, conditions

ROOT: Final = Path(__file__).resolve().parent.parent
PAGES: Final = (ROOT / "docs" / "performance.md",)
_PART = re.compile(r"(<!-- begin (benchmarks|goals) -->\n).*?(<!-- end -->)", re.DOTALL)


def with_figures(text: str, results: Sequence[Result]) -> str:
    """A page's text with the figures between its markers."""

    def part(match: re.Match[str]) -> str:
        goals_only = match[2] == "goals"
        table = as_markdown(results, goals_only=goals_only)
        if goals_only:
            return f"{match[1]}{table}\n{match[3]}"
        lines = "\n".join(f"- `{r.benchmark}`: {conditions(r)}" for r in results)
        return f"{match[1]}{table}\n\n{lines}\n{match[3]}"

    return _PART.sub(part, text)


def write_pages(results: Sequence[Result]) -> list[Path]:
    """Brings the pages that have markers up to date; returns them."""
    changed = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8") if page.exists() else ""
        if _PART.search(text):
            page.write_text(with_figures(text, results), encoding="utf-8")
            changed.append(page)
    return changed
