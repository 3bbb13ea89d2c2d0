"""Scores by world and arm: rows of a table, and pictures of their profiles."""

from __future__ import annotations

import csv
import io
from math import isnan, nan
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from islandgp.compare.figures import LINES, MARKERS, PALETTE, nth_style, plain
from islandgp.errors import StudyError
from islandgp.statistics import benjamini_hochberg
from studies.comparison.aggregates import (
    improvement_interval,
    improvement_test,
    interquartile_mean,
    stratified_bootstrap,
)
from studies.comparison.profile_figure import WIDTH, profile_picture
from studies.comparison.profiles import ALL_WORLDS, Scores, normalised, summarise
from studies.comparison.score_table import score_table, scores_csv
from studies.pictures import DPI, Table
from tests.profiles import sweep

DASH = "\N{EN DASH}"


def _scores(arms: int = 3, worlds: int = 2, runs: int = 12) -> dict[str, dict[str, list[float]]]:
    """Scores with two peaks, in the k-th world 10**k times as large."""
    rng = np.random.default_rng(1)
    return {
        f"world {k}": {
            f"arm {a}": (10**k * (rng.normal(size=runs) / 8 + (rng.random(runs) < 0.8 - a / 4)))
            .round(3)
            .tolist()
            for a in range(arms)
        }
        for k in range(worlds)
    }


def test_a_row_for_each_arm_in_each_world_and_over_all() -> None:
    """With the aggregates of the module for them, in the order of the mapping."""
    scores = _scores()
    rows = summarise(scores)
    assert [(row.world, row.arm) for row in rows] == [
        (world, f"arm {a}") for world in ("world 0", "world 1", ALL_WORLDS) for a in range(3)
    ]
    assert {row.reference for row in rows} == {"arm 0"}
    one, overall = rows[1], rows[-2]
    assert (one.runs, overall.runs) == (12, 24)
    second, first = ([scores[world][arm] for world in scores] for arm in ("arm 1", "arm 0"))
    assert one.iqm == stratified_bootstrap(second[:1], interquartile_mean)
    assert one.improvement == improvement_interval(second[:1], first[:1])
    assert overall.improvement == improvement_interval(second, first)
    assert overall.test == improvement_test(second, first)
    assert isnan(overall.iqm.estimate)
    assert rows[0].improvement is rows[0].test is rows[0].p_bh is None


def test_p_values_are_adjusted_over_all_tests() -> None:
    """Those over all worlds included."""
    rows = [row for row in summarise(_scores()) if row.test is not None]
    p = [row.test.p for row in rows if row.test is not None]
    assert len(p) == 6
    assert tuple(row.p_bh for row in rows) == benjamini_hochberg(p)


def test_reference_and_pairs_can_be_chosen() -> None:
    """The reference may be any arm; with pairs intervals and tests are those of pairs."""
    scores = _scores(worlds=1)
    rows = summarise(scores, reference="arm 2", paired=True)
    first, reference = [scores["world 0"]["arm 0"]], [scores["world 0"]["arm 2"]]
    assert len(rows) == 3  # one world has no rows over all
    assert rows[2].improvement is None
    assert rows[0].improvement == improvement_interval(first, reference, paired=True)
    assert rows[0].test == improvement_test(first, reference, paired=True)


def test_pooled_rows_need_one_scale() -> None:
    """0 and 1 are at the bounds, and each world then weighs the same."""
    scores = {"a": {"x": [10.0, 20.0] * 5}, "b": {"x": [-1.0, -3.0] * 5}}
    scaled = normalised(scores, {"a": (10, 20), "b": (-1, -3)})
    assert scaled == {"a": {"x": [0.0, 1.0] * 5}, "b": {"x": [0.0, 1.0] * 5}}
    (*_, pooled) = summarise(scaled, pool=True)
    assert (pooled.world, pooled.mean.estimate, pooled.runs) == (ALL_WORLDS, 0.5, 20)
    assert pooled.mean.low < 0.5 < pooled.mean.high


def test_an_arm_may_lack_a_world() -> None:
    """It has rows where it has scores, none over all worlds, and a note on that."""
    scores = _scores()
    del scores["world 1"]["arm 1"]
    rows = summarise(scores)
    assert [row.arm for row in rows if row.world == ALL_WORLDS] == ["arm 0", "arm 2"]
    assert any("arm 1 has no scores in world 1" in note for note in score_table(rows).notes)
    del scores["world 1"]["arm 0"]  # the reference
    rows = summarise(scores)
    assert all(row.improvement is None for row in rows if row.world != "world 0")
    assert [row.world for row in rows] == ["world 0"] * 3 + ["world 1", ALL_WORLDS]


def test_numpy_and_single_scores_are_scores_too() -> None:
    """Arrays serve as lists do; one score has no interval, and a note gives the reason."""
    rows = summarise({"w": {"a": np.array([1.0]), "b": np.array([2.0, 3.0])}})
    assert rows[1].improvement is not None
    assert (rows[1].improvement.estimate, isnan(rows[1].improvement.low)) == (1.0, True)
    table = score_table(rows)
    assert _row(table, 0)[3:] == [f"1.000 [{DASH}]"] * 3 + [DASH] * 3
    assert any("fewer than 10 runs" in note for note in table.notes)


def _row(table: Table, place: int) -> list[str]:
    cells: list[str] = table.frame.to_numpy().tolist()[place]
    return cells


def test_the_table_and_its_csv() -> None:
    """Cells for people, with the digits of their world; exact numbers; nothing is nan."""
    scores: Scores = {"w": {"a": [20_000.0] * 12, "b": [21_000.5] * 12}, "v": {"a": [1.0] * 12}}
    rows = summarise(scores)
    table = score_table(rows, world="World")
    assert list(table.frame.columns[:3]) == ["World", "arm", "runs"]
    assert "P(better than a) [95 %]" in table.frame.columns
    assert _row(table, 1)[3] == "21,000 [21,000, 21,000]"
    assert _row(table, 1)[6:] == [
        "1.00 [1.00, 1.00]",
        "< 0.0001 (exact, ties enumerated)",
        "< 0.0001",
    ]
    assert _row(table, 2)[3] == "1.000 [1.000, 1.000]"
    assert _row(table, 3)[3:6] == [DASH] * 3
    assert any("no common scale" in note for note in table.notes)
    records = list(csv.DictReader(io.StringIO(scores_csv(rows))))
    assert (records[1]["mean"], records[1]["improvement_low"], records[1]["kind"]) == (
        *("21000.5", "1.0", "exact, ties enumerated"),
    )
    assert (records[0]["p"], records[3]["mean"], records[3]["improvement"]) == ("", "", "")
    assert "nan" not in scores_csv(rows)


@pytest.mark.parametrize(
    ("scores", "options", "message"),
    [
        ({}, {}, "Expected scores by world and arm, found none"),
        ({"w": {}}, {}, "Expected scores by world and arm, found none"),
        ({"w": [1.0, 2.0]}, {}, "Expected scores by world and arm, found a world without arms"),
        ({"w": {"a": [1.0], 30: [2.0]}}, {}, "Expected names .* as text, found 30"),
        ({"w": {"a": [1.0], "b": ["x"]}}, {}, "b in w: Expected scores as lists of numbers"),
        ({"w": {"a": []}}, {}, "a in w: Expected 1 to 10,000 scores"),
        ({"w": {"a": [1.0], "b": [nan]}}, {}, "b in w: Expected finite scores of .*, found nan"),
        (
            {"w": {"a": [1.0]}},
            {"reference": "c"},
            "Expected a reference among the arms a, found",
        ),
        ({"w": {"a": [1.0], "b": [1.0, 2.0]}}, {"paired": True}, "b in w: Expected as many scores"),
        ({"w": {"a": [1.0]}, ALL_WORLDS: {"a": [1.0]}}, {}, "Expected another name than 'all worl"),
    ],
)
def test_wrong_scores_are_refused(scores: Scores, options: dict[str, object], message: str) -> None:
    """With the arm and the world."""
    with pytest.raises(StudyError, match=message):
        summarise(scores, **options)  # type: ignore[arg-type] # one of several keywords


@pytest.mark.parametrize("bounds", [{}, {"w": (1.0, 1.0)}, {"w": (0.0, nan)}])
def test_wrong_bounds_are_refused(bounds: dict[str, tuple[float, float]]) -> None:
    """Where a world has none, or no width."""
    with pytest.raises(StudyError, match="Expected two finite and different bounds for w"):
        normalised({"w": {"a": [1.0]}}, bounds)


def test_a_picture_of_profiles(tmp_path: Path) -> None:
    """SVG and PNG under its name."""
    picture = profile_picture(_scores(), pool=True, key="mine")
    assert [file.name for file in picture.save(tmp_path / "new")] == ["mine.svg", "mine.png"]
    assert (tmp_path / "new" / "mine.png").read_bytes().startswith(b"\x89PNG")
    assert int.from_bytes(picture.png[16:20], "big") == int(WIDTH * DPI)
    ElementTree.fromstring(picture.svg)
    assert "Share of an arm's runs" in picture.caption


@sweep(
    "scores",
    [
        {"w": {"a": [1.0]}},
        {"w": {"a": [5.0] * 12, "b": [5.0] * 12}},
        {"w": {"a": [-1e100] * 12}, "v": {"a": [1e6, 1e6 + 1e-9] * 6}},
        {"w": {"a": [-1e100, 1e100] * 6}},
        {"w": {"_a$b$": [1.0, 2.0], "$": [-1e9, 1e9]}, "$v": {"$": [1e-9]}},
        {
            f"world {k}": {f"a rather long name of an arm, {a}": [a + k] for a in range(20)}
            for k in range(5)
        },
    ],
    quick=1,
)
def test_any_scores_have_a_picture(scores: Scores) -> None:
    """One score, equal ones, names with signs of formulas, many arms, arms that lack a world."""
    assert profile_picture(scores, pool=True).png.startswith(b"\x89PNG")


def test_names_are_shown_as_they_are() -> None:
    """Matplotlib leaves out what begins with an underscore, and sets math between $."""
    assert [plain(name) for name in ("a", "_a", "a$b$")] == ["a", " _a", r"a\$b\$"]


def test_no_two_arms_look_alike() -> None:
    """Sixty-four differ, eight of them by the line alone, for pictures in grey."""
    assert len({tuple(nth_style(i).values()) for i in range(64)}) == 64
    assert len({nth_style(i)["linestyle"] for i in range(8)}) == len(LINES) == 8
    assert len({nth_style(i)["color"] for i in range(8)}) == len(PALETTE)
    assert nth_style(0)["marker"] != nth_style(8)["marker"]
    assert len(set(MARKERS)) == 8


@pytest.mark.slow
def test_the_documented_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's program runs unchanged, and makes the files that the page names."""
    page = (Path(__file__).parents[2] / "studies" / "comparison" / "README.md").read_text(
        encoding="utf-8"
    )
    code = page.partition("```python\n")[2].partition("```")[0]
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(code, names)  # it is ours
    assert (tmp_path / "scores.csv").read_text().startswith("world,arm,runs,mean")
    assert {file.name for file in (tmp_path / "figures").iterdir()} == {
        "profiles.svg",
        "profiles.png",
    }
    (*_, last, _) = names["rows"]  # type: ignore[misc] # rows of summarise
    assert (last.world, last.arm) == (ALL_WORLDS, "expert")
    assert last.iqm.low < last.iqm.estimate
