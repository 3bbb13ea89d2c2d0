"""The whole report, on runs made by hand."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from islandgp.errors import StudyError
from islandgp.statistics import Interval
from islandgp.study import writing
from islandgp.study.aggregates import EXACT_PAIRS
from islandgp.study.arms import Comparison
from islandgp.study.comparable import compare_arms
from islandgp.study.figures.drawing import Picture
from islandgp.study.generalise import Generalisation
from islandgp.study.plan import DEFAULT_PLAN, check_plan, families, parse_plan
from islandgp.study.report import ComparisonReport, build
from islandgp.study.table import Table
from islandgp.study.tables.scores import champion_rows, champion_scores
from islandgp.study.writing import to_page, write
from tests.study.fake_runs import TREE, fake_arm, fake_run, guidance, individual


def _study(*names: str, force: bool = False) -> Comparison:
    arms = []
    for k, name in enumerate(names):
        runs = []
        for seed in range(4):
            rng = np.random.default_rng([k, seed])
            best = (10_000 * (2 - k) + 500 * rng.normal(size=41).cumsum()).tolist()
            guided = guidance(
                pattern="healthy_progress" if name == "expert" else None,
                phase="refinement" if name == "expert" else None,
                tree=TREE,
                target="pickup",
                injected=name == "expert",
            )
            populations = [
                [
                    individual(f"{g}.0", "elite", [f"{g - 1}.0"] if g else [], fitness=best[g]),
                    individual(f"{g}.1", "injected" if name == "expert" else "random"),
                ]
                for g in range(41)
            ]
            late = None if name == "baseline" and seed == 3 else 5 + 10 * k + seed
            runs.append(
                fake_run(
                    name,
                    seed,
                    best=best,
                    complete=late,
                    excellent=None if name == "baseline" else 20 + seed,
                    populations=populations,
                    guided=guided,
                    world__side=200 if force and name == "baseline" else 300,
                )
            )
        arms.append(fake_arm(name, runs))
    return compare_arms(arms, force=force)


HALF = {"complete": 0.5, "excellent": 0.1}
UNSEEN = (
    *(
        Generalisation(arm, seed, 20_000.0 + seed, (9_000.0, 21_000.0 + 20 * seed), HALF)
        for arm in ("expert", "baseline")
        for seed in range(4)
    ),
    Generalisation("library: all_rounder", None, None, (9_000.0, 30_000.0, 21_000.0), HALF),
)


def _write(folder: Path) -> tuple[ComparisonReport, Path]:
    """Writes a report of two arms with a censored run; returns it and its folder."""
    study = _study("expert", "baseline")
    report = build(study, UNSEEN, 30)
    write(report, study, folder)
    return report, folder


@pytest.fixture(scope="module")
def report_and_folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[ComparisonReport, Path]:
    """As `_write`, with figures that are not rendered."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
        return _write(tmp_path_factory.mktemp("report"))


def test_every_table_and_figure_of_the_paper_is_there(
    report_and_folder: tuple[ComparisonReport, Path],
) -> None:
    """Tables 9-14, Figures 4-8, and those beyond the paper."""
    report, _ = report_and_folder
    tables, pictures = {t.key for t in report.tables}, {p.key for p in report.pictures}
    assert {f"table-{n}" for n in range(9, 15)} | {"table-11-runs"} <= tables
    assert {"medians", "power", "lineage", "sources", "generalisation"} <= tables
    assert {f"figure-{n}" for n in range(4, 9)} <= pictures
    assert {"components", "classes", "diversity", "lineage", "emergence-curves"} <= pictures


def test_the_result_is_at_the_top(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """A sentence for fitness and one for first robots, then the curves; arms are named once."""
    report, folder = report_and_folder
    first = report.sections[0]
    *sentences, picture = first.items
    assert first.title == "Result"
    assert [str(s).partition(",")[0] for s in sentences] == [
        "Mean Max Fitness",
        "First Complete Robot",
    ]
    assert all("expert minus baseline" in str(s) for s in sentences)
    assert isinstance(picture, Picture)
    assert "expert expert" not in (folder / "report.md").read_text()


@pytest.mark.slow
def test_files_of_the_report(tmp_path: Path) -> None:
    """A page, Markdown, a CSV for each table, SVG and PNG for each figure but trees.

    The same runs give the same bytes: no date, no chance.
    """
    (report, folder), (_, other_folder) = _write(tmp_path / "a"), _write(tmp_path / "b")
    for path in (p for p in folder.rglob("*") if p.is_file()):
        assert (other_folder / path.relative_to(folder)).read_bytes() == path.read_bytes(), (
            path.name
        )
    assert all((folder / f"tables/{t.key}.csv").stat().st_size for t in report.tables)
    for picture in report.pictures:
        assert (folder / f"figures/{picture.key}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (folder / f"figures/{picture.key}.svg").read_text()
    links = re.findall(r"\]\((figures/[^)]+)\)", (folder / "report.md").read_text())
    assert sorted(links) == sorted(f"figures/{p.key}.png" for p in report.pictures)
    assert all((folder / link).exists() for link in links)


def test_the_page_needs_no_other_file(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """Figures are inside; nothing is loaded from anywhere."""
    page = (report_and_folder[1] / "index.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources
    assert all(s.startswith(("data:image/svg+xml;base64,", "#")) for s in sources)
    assert "<script" not in page


def test_never_is_never_a_number(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """The run without a Complete Robot is 'never' in Table 11 and empty in runs.csv."""
    report, folder = report_and_folder
    table = next(t for t in report.tables if t.key == "table-11-runs")
    assert table.rows[3][table.columns.index("baseline: Complete")] == "never"
    with (folder / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["first_complete"] for r in rows if r["arm"] == "baseline"] == ["15", "16", "17", ""]


def test_exact_numbers_of_the_tests(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """tests.csv has the fourteen of the family and the further one, with kinds."""
    with (report_and_folder[1] / "tests.csv").open() as file:
        rows = {r["measure"]: r for r in csv.DictReader(file)}
    assert len(rows) == 15
    first = rows["first_complete"]
    assert (first["U"], first["kind"], first["censored_second"]) == ("0.0", "exact", "1")
    assert first["mean_second"] == ""
    assert first["median_second"] == "16.5"  # of 15 16 17 and never
    assert (first["without_first"], first["without_second"]) == ("6.5", "22.25")  # never: 41
    assert first["difference"] == "-15.75"
    half = 3.182446 * 11.5 / 2  # pairs -10 -10 -10 -33: SD 11.5, t of three degrees of freedom
    assert float(first["difference_low"]) == pytest.approx(-15.75 - half)
    assert float(first["difference_high"]) == pytest.approx(-15.75 + half)
    assert rows["max_ever"]["without_first"] == ""
    assert rows["first_excellent"]["median_second"] == ""
    assert rows["max_ever"]["paired_kind"] == "exact"


def test_medians_with_censored_runs(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """Never counts as infinite: both arms have an interval, and so has their difference."""
    table = next(t for t in report_and_folder[0].tables if t.key == "medians")
    rows = {row[0]: row[1:4] for row in table.rows}
    first, second, difference = rows["First Complete Robot"]
    assert (first, second) == ("6.5 [\N{EN DASH}]", "16.5 [\N{EN DASH}]")  # four runs
    assert difference == "\N{MINUS SIGN}10.0 [\N{EN DASH}]"
    never, gap = rows["First Excellent Robot"][1:]
    assert never == "never"
    assert gap.startswith("\N{MINUS SIGN}\N{INFINITY}")


def test_table_11_gives_the_restricted_difference(
    report_and_folder: tuple[ComparisonReport, Path],
) -> None:
    """Generations without one: 6.5 against 22.25, with an interval."""
    tables = {t.key: t for t in report_and_folder[0].tables}
    row = dict(zip(tables["table-11"].columns, tables["table-11"].rows[0], strict=True))
    cell = row["difference without one [95 %]"]
    assert cell.startswith("\N{MINUS SIGN}15.8 [")


def test_scores_of_the_best_robots(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """In unseen worlds, against the second arm; four runs have no interval, for a reason."""
    report, folder = report_and_folder
    table = next(t for t in report.tables if t.key == "scores")
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    assert [(row["Score"], row["arm"]) for row in rows] == [
        ("mean in unseen worlds", "expert"),
        ("mean in unseen worlds", "baseline"),
    ]
    dash = "\N{EN DASH}"
    # Both arms have 15,000 15,010 15,020 15,030: each pair ties, half of the others win.
    assert rows[0]["P(better than baseline) [95 %]"] == f"0.50 [{dash}]"
    assert rows[0]["IQM [95 %]"] == f"15,015 [{dash}]"
    assert rows[1]["P(better than baseline) [95 %]"] == dash
    assert any("fewer than 10 runs" in text for text in table.notes)
    assert any("There is no validation mean" in text for text in table.notes)
    assert "profiles" in {p.key for p in report.pictures}
    with (folder / "scores.csv").open() as file:
        exact = list(csv.DictReader(file))
    assert (exact[0]["iqm"], exact[0]["iqm_low"], exact[0]["kind"]) == (
        *("15015.0", "", "no test: all values are equal"),
    )


def test_validated_means_are_scores_too() -> None:
    """Where each run was validated; runs of shared seeds are drawn as pairs."""
    arms = [
        fake_arm(
            name, [replace(fake_run(name, s), validation_mean=s + 100.0 * k) for s in range(12)]
        )
        for k, name in enumerate(("expert", "baseline"))
    ]
    scores = champion_scores(compare_arms(arms, force=True), ())
    assert scores == {
        "validation mean": {
            "expert": [float(s) for s in range(12)],
            "baseline": [s + 100.0 for s in range(12)],
        }
    }
    low, high = champion_rows(compare_arms(arms, force=True), scores)
    assert low.improvement == Interval(0.0, 0.0, 0.0)
    assert low.test is not None
    assert low.test.kind == EXACT_PAIRS
    assert low.p_bh == low.test.p == pytest.approx(2 / 2**12)
    assert high.improvement is None
    short = replace(arms[0].runs[0], validation_mean=None)
    one = fake_arm("expert", [short, *arms[0].runs[1:]])
    assert champion_scores(compare_arms([one, arms[1]], force=True), ()) == {}


@pytest.mark.usefixtures("blank")
def test_a_run_that_is_cut_has_no_validated_mean() -> None:
    """Its champion is another one then, so nothing but the reason is shown."""
    arms = [
        fake_arm(name, [replace(fake_run(name, 0, generations=n), validation_mean=1.0)])
        for name, n in (("expert", 41), ("baseline", 30))
    ]
    report = build(compare_arms(arms, force=True), (), 0)
    (section,) = (s for s in report.sections if s.title == "Scores of the best robots")
    (reason,) = section.items
    assert "were cut to the length of the shortest run" in str(reason)
    assert report.scores == ()


def test_champions_are_beside_the_reference_trees(
    report_and_folder: tuple[ComparisonReport, Path],
) -> None:
    """Run by run in champions.csv, over runs in the table: 9,000 and 21,000 + 20 x seed points
    against 9,000 and 30,000 of the reference tree, whose third world no champion met."""
    report, folder = report_and_folder
    with (folder / "champions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    first = {k.removeprefix("minus library: "): v for k, v in rows[0].items()}
    assert (first["arm"], first["seed"], first["unseen"], first["worst"]) == (
        *("expert", "0", "15000.0", "9000.0"),
    )
    assert first["all_rounder"] == "-4500.0"
    half = 12.706205 * 4_500  # t of one degree of freedom, standard error of 0 and -9,000
    assert float(first["all_rounder, low"]) == pytest.approx(-4_500 - half)
    assert float(first["all_rounder, high"]) == pytest.approx(-4_500 + half)
    table = next(t for t in report.tables if t.key == "generalisation")
    row = dict(zip(table.columns, table.rows[0], strict=True))
    # means -4,500 -4,490 -4,480 -4,470: t of three is 3.182, the standard error 6.455
    assert row["minus library: all_rounder (points) [95 %]"] == (
        "\N{MINUS SIGN}4,485 [\N{MINUS SIGN}4,506, \N{MINUS SIGN}4,464]"
    )


@pytest.mark.usefixtures("blank")
def test_families_are_by_question() -> None:
    """The first pair is a family; the other pairs are another one."""
    report = build(_study("expert", "baseline", "editor"), (), 0)
    assert len({f.arms for f in report.findings}) == 3
    keys = [t.key for t in report.tables]
    assert {"table-9-expert-baseline", "table-9-expert-editor", "table-9-baseline-editor"} <= set(
        keys
    )
    assert len(keys) == len(set(keys))
    table = next(t for t in report.tables if t.key == "table-9-expert-editor")
    assert "the family 'other pairs', 28 comparisons" in table.notes[1]
    (questions,) = [t for t in report.tables if t.key.startswith("questions")]
    assert len(questions.rows) == 28
    assert {row[0] for row in questions.rows} == {"expert minus editor", "baseline minus editor"}
    assert {f.size for f in report.findings} == {14, 28, 1, 2}


def test_arms_that_inject_are_a_family_by_themselves() -> None:
    """Found from the runs; each measure's p-values are adjusted in their own family."""
    guided = guidance(tree=TREE, injected=True)
    arms = [
        fake_arm(
            name,
            [fake_run(name, s, best=k + s, guided=guided if injects else None) for s in (0, 1)],
        )
        for k, (name, injects) in enumerate(
            (("expert", True), ("baseline", False), ("editor", True))
        )
    ]
    names = [(f.name, f.pairs) for f in families(compare_arms(arms), DEFAULT_PLAN)]
    assert names == [
        ("the first two arms", (("expert", "baseline"),)),
        ("arms that inject trees", (("expert", "editor"),)),
        ("other pairs", (("baseline", "editor"),)),
    ]


@pytest.mark.usefixtures("blank")
def test_a_plan_is_reported_as_it_was_laid_down() -> None:
    """Primary endpoint not adjusted; a family by name; margins decide what is alike."""
    plan = parse_plan(
        ["judgement=expert, editor"], "first_complete", ["first_complete=3", "mean_max=2500.5"]
    )
    study = _study("expert", "baseline", "editor")
    check_plan(plan, study)
    report = build(study, (), 0, plan=plan)
    primary = report.sections[1].items[0]
    assert isinstance(primary, Table)
    row = dict(zip(primary.columns, primary.rows[0], strict=True))
    assert row["unit"] == "generations without one"
    assert row["pairs: expert lower : equal : higher"] == "4 : 0 : 0"
    assert row["p, not adjusted"] == "0.125 (exact, ties enumerated)"
    assert row["verdict"] == "not shown"
    tables = {t.title: t for t in report.tables if t.key.startswith("questions")}
    judged = tables["Differences: judgement"]
    assert [r[1] for r in judged.rows] == ["Mean Max Fitness", "First Complete Robot"]
    assert [r[judged.columns.index("margin")] for r in judged.rows] == ["±2,500.5", "±3"]
    assert [(f.family, f.size) for f in report.findings if f.arms == ("expert", "editor")][:3] == [
        ("judgement", 2),
        ("judgement", 2),
        ("judgement, further", 13),
    ]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((["a"], None, []), "Expected --family NAME=ARM,ARM"),
        ((["=expert,baseline"], None, []), "Expected --family NAME=ARM,ARM"),
        ((["a=expert,expert"], None, []), "with two arms or more"),
        ((["a=expert,editor", "a=expert,editor"], None, []), "Expected each family once"),
        ((["the first two arms=expert,editor"], None, []), "Expected other names"),
        ((["a=expert,nobody"], None, []), "found 'nobody'; there are expert, baseline, editor"),
        ((["a=expert,baseline"], None, []), "no family before it"),
        (([], "nothing", []), "Expected a measure in --primary, found 'nothing'; there are max"),
        (([], None, ["mean_max"]), "Expected --margin MEASURE=VALUE"),
        (([], None, ["mean_max=-1"]), "above 0"),
        (([], None, ["mean_max=nan"]), "above 0"),
        (([], None, ["mean_max=1", "mean_max=2"]), "Expected each margin once"),
        (([], None, ["nothing=1"]), "Expected a measure in --margin, found 'nothing'"),
    ],
)
def test_a_plan_that_cannot_be_meant(
    options: tuple[list[str], str | None, list[str]], expected: str
) -> None:
    """One message with what was expected and what was found."""
    arms = [fake_arm(n, [fake_run(n, 0, generations=4)]) for n in ("expert", "baseline", "editor")]
    study = compare_arms(arms)
    with pytest.raises(StudyError, match=expected):
        check_plan(parse_plan(*options), study)


@pytest.mark.usefixtures("blank")
def test_one_run_an_arm_is_reported_and_shows_nothing() -> None:
    """With one run each every table and figure is made, and no difference is called shown."""
    arms = [
        fake_arm(name, [fake_run(name, 0, best=best, generations=4)])
        for name, best in (("expert", 9.0), ("baseline", 1.0))
    ]
    report = build(compare_arms(arms), (), 0)
    result = " ".join(str(sentence) for sentence in report.sections[0].items[:-1])
    assert "shown" not in result.replace("not shown", "")
    power = next(t for t in report.tables if t.key == "power")
    assert {row[2] for row in power.rows} == {"none"}
    over_runs = [t for t in report.tables if t.key != "table-13"]  # that one is over generations
    cells = [cell for table in over_runs for row in table.rows for cell in row]
    assert not any(cell.endswith(("± 0", "± 0.0", "± 0.00")) for cell in cells)
    assert not any("nan" in cell for cell in cells)
    (medians,) = [t for t in report.tables if t.key == "medians"]
    assert medians.rows[0][1] == "9 [\N{EN DASH}]"
    assert "nan" not in writing.tests_csv(report.findings)


@pytest.mark.usefixtures("blank")
def test_a_forced_comparison_is_marked_on_top() -> None:
    """The differences are in the page before anything else."""
    report = build(_study("expert", "baseline", force=True), (), 0)
    page = to_page(report)
    assert "world.side differs: 300 in expert, 200 in baseline" in page
    assert page.index("not comparable") < page.index("<h2")


@pytest.mark.usefixtures("blank")
def test_arms_without_supervision_leave_figures_out() -> None:
    """Without patterns there is no Figure 8."""
    report = build(_study("baseline", "editor"), (), 0)
    assert "figure-8" not in {p.key for p in report.pictures}


@pytest.mark.usefixtures("blank")
def test_two_arms_without_any_have_no_difference_in_it() -> None:
    """A tier that nobody reached is 'never' and a dash, not "0.0 [0.0, 0.0]"."""
    arms = [fake_arm(name, [fake_run(name, s) for s in (0, 1)]) for name in ("expert", "baseline")]
    report = build(compare_arms(arms), (), 0)
    tables = {t.key: t for t in report.tables}
    row = dict(zip(tables["table-11"].columns, tables["table-11"].rows[0], strict=True))
    assert row["expert"] == "never in 2 runs"
    assert row["without one, expert"] == "all 41"
    assert row["difference without one [95 %]"] == "\N{EN DASH}"
    assert not any("0.0 [0.0, 0.0]" in cell for t in report.tables for r in t.rows for cell in r)


def test_interventions_are_defined(report_and_folder: tuple[ComparisonReport, Path]) -> None:
    """The table that counts them has the definition."""
    table = next(t for t in report_and_folder[0].tables if t.key == "decisions")
    assert any("An intervention is" in note for note in table.notes)
