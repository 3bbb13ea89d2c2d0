"""The whole report, on runs made by hand."""

from __future__ import annotations

import re
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd  # type: ignore[import-untyped] # its stubs are a package apart
import pytest

from islandgp.compare.comparable import Comparison, compare_arms
from islandgp.compare.report import Report, build, write
from islandgp.compare.tables import MINUS, NONE, unseen_table
from islandgp.records.folder import RunFolder
from tests.compare.fake_runs import (
    TREE,
    fake_arm,
    fake_run,
    guidance,
    individual,
    validated,
    written,
)


def _study(*names: str, force: bool = False) -> Comparison:
    arms = []
    for k, name in enumerate(names):
        runs = []
        for seed in range(6):
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
                    path=f"{name}-{seed}",
                    world__side=200 if force and name == "baseline" else 300,
                )
            )
        arms.append(fake_arm(name, runs))
    return compare_arms(arms, force=force)


@pytest.fixture(scope="module")
def report() -> Report:
    """A report of two arms, one with a run without a Complete Robot; figures are not drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("islandgp.compare.figures.to_svg", lambda *_, **__: "")
        return build(_study("expert", "baseline"))


def test_one_table_has_all_measures(report: Report) -> None:
    """Tables 9 to 12 in one: estimate, test and verdict of each measure."""
    frame = report.tables["differences expert baseline"].set_index("Measure")
    assert len(frame) == 15
    row = frame.loc["First Complete Robot"]
    assert row["expert"] == "7.5 ± 1.9"
    assert row["baseline"] == "21.3 ± 9.8; never in 1 of 6"
    assert row["test"] == "signed-rank, 6 pairs"
    assert row["verdict"] == "not shown"
    assert frame.loc["First Excellent Robot", "baseline"].endswith("never in 6 of 6")


def test_the_screen(report: Report) -> None:
    """The question, the arms, the endpoint, three lines and the report: a screen at most."""
    lines = report.screen(Path("study/x")).splitlines()
    assert lines[:3] == [
        "Question: Does supervisor matter?",
        "Arms: expert (6 runs, seeds 0-5); baseline (6 runs, seeds 0-5)",
        "Endpoint: Mean Max Fitness (not planned: --primary MEASURE states it)",
    ]
    assert [line[:27] for line in lines[3:6]] == [
        "  expert minus baseline: +6",
        *["  expert minus baseline, Fi"] * 2,
    ]
    assert lines[4].endswith("(signed-rank, 6 pairs): not shown")
    assert lines[-1] == "Report: study/x/index.html"
    assert len(lines) < 12


@pytest.mark.usefixtures("blank")
def test_many_arms_have_one_screen() -> None:
    """Three of the pairs are shown, and the others counted."""
    names = ("expert", "baseline", "editor", "random_branch", "constant")
    study = compare_arms(
        [fake_arm(n, [fake_run("expert", 0, path=n)], f"gp.mutation_rate={n}") for n in names]
    )
    screen = build(study).screen(Path("x"))
    assert "; 1 more\n" in screen
    assert "  7 more pairs are in the report." in screen
    assert len(screen.splitlines()) <= 12


def test_files_of_the_report(tmp_path: Path) -> None:
    """A page, a CSV for each table, SVG for each figure; other files are kept."""
    (tmp_path / "mine.txt").write_text("mine")
    small = [
        fake_arm(n, [fake_run(n, s, generations=4) for s in (0, 1)]) for n in ("expert", "baseline")
    ]
    paths = {
        path.relative_to(tmp_path).as_posix()
        for path in write(build(compare_arms(small)), tmp_path)
    }
    assert paths == {
        *("index.html", "runs.csv", "tests.csv"),
        *(f"tables/{name}.csv" for name in ("arms", "differences-expert-baseline", "components")),
        *(f"tables/{name}.csv" for name in ("origins", "behaviours", "costs")),
        *(f"figures/{name}.svg" for name in ("curves", "first-robots")),
    }
    assert all((tmp_path / path).stat().st_size > 0 for path in paths)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == 2
    assert not re.search(r'(src|href)="(?!data:|#)', page)
    runs = pd.read_csv(tmp_path / "runs.csv")
    assert list(runs["arm"]) == ["expert"] * 2 + ["baseline"] * 2
    assert runs["first.complete"].isna().all()


@pytest.mark.usefixtures("blank")
def test_a_plan_is_reported_as_it_was_laid_down() -> None:
    """The primary endpoint is not adjusted and comes first."""
    report = build(_study("expert", "baseline", "editor"), "first.complete")
    assert report.results[0].startswith(f"expert minus baseline: {MINUS}")
    assert "p 0.0" in report.results[0]
    assert report.results[2].startswith(f"baseline minus editor: {MINUS}")
    assert "Endpoint: First Complete Robot (planned)" in report.screen(Path("x"))
    frame = report.tables["differences expert baseline"].set_index("Measure")
    assert frame.loc["First Complete Robot (primary)", "p BH"] == NONE


@pytest.mark.usefixtures("blank")
def test_a_measure_on_request() -> None:
    """First robots that are not advised trees are tested if the plan names them."""
    rows = build(_study("expert", "baseline"), "first_descendant.complete").rows
    assert "first_descendant.complete" in {*rows["measure"]}


@pytest.mark.usefixtures("blank")
def test_one_run_an_arm_is_reported_and_shows_nothing() -> None:
    """With one run each every table is made, and no difference is called shown."""
    arms = [fake_arm(n, [fake_run(n, 0, best=1.0 + len(n))]) for n in ("expert", "baseline")]
    report = build(compare_arms(arms))
    verdicts = report.tables["differences expert baseline"]["verdict"]
    assert not [v for v in verdicts if v.startswith(("higher", "lower"))]
    assert "nan" not in report.files["index.html"]


@pytest.mark.usefixtures("blank")
def test_a_forced_comparison_is_marked_on_top() -> None:
    """The differences are in the page before anything else, and on the screen."""
    report = build(_study("expert", "baseline", force=True))
    page = report.files["index.html"]
    assert page.index("world.side differs") < page.index("<section")
    assert report.screen(Path("x")).startswith("Not comparable: world.side differs")


@pytest.mark.usefixtures("blank")
def test_points_of_different_rewards_are_not_compared() -> None:
    """No test has points of training, and the validation means are marked."""
    arms = []
    for base in (100, 360):
        runs = []
        for seed in (0, 1):
            run = fake_run(seed=seed, rewards__events__interaction__base=base)
            records = [*RunFolder(run.path).generations()]
            result = validated(5.0 * base, 7)
            runs.append(written(run.path / "again", records, run.config, validation=result))
        arms.append(fake_arm(f"base{base}", runs, f"rewards.events.interaction.base={base}"))
    report = build(compare_arms(arms))
    assert report.question == "Does interaction.base matter?"
    assert "points" not in {*report.rows["unit"]}
    means = list(report.tables["arms"]["validation mean (points)"])
    assert means == ["500 ± 0 (own task)", "1,800 ± 0 (own task)"]
    assert "different scales and are not compared" in " ".join(report.files["index.html"].split())
    frame = pd.read_csv(StringIO(report.files["runs.csv"]))
    assert "mean_fitness_max" not in frame
    assert list(frame["task"]) == ["interaction.base=100"] * 2 + ["interaction.base=360"] * 2
    assert list(frame["rewards.events.interaction.base"]) == [100] * 2 + [360] * 2


def test_a_cross_table_of_tasks() -> None:
    """A row per arm, a column per task; the own one has an asterisk."""
    arms = [
        fake_arm(
            f"base{b}",
            [
                fake_run(seed=s, path=f"{b}{s}", rewards__events__interaction__base=b)
                for s in (0, 1)
            ],
            f"rewards.events.interaction.base={b}",
        )
        for b in (100, 360)
    ]
    study = compare_arms(arms)
    robots = study.runs.reset_index()[["arm", "run", "seed"]]
    results = pd.concat(
        [robots.assign(task=task.label, points=k + 1.0) for k, task in enumerate(study.tasks)]
    )
    frame = unseen_table(study, results)
    assert frame.to_numpy().tolist() == [
        ["base100", "2", "1 ± 0 *", "2 ± 0"],
        ["base360", "2", "1 ± 0", "2 ± 0 *"],
    ]
    assert list(frame.columns[2:]) == [
        "under interaction.base=100 (points)",
        "under interaction.base=360 (points)",
    ]


def test_best_robots_beside_the_library() -> None:
    """Means over runs, shares of milestones, and the difference to the first library tree."""
    study = _study("expert", "baseline")
    robots = study.runs.reset_index()[["arm", "run", "seed"]]
    robots = robots.assign(points=9.0 + robots["seed"] / 2, worst=8.0)
    tree = pd.DataFrame({"arm": ["library: a"], "points": [5.0], "worst": [5.0]})
    shares = {"reached.complete": 0.5, "reached.excellent": 0.0}
    frame = unseen_table(study, pd.concat([robots, tree]).assign(**shares)).set_index("Trees")
    assert frame.loc["expert", "unseen (points)"] == "10 ± 1"
    assert frame.loc["expert", "worst world"] == "8"
    assert frame.loc["expert", "Complete in"] == "50.0 % of the worlds"
    assert frame.loc["expert", "minus library: a [95 %]"].startswith("+5 [")
    assert frame.loc["library: a", "trained (points)"] == NONE


@pytest.mark.usefixtures("blank")
def test_the_page_breaks_no_markup() -> None:
    """Names of arms are texts, not tags."""
    arms = [fake_arm(f"<b>{n}", [fake_run("expert", 0, best=n)], f"gp.n={n}") for n in (1, 2)]
    page = build(compare_arms(arms)).files["index.html"]
    assert "<b>" not in page
    assert "&lt;b&gt;1 minus &lt;b&gt;2" in page
