"""Puts the results of `make torture` into docs/reliability.md, so that nobody types a figure."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from tests.running.commands import ROOT
from tests.torture.determinism import MATRIX
from tests.torture.faults import FAULTS

FILE: Final = Path(__file__).parent / "results.json"
PAGE: Final = ROOT / "docs" / "reliability.md"


def results() -> list[dict[str, Any]]:
    """The results of the last attempts."""
    rows: list[dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8"))
    return rows


def write_page() -> None:
    """Brings the page up to date."""
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_tables(text, results()), encoding="utf-8")


def with_tables(text: str, all_rows: Sequence[dict[str, Any]]) -> str:
    """A page's text with the tables between its markers `<!-- begin PART -->`, `<!-- end -->`."""

    def part(match: re.Match[str]) -> str:
        rows = [row for row in all_rows if row["part"] == match[1]]
        return f"<!-- begin {match[1]} -->\n{TABLES[match[1]](rows)}\n\n{when(rows)}\n<!-- end -->"

    names = "|".join(TABLES)
    return re.sub(rf"<!-- begin ({names}) -->\n.*?<!-- end -->", part, text, flags=re.DOTALL)


def outcome(row: dict[str, Any]) -> str:
    """The last cell of a row."""
    if row["failure"]:
        return "**broken**"
    return f"not tried: {row['missing']}" if row["missing"] else "held"


def counts(rows: Sequence[dict[str, Any]]) -> str:
    """How many rows held, were broken and could not be tried."""
    broken = sum(bool(row["failure"]) for row in rows)
    untried = sum(bool(row["missing"]) for row in rows if not row["failure"])
    passed = len(rows) - broken - untried
    others = [f"{n} {outcome}" for n, outcome in ((broken, "broken"), (untried, "not tried")) if n]
    return ", ".join([f"{passed} of {len(rows)} rows held", *others])


def when(rows: Sequence[dict[str, Any]]) -> str:
    """When and where a table was made."""
    if not rows:
        return "Not tried yet."
    cases, minutes = sum(row["cases"] for row in rows), sum(row["seconds"] for row in rows) / 60
    first, days = rows[0], sorted({row["date"] for row in rows})
    return (
        f"{counts(rows)}; {cases} commands, {minutes:.0f} minutes in all; {' and '.join(days)},"
        f" Python {first['python']}, {first['cores']} cores."
    )


def faults(rows: Sequence[dict[str, Any]]) -> str:
    """The fault matrix."""
    lines = ["| fault | what happens | lost | commands | slowest end | test | last time |"]
    lines.append("|---|---|---|---:|---:|---|---|")
    for row in rows:
        fault = FAULTS[row["name"]]
        place = fault.attempt.__module__.rpartition(".")[2]
        test = f"`{place}.{fault.attempt.__name__}`"
        cells = (row["name"], fault.happens, fault.lost, row["cases"], f"{row['slowest']:g} s")
        lines.append(f"| {' | '.join(map(str, (*cells, test, outcome(row))))} |")
    return "\n".join(lines)


def kills(rows: Sequence[dict[str, Any]]) -> str:
    """The kill matrix."""
    lines = ["| run | signals | commands | slowest end | |", "|---|---|---:|---:|---|"]
    for row in rows:
        cells = (row["name"], row["figure"], row["cases"], f"{row['slowest']:g} s", outcome(row))
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def ways(rows: Sequence[dict[str, Any]]) -> str:
    """The determinism matrix."""
    lines = ["| what varies | values | runs | digest |", "|---|---|---:|---|"]
    for row in rows:
        same = "equal" if outcome(row) == "held" else outcome(row)
        cells = (row["name"], MATRIX[row["name"]][1], row["cases"], same)
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


def loads(rows: Sequence[dict[str, Any]]) -> str:
    """Long load: second quarter and last quarter."""
    lines = ["| load | figures | |", "|---|---|---|"]
    lines += [f"| {row['name']} | {row['figure']} | {outcome(row)} |" for row in rows]
    return "\n".join(lines)


TABLES: Final = {"faults": faults, "kills": kills, "determinism": ways, "load": loads}
