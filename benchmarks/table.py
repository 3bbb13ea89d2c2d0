"""Figures beside their goals, for a terminal and for a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from benchmarks.figure import Figure
from benchmarks.results import Result

HEAD: Final = ("figure", "here", "goal", "", "what it is")


def rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """A row of HEAD for each figure; a benchmark that could not run has one with the reason."""
    table_rows: list[tuple[str, ...]] = []
    for result in results:
        if result.missing:
            table_rows.append((result.benchmark, "-", "", "", result.missing))
        table_rows += [_row(figure) for figure in result.figures]
    return table_rows


def _row(figure: Figure) -> tuple[str, ...]:
    goal, verdict = "", ""
    if figure.goal is not None:
        goal = f"{figure.goal.side} {number(figure.goal.value)}"
        verdict = "reached" if figure.goal.reached(figure.value) else "MISSED"
    unit = f" {figure.unit}" if figure.unit else ""
    meaning = f"{figure.what} ({figure.warning})" if figure.warning else figure.what
    return figure.name, f"{number(figure.value)}{unit}", goal, verdict, meaning


def number(value: float) -> str:
    """Three digits, as people write them: 36,000, 12.3, 0.0123."""
    if value == 0:
        return "0"
    if abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) >= 0.001 else f"{value:.1e}"


def conditions(result: Result) -> str:
    """When and on what a benchmark ran."""
    return (
        f"{result.date}, Python {result.python}, {result.cores} cores,"
        f" load {result.load:g} before, {result.effort}"
    )


def as_text(results: Sequence[Result]) -> str:
    """The table for a terminal."""
    lines = [HEAD, *rows(results)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(HEAD) - 1)]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if column == 1 else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(line, [*widths, 0], strict=True))
        ).rstrip()
        for line in lines
    )


def as_markdown(results: Sequence[Result]) -> str:
    """The table for a page: the figures that have a goal."""
    lines = ["| figure | here | goal | | what it is |", "|---|---:|---|---|---|"]
    with_goal = [row for row in rows(results) if row[2] or row[1] == "-"]
    lines += [f"| `{row[0]}` | " + " | ".join(row[1:]) + " |" for row in with_goal]
    return "\n".join(lines)
