"""From figures to a table, a file and pages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import pages, results
from benchmarks.__main__ import main
from benchmarks.figure import Effort, Figure, at_least, at_most
from benchmarks.growth import Growth
from benchmarks.results import Result
from benchmarks.table import as_markdown, as_text, number
from benchmarks.turns import medians, ratio, turns

FAST = Figure("fast_us", 1.234, "us", "a tick", at_most(2.0))
WEAK = Figure("power", 0.5, "", "its power", at_least(0.9), warning="odd")
PLAIN = Figure("paper_s", 36000.0, "s", "a run")


def result(*figures: Figure, missing: str = "") -> Result:
    """Figures that were measured on a day of this test's choice."""
    measured = results.result("b", figures, effort=Effort.FULL, seconds=3.21, load=0.123)
    return replace(measured, date="2026-01-02", python="3.11.0", cores=4, missing=missing)


def test_text() -> None:
    """Goals and verdicts are beside the figures; a warning is shown."""
    assert as_text([result(FAST, WEAK, PLAIN)]).splitlines() == [
        "figure       here  goal                   what it is",
        "fast_us   1.23 us  at most 2     reached  a tick",
        "power         0.5  at least 0.9  MISSED   its power (odd)",
        "paper_s  36,000 s                         a run",
    ]


def test_markdown() -> None:
    """The figures with a goal as rows of a Markdown table."""
    lines = as_markdown([result(FAST, PLAIN)]).splitlines()
    assert lines[2:] == ["| `fast_us` | 1.23 us | at most 2 | reached | a tick |"]


def test_a_benchmark_that_cannot_run_is_a_row() -> None:
    """It is in the table with the reason."""
    assert "| `b` | - |  |  | deap is not there |" in as_markdown(
        [result(missing="deap is not there")]
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (36000, "36,000"),
        (99.96, "100"),
        (12.34, "12.3"),
        (0.0421, "0.0421"),
        (2e-6, "2.0e-06"),
    ],
)
def test_number(value: float, text: str) -> None:
    """Three digits."""
    assert number(value) == text


def test_results_keep_what_was_not_measured_again(tmp_path: Path) -> None:
    """A benchmark measured alone takes its own place and no other's."""
    file = tmp_path / "results.json"
    first, other = result(FAST), replace(result(PLAIN), benchmark="c")
    results.save([first, other], file)
    results.save([result(WEAK)], file)
    assert results.load(file) == [result(WEAK), other]


def test_pages_hold_the_figures() -> None:
    """Only the text between the markers is written, and writing again changes nothing."""
    page = "Before\n<!-- begin benchmarks -->\nold\n<!-- end -->\nAfter\n"
    filled = pages.with_figures(page, [result(FAST, PLAIN)])
    assert filled.startswith("Before\n<!-- begin benchmarks -->\n| figure |")
    assert "| a tick |\n" in filled
    assert filled.endswith("3.2 s\n<!-- end -->\nAfter\n")
    assert pages.with_figures(filled, [result(FAST, PLAIN)]) == filled
    assert "- 2026-01-02, Python 3.11.0, 4 cores, load 0.12 before, full: `b` 3.2 s" in filled


def test_the_pages_quote_the_results() -> None:
    """The figures in the pages are those of benchmarks/results.json."""
    saved = results.load(results.FILE)
    texts = {page: page.read_text(encoding="utf-8") for page in pages.PAGES}
    for page, text in texts.items():
        assert pages.with_figures(text, saved) == text, (
            f"python -m benchmarks --write-docs ({page})"
        )
    assert "<!-- begin benchmarks -->" in texts[pages.PAGES[0]]


def test_an_unknown_name(capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, and the names there are."""
    with pytest.raises(SystemExit) as stopped:
        main(["engine"])
    assert stopped.value.code == 2
    assert "there is no benchmark engine; there are engine_ratio, " in capsys.readouterr().err


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The table is printed, and results are written to `--out`."""
    out = tmp_path / "r.json"
    assert main(["engine_ratio", "--tiny", "--out", str(out)]) == 0
    assert "all-rounder's episode of 100 steps" in capsys.readouterr().out
    (saved,) = results.load(out)
    assert (saved.benchmark, saved.effort, saved.missing) == ("engine_ratio", "tiny", "")


def test_turns_alternate() -> None:
    """Sides run A B, B A, ...; rows keep their places, and a ratio is taken within a row."""
    ran, now = [], [0.0]

    def side(name: str, seconds: float) -> None:
        ran.append(name)
        now[0] += seconds

    rows = turns([lambda: side("a", 4), lambda: side("b", 2)], 3, clock=lambda: now[0])
    assert "".join(ran) == "abbaab"
    assert rows == [(4, 2)] * 3
    assert medians([(1, 1), (3, 2), (20, 2)]) == [3, 2]
    assert ratio([(1, 1), (3, 2), (20, 2)], 0, 1) == 1.5


def test_growth() -> None:
    """Linear growth has power 1, for any cost of one thing; square growth 2."""
    linear, square = Growth([10, 20, 40], [1, 2, 4]), Growth([10, 20, 40], [1, 4, 16])
    assert (linear.exponent, linear.per_item) == (1, 0.1)
    assert square.exponent == 2
