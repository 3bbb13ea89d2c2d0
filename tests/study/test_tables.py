"""Tables as values and as text."""

from __future__ import annotations

import csv
import io
import math

import pytest

from islandgp.statistics import Interval, mean_sd, rank_test
from islandgp.study.findings import examine
from islandgp.study.measures import TABLE_9, emergence
from islandgp.study.report import ComparisonReport, Section
from islandgp.study.table import (
    Table,
    interval,
    number,
    p_is,
    percent,
    probability,
    spread,
    to_csv,
)
from islandgp.study.tables import claims
from islandgp.study.tables.claims import comparison_verdict
from islandgp.study.tables.comparisons import difference
from islandgp.study.writing import to_markdown, to_page

TABLE = Table(
    "t", "A title", ("Name", "value", "paper* value"), (("a|b", "1,000 ± 2", "<3>"),), ("A note.",)
)
REPORT = ComparisonReport("a against b", (), (Section("Tables", (TABLE, "A paragraph.")),), ())


def test_markdown_escapes_what_would_break_it() -> None:
    """Bars and asterisks in cells stay text."""
    assert to_markdown(REPORT) == (
        "# a against b\n\n## Tables\n\n### A title\n\n"
        "| Name | value | paper\\* value |\n| :-- | --: | --: |\n"
        "| a\\|b | 1,000 ± 2 | <3> |\n\nA note.\n\nA paragraph.\n"
    )


def test_csv_keeps_every_cell() -> None:
    """What is written can be read back."""
    text = to_csv(TABLE.columns, TABLE.rows)
    assert list(csv.reader(io.StringIO(text))) == [list(TABLE.columns), list(TABLE.rows[0])]


def test_html_escapes() -> None:
    """Nothing in a cell is markup."""
    text = to_page(REPORT)
    assert "<td>&lt;3&gt;</td>" in text
    assert "1,000\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}2" in text


def test_how_numbers_are_written() -> None:
    """A real minus sign, no minus zero, small p in more digits."""
    assert number(-1234.4) == "\N{MINUS SIGN}1,234"
    assert number(-0.01) == "0"
    assert number(None) == number(float("nan")) == "\N{EN DASH}"
    assert percent(0.1234) == "+12.3 %"
    assert [probability(p) for p in (0.5, 0.0357, 0.0079, 0.00001)] == [
        "0.500",
        "0.036",
        "0.0079",
        "< 0.0001",
    ]


def test_one_run_has_no_spread() -> None:
    """A dash replaces the deviation and the interval of a single value."""
    dash = "\N{EN DASH}"
    assert spread(*mean_sd([5.0])) == f"5 ± {dash}"
    assert interval(Interval(5.0, math.nan, math.nan)) == f"5 [{dash}]"
    assert interval(Interval(math.nan, -math.inf, math.inf)) == dash
    assert interval(Interval(5.0, 4.0, math.inf)) == "5 [4, \N{INFINITY}]"


def test_a_small_p_in_a_sentence() -> None:
    """It is 'p < 0.0001', without an equals sign."""
    assert p_is(rank_test([1, 2, 3], [4, 5, 6])) == "p = 0.100 (exact)"
    assert p_is(rank_test(range(20), range(20, 40))) == "p < 0.0001 (exact)"


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((1500.0, 1500.0), (900.0, 1100.0), "+50.0 %"),
        ((500.0, 500.0), (900.0, 1100.0), "\N{MINUS SIGN}50.0 %"),
        ((-500.0, -500.0), (-900.0, -1100.0), "\N{EN DASH} (+500 points)"),
        ((12_522.0, 12_522.0), (-2_491.0, -2_691.0), "\N{EN DASH} (+15,113 points)"),
        ((-100.0, -100.0), (900.0, 1100.0), "\N{EN DASH} (\N{MINUS SIGN}1,100 points)"),
        ((500.0, 500.0), (-90.0, 110.0), "\N{EN DASH} (+490 points)"),
        ((5.0, 5.0), (0.0, 0.0), "\N{EN DASH} (+5 points)"),
    ],
)
def test_no_percent_of_nothing(
    first: tuple[float, ...], second: tuple[float, ...], expected: str
) -> None:
    """A share needs two positive means, and a base that is further from zero than its SD."""
    f = examine(TABLE_9[0], ("a", "b"), (first, second), 41, in_pairs=False)
    assert difference(f) == expected


@pytest.mark.parametrize(
    ("differences", "margin", "expected"),
    [
        ((-2.0, 1.0, 2.0, -1.0), 3.0, "alike within ±3"),  # 0 [-2.9, 2.9]
        ((-2.0, 1.0, 2.0, -1.0), 2.5, "not shown"),
        ((-2.0, 1.0, 2.0, -1.0), None, "not shown"),
        (tuple(1 + k / 100 for k in range(8)), 3.0, "higher, shown, but alike within ±3"),
        (tuple(1 + k / 100 for k in range(8)), 1.0, "higher, shown"),
        ((0.0, 0.0, 0.0), 1.0, "equal in every pair"),
    ],
)
def test_alike_is_reported_within_a_margin_only(
    differences: tuple[float, ...], margin: float | None, expected: str
) -> None:
    """The 95 % interval of the paired difference decides, and no test's silence."""
    second = tuple(100.0 + 10 * k for k in range(len(differences)))
    first = tuple(a + b for a, b in zip(second, differences, strict=True))
    f = examine(TABLE_9[0], ("a", "b"), (first, second), 41, in_pairs=True)
    assert comparison_verdict(f, margin) == expected


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((0, 0), (0, 0), ("0, equal in every pair", "\N{EN DASH}")),
        ((3, 4), (0, 0), ("+3.5 [\N{MINUS SIGN}2.9, 9.9]", "\N{EN DASH}")),
        ((3, 4), (7, 7), ("\N{MINUS SIGN}3.5 [\N{MINUS SIGN}9.9, 2.9]", "\N{MINUS SIGN}50.0 %")),
        ((None, None), (None, None), ("never in either arm", "\N{EN DASH}")),
        ((-500, -400), (-900, -1100), None),
    ],
)
def test_an_estimate_is_one_thing(
    first: tuple[int | None, ...], second: tuple[int | None, ...], expected: tuple[str, str] | None
) -> None:
    """Difference, interval and share are of the same means; none in percent of 0 or less."""
    measure = TABLE_9[0] if expected is None else emergence("complete")
    f = examine(measure, ("a", "b"), (first, second), 41, in_pairs=True)
    unit, *cells = (cell for _, cell in claims.estimate_cells(f))
    if expected is None:
        assert (unit, cells[1]) == ("points", "\N{EN DASH}")
    else:
        assert (unit, tuple(cells)) == ("generations without one", expected)


def test_verdict_where_nothing_happened() -> None:
    """Two arms without any emergence have nothing to compare."""
    f = examine(emergence("complete"), ("a", "b"), ((None, None), (None, None)), 41, in_pairs=False)
    assert comparison_verdict(f, None) == "never in either arm"
