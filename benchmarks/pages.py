"""Puts the figures into the pages that quote them, so that nobody types a figure.

A page holds `<!-- begin benchmarks -->` and further down `<!-- end -->`; the text between them is
written here.
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
_PART = re.compile(r"(<!-- begin benchmarks -->\n).*?(<!-- end -->)", re.DOTALL)


def with_figures(text: str, results: Sequence[Result]) -> str:
    """A page's text with the figures between its markers."""

    def part(match: re.Match[str]) -> str:
        by_conditions: dict[str, list[str]] = {}
        for r in results:
            by_conditions.setdefault(conditions(r), []).append(f"`{r.benchmark}` {r.seconds:g} s")
        lines = "\n".join(f"- {about}: {', '.join(each)}" for about, each in by_conditions.items())
        return f"{match[1]}{as_markdown(results)}\n\n{lines}\n{match[2]}"

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
