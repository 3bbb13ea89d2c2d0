"""The paper's own numbers, through the code that compares runs."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from pandas import DataFrame  # type: ignore[import-untyped] # its stubs are a package apart

import islandgp
from islandgp.compare.findings import Row, adjust, examine
from islandgp.compare.measures import FITNESS, SPANS, emergence
from islandgp.statistics import ASYMPTOTIC, EXACT, EXACT_TIES
from studies.paper.claims import lines, published, verdict
from studies.paper.trees import early_injected, late_evolved
from studies.paper.trees import main as draw_trees
from tests.compare.test_statistics import _samples_with
from tests.studies.test_interface import STUDIES

PAPER = published()
FAMILY = (*FITNESS, *map(emergence, PAPER["emergence"]))

ARMS = ("proposed", "baseline")
U = {"fitness_max": 12, "final_fitness_max": 8, "mean_fitness_max": 21, "final_fitness_mean": 1}
"""As Table 9 prints it; Table 10 prints r, from which U = 25 (1 - r) / 2 follows."""


@pytest.fixture(scope="module")
def findings() -> dict[str, Row]:
    """The paper's nine comparisons: Table 11 itself, the others as samples with their U.

    Tied samples are approximated, as the paper does it.
    """
    results = []
    for measure in FAMILY:
        tier = measure.key.removeprefix("first.")
        if tier in PAPER["emergence"]:
            samples = tuple(PAPER["emergence"][tier][arm] for arm in ARMS)
        else:
            row = PAPER["fitness"][measure.key]
            u = U.get(measure.key, round(25 * (1 - row["r"]) / 2))
            a, b = _samples_with(u)
            samples = (tuple(a), tuple(b))  # type: ignore[assignment] # numbers either way
        arms = ("proposed", "baseline")
        results.append(examine(measure, arms, samples, 41, enumerated=0))
    rows = adjust(DataFrame(results).assign(family="")).to_dict("records")
    return {row["measure"]: row for row in rows}


def test_the_claims_of_the_study() -> None:
    """The page is made from the study's tests; the verdicts are those of its analysis."""
    page = "\n".join(lines(STUDIES / "paper/results"))
    assert (STUDIES / "paper/results/claims.md").read_text("utf-8") == f"{page}\n"
    verdicts = re.findall(r"\| ([^|]*) \|$", page.partition("## ")[0], re.MULTILINE)[1:]
    assert verdicts == [
        *("agrees, shown", "agrees, shown", "not shown", "agrees, shown", "agrees, shown"),
        *("agrees, shown", "differs: higher, shown", "differs: higher, shown", "opposite, shown"),
    ]


@pytest.mark.parametrize(
    ("direction", "difference", "p", "expected"),
    [
        (0, 1.0, 0.5, "no difference shown (no evidence either way)"),
        (0, -1.0, 0.01, "differs: lower, shown"),
        (-1, -1.0, 0.01, "agrees, shown"),
        (-1, 1.0, 0.01, "opposite, shown"),
        (1, 1.0, 0.05, "not shown"),
        (1, math.nan, 0.01, "never in either arm"),
    ],
)
def test_verdicts(direction: int, difference: float, p: float, expected: str) -> None:
    """On claims of a higher, a lower or an equal value."""
    row = {"difference": difference, "p_bh": 0.9, "paired_p_bh": p}
    assert verdict(direction, row) == expected


def test_complete_robots_come_71_7_percent_earlier(findings: dict[str, Row]) -> None:
    """Table 11, Complete: means 7.8 and 27.6, r = 1, asymptotic p = 0.0119, p BH = 0.0357."""
    row = findings["first.complete"]
    a, b = row["mean_first"], row["mean_second"]
    assert (a, b) == (pytest.approx(7.8), pytest.approx(27.6))
    assert 1 - a / b == pytest.approx(0.717, abs=5e-4)
    assert (row["kind"], row["r"]) == (ASYMPTOTIC, 1.0)
    assert round(row["p"], 4) == 0.0119
    assert round(row["p_bh"], 4) == 0.0357


def test_table_11_counted_out_agrees() -> None:
    """No run of one arm reaches the other's: 2 of the 252 splits of ten, ties or not."""
    row = PAPER["emergence"]["complete"]
    found = examine(FAMILY[-2], ("a", "b"), (row["proposed"], row["baseline"]), 41)
    assert (found["kind"], found["p"]) == (EXACT_TIES, pytest.approx(2 / 252))


def test_excellent_robots_come_65_2_percent_earlier(findings: dict[str, Row]) -> None:
    """Table 11, Excellent: means 9.6 and 27.6, r = 0.96."""
    row = findings["first.excellent"]
    a, b = row["mean_first"], row["mean_second"]
    assert (a, b) == (pytest.approx(9.6), pytest.approx(27.6))
    assert 1 - a / b == pytest.approx(0.652, abs=5e-4)
    assert row["r"] == pytest.approx(0.96)


@pytest.mark.parametrize("key", [m.key for m in FAMILY if not m.emergence])
def test_tables_9_and_10_come_out_as_printed(key: str, findings: dict[str, Row]) -> None:
    """Exact p, p after Benjamini and Hochberg over the family of nine, and r: to the last digit."""
    found, row = findings[key], PAPER["fitness"][key]
    assert found["kind"] == EXACT
    assert round(found["p"], 3) == row["p"]
    assert round(found["p_bh"], 3) == row["p_bh"]
    assert round(found["r"], 2) == row["r"]


def test_rounding_explains_the_printed_0_0358() -> None:
    """The paper's 0.0358 is what the ninefold family gives when p = 0.01587 is cut to 0.0159."""
    assert round(0.0159 * 9 / 4, 4) == 0.0358
    assert PAPER["emergence"]["complete"]["p_bh"] == 0.0358


def test_the_paper_s_stages_begin_with_the_initial_population() -> None:
    """Table 9's Mean Max Fitness is Table 10's stages weighted 11 : 15 : 15, not 10 : 15 : 16.

    So its "generations 1-10, 11-25, 26-41" are 0-10, 11-25 and 26-40.
    """
    sizes = [len(span.generations(41)) for span in SPANS]
    assert sizes == [11, 15, 15]
    for arm in ("proposed", "baseline"):
        stages = [
            row[arm][0] for key, row in PAPER["fitness"].items() if key.startswith("fitness_max_")
        ]
        mean = PAPER["fitness"]["mean_fitness_max"][arm][0]

        def off(weights: list[int], stages: list[float] = stages, mean_max: float = mean) -> float:
            return abs(sum(w * s for w, s in zip(weights, stages, strict=True)) / 41 / mean_max - 1)

        assert off(sizes) < 0.0012
        assert off([10, 15, 16]) > 0.004


def test_differences_are_those_that_the_paper_prints() -> None:
    """Tables 10 and 12: the printed differences follow from the printed means."""
    for key, difference in (
        ("fitness_max_early", 0.184),
        ("fitness_max_mid", 0.402),
        ("fitness_max_late", 0.002),
    ):
        row = PAPER["fitness"][key]
        assert row["proposed"][0] / row["baseline"][0] - 1 == pytest.approx(difference, abs=6e-4)
    for diversity in PAPER["diversity"].values():
        assert diversity["proposed"] / diversity["baseline"] - 1 == pytest.approx(
            diversity["difference"], abs=1e-3
        )


@pytest.mark.slow
def test_figures_9_and_10(tmp_path: Path) -> None:
    """An injected tree of generation 2 or later, and one that no supervisor gave."""
    small = ("search=paper", "gp.population=8", "gp.generations=6", "world.episode.length=20")
    islandgp.run(*small, "tracking=off", "evaluator=serial", f"runs='{tmp_path}/runs'")
    draw_trees([str(tmp_path / "runs"), str(tmp_path / "out")])
    results = islandgp.load(tmp_path / "runs")
    early = early_injected(results.individuals)
    late = late_evolved(results.individuals, results.generations)
    assert (early["origin"], early["generation"]) == ("injected", 2)
    assert late["tree"] not in set(results.individuals.query("origin == 'injected'")["tree"])
    for n in (9, 10):
        assert "<svg" in (tmp_path / f"out/figure-{n}.svg").read_text("utf-8")
