"""Arms differ in what is studied, and in nothing else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats  # type: ignore[import-untyped] # scipy ships no types

from islandgp.compare.arms import Arm
from islandgp.compare.comparable import compare_arms, shared_seeds
from islandgp.compare.findings import examine_all
from islandgp.compare.measures import FITNESS, emergence
from islandgp.errors import StudyError
from islandgp.statistics import UNTESTED
from tests.compare.fake_runs import fake_arm, fake_run


def _arm(name: str, seeds: range, selection: str = "", **changes: Any) -> Arm:
    supervisor = name if name in ("expert", "baseline", "editor") else "expert"
    runs = [fake_run(supervisor, s, generations=4, path=f"{name}-{s}", **changes) for s in seeds]
    return fake_arm(name, runs, selection)


def test_supervisors_may_differ() -> None:
    """Two supervisors on the same seeds are comparable and come in pairs."""
    study = compare_arms([_arm("expert", range(3)), _arm("baseline", range(3))])
    assert study.comparability_warnings == ()
    assert shared_seeds(*study.pairs[0]) == (0, 1, 2)
    assert len(study.tasks) == 1
    assert not any("supervisor.name" in n for n in study.notes)  # the arms' names show it


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("world__humanoids__count", 3),
        ("rewards__events__leftover__per_unit", -1),
        ("classes__specialists__dominance_ratio", 3.0),
        ("gp__generations", 12),
        ("gp__mutate_elites", False),
        ("allocation__elites", 1),
    ],
)
def test_another_world_budget_or_gp_is_refused(key: str, value: Any) -> None:
    """Each such difference is named; --force takes it into the report instead."""
    arms = [_arm("expert", range(2)), _arm("baseline", range(2), **{key: value})]
    dotted = key.replace("__", ".")
    with pytest.raises(StudyError, match=f"{dotted} differs: .* in expert, {value} in baseline"):
        compare_arms(arms)
    assert any(dotted in doubt for doubt in compare_arms(arms, force=True).comparability_warnings)


@pytest.mark.parametrize(("factory", "doubted"), [("theirs:Pool", True), ("", False)])
def test_a_user_s_evaluator_may_make_a_difference(factory: str, doubted: bool) -> None:
    """What it is and how it is set is compared; the package's own give the same outcomes."""
    changes = {"evaluator__factory": factory} if factory else {}
    arms = [
        _arm("expert", range(2), evaluator__policy__workers=1, **changes),
        _arm("baseline", range(2), evaluator__policy__workers=2),
    ]
    doubts = " ".join(compare_arms(arms, force=True).comparability_warnings)
    assert ("evaluator.policy.workers differs" in doubts) is doubted


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("world__side", 200, True),
        ("rewards__events__leftover__per_unit", -1, True),
        ("gp__population", 12, False),
        ("gp__max_nodes", 20, False),
        ("gp__trees__leaf", 0.9, False),
        ("gp__tournament", 2, True),
        ("gp__generations", 12, True),
    ],
)
def test_runs_are_pairs_only_from_the_same_start(key: str, value: Any, expected: bool) -> None:
    """The same seed with another population or tree language is another start: no pair."""
    arms = [_arm("expert", range(2)), _arm("baseline", range(2), **{key: value})]
    study = compare_arms(arms, force=True)
    assert shared_seeds(*study.pairs[0]) == ((0, 1) if expected else ())
    row = examine_all(study, FITNESS[:1]).iloc[0]
    assert bool(row["pairs"]) is expected


def test_keys_that_both_selections_name_are_studied() -> None:
    """gp.mutate_elites may differ where every arm asks for its value."""
    arms = [
        _arm("a", range(2), "gp.mutate_elites=true", gp__mutate_elites=True),
        _arm("b", range(2), "gp.mutate_elites=false", gp__mutate_elites=False),
    ]
    study = compare_arms(arms)
    assert study.notes[0] == "The arms differ in gp.mutate_elites: True in a, False in b."
    half = [arms[0], replace(arms[1], keys=frozenset({"supervisor.name"}))]
    with pytest.raises(StudyError, match=r"gp\.mutate_elites differs"):
        compare_arms(half)


def test_arms_without_a_common_seed_are_refused() -> None:
    """Arms on other seeds met other worlds."""
    arms = [_arm("expert", range(3)), _arm("baseline", range(3, 5))]
    with pytest.raises(StudyError, match="two arms share no seed: expert 0-2; baseline 3-4"):
        compare_arms(arms)
    assert shared_seeds(*compare_arms(arms, force=True).pairs[0]) == ()


def test_arms_are_paired_by_the_seeds_that_they_share() -> None:
    """Seeds 0 to 29 against 0 to 14, of equal worlds: 15 pairs, and a note on the other runs.

    The worlds of a seed are worth so much more than the difference of the arms that the unpaired
    test does not show it.
    """
    rng = np.random.default_rng(0)
    worth = rng.normal(12, 5, 30)
    values = {"expert": worth - 2 + rng.normal(0, 1, 30), "baseline": worth[:15]}
    values["baseline"] = values["baseline"] + rng.normal(0, 1, 15)
    arms = [
        fake_arm(
            name,
            [
                fake_run(name, seed, best=[float(value)] * 4, path=f"{name}-{seed}")
                for seed, value in enumerate(each)
            ],
        )
        for name, each in values.items()
    ]
    study = compare_arms(arms)
    assert shared_seeds(*study.pairs[0]) == tuple(range(15))
    assert any(
        "paired by the 15 seeds that they share (0-14); seeds 15-29 of expert have no pair" in note
        for note in study.notes
    )
    row = examine_all(study, FITNESS[:1]).iloc[0]
    assert (row["n_first"], row["n_second"], row["pairs"]) == (30, 15, 15)
    paired = stats.wilcoxon(values["expert"][:15], values["baseline"])
    assert row["paired_p"] == pytest.approx(paired.pvalue)
    assert row["paired_p"] < 0.01
    assert row["p"] == pytest.approx(stats.mannwhitneyu(*values.values(), method="exact").pvalue)
    assert row["p"] > 0.05
    apart = np.mean(values["expert"][:15] - values["baseline"])
    assert row["difference"] == pytest.approx(apart)


@pytest.mark.parametrize(
    ("key", "values", "labels"),
    [
        ("rewards.events.interaction.base", (100, 360), ("interaction.base=100",)),
        ("world.side", (300, 200), ("world.side=300",)),
        ("classes.specialists.dominance_ratio", (2.0, 3.0), ("specialists.dominance_ratio=2.0",)),
    ],
)
def test_tasks_may_be_studied(key: str, values: tuple[float, ...], labels: tuple[str]) -> None:
    """Where every selection names the rewards, world or classes, each arm has its own task."""
    changes = [{key.replace(".", "__"): value} for value in values]
    arms = [
        _arm(f"arm{value}", range(2), f"{key}={value}", **change)
        for value, change in zip(values, changes, strict=True)
    ]
    study = compare_arms(arms)
    assert study.comparability_warnings == ()
    assert [task.label for task in study.tasks][:1] == [*labels]
    assert [task.arms for task in study.tasks] == [(arm.name,) for arm in arms]
    assert shared_seeds(*study.pairs[0]) == (0, 1)


def test_curricula_are_tested_in_their_last_stage() -> None:
    """Arms with other first stages have one task, but points of training are not comparable."""
    arms = [
        _arm("a", range(2), "curriculum.last_only=false", curriculum__last_only=False),
        _arm("b", range(2), "curriculum.last_only=true", curriculum__last_only=True),
    ]
    study = compare_arms(arms)
    assert [task.arms for task in study.tasks] == [("a", "b")]
    assert not study.same_training
    assert compare_arms([_arm("expert", range(2)), _arm("baseline", range(2))]).same_training


def test_an_arm_is_of_one_kind() -> None:
    """Runs of two configurations, or two runs of one seed, are no arm."""
    mixed = fake_arm(
        "expert",
        [fake_run(seed=0, path="a"), fake_run(seed=1, path="b", gp__tournament_size=2)],
    )
    with pytest.raises(StudyError, match=r"within expert: gp\.tournament_size is 2 and 3"):
        compare_arms([mixed, _arm("baseline", range(2))])
    runs = [
        fake_run(seed=s, path=str(s), supervisor__name=f"s{s}", supervisor__lag=s) for s in (0, 1)
    ]
    mixed_arm = fake_arm("a", runs)
    with pytest.raises(
        StudyError, match=r"found:\n  within a: supervisor\.name is s0 and s1\nSelect"
    ):
        compare_arms([mixed_arm, _arm("baseline", range(2))])
    twice = fake_arm("expert", [fake_run(seed=0, path="a"), fake_run(seed=0, path="b")])
    with pytest.raises(StudyError, match="seeds 0 are there more than once"):
        compare_arms([twice, _arm("baseline", range(1))])


def test_one_arm_or_one_name_twice_is_no_comparison() -> None:
    """Two arms at least, of different names, without common runs."""
    arm = _arm("expert", range(2))
    with pytest.raises(StudyError, match="two or more arms, found 1"):
        compare_arms([arm])
    with pytest.raises(StudyError, match="found expert twice"):
        compare_arms([arm, arm])
    with pytest.raises(StudyError, match="each run in one arm"):
        compare_arms([arm, fake_arm("other", arm.runs)])


def test_runs_need_a_generation_in_each_stage() -> None:
    """Three generations have no mid-training: the runs are refused with the reason."""
    arms = [fake_arm(name, [fake_run(name, 0, generations=3)]) for name in ("expert", "baseline")]
    with pytest.raises(StudyError, match="at least 4 generations, found 3;"):
        compare_arms(arms)


def test_longer_runs_are_cut_where_the_shortest_ends() -> None:
    """What a longer arm did later counts for no measure: 'never' is the same for both."""
    long = fake_run(generations=8, best=[1.0, 2, 3, 4, 5, 6, 9, 7], complete=3, excellent=6)
    short = fake_run("baseline", generations=6, best=[1.0] * 6)
    study = compare_arms([fake_arm("expert", [long]), fake_arm("baseline", [short])], force=True)
    assert study.horizon == 6
    run = study.of_arm("expert").iloc[0]
    assert (run["first.complete"], run["fitness_max"]) == (3, 6.0)
    assert np.isnan(run["first.excellent"])
    assert any("The runs have 6 to 8 generations" in note for note in study.notes)
    firsts = [emergence("complete"), emergence("excellent")]
    results = examine_all(study, firsts)
    assert [*results["censored_first"]] == [0, 1]
    assert results["kind"][1] == UNTESTED


def test_a_library_is_chosen_as_a_whole() -> None:
    """All its keys may differ where every selection names one of them, and else none."""
    other = {"library__folder": "mine", "library__shown": {}}
    for selections, allowed in (
        (("library.folder=grammar/examples", "library.folder=mine"), True),
        (("supervisor=expert", "library.folder=mine"), False),
    ):
        arms = [_arm("a", range(2), selections[0]), _arm("b", range(2), selections[1], **other)]
        doubts = compare_arms(arms, force=True).comparability_warnings
        assert (not any(doubt.startswith("library.") for doubt in doubts)) is allowed


def test_a_search_is_chosen_as_a_whole() -> None:
    """Its class and its settings may differ where every selection names the search."""
    other = {"search__name": "hill", "search__factory": "mine:Hill", "search__policy": {"n": 1}}
    for selections, allowed in (
        (("search=paper", "search=hill"), True),
        (("search=paper curriculum.last_only=true", "search.name=hill"), True),
        (("search=paper", "supervisor=expert"), False),
    ):
        arms = [
            _arm("a", range(2), selections[0], search__name="paper"),
            _arm("b", range(2), selections[1], **other),
        ]
        study = compare_arms(arms, force=True)
        assert (
            not any(doubt.startswith("search.") for doubt in study.comparability_warnings)
        ) is allowed
        assert not allowed or any("search.name: paper in a, hill in b" in n for n in study.notes)


def test_searches_with_other_curricula_need_a_remedy() -> None:
    """The error names a setting with which both train in the same stages; long values are cut."""
    arms = [
        _arm("a", range(2), "search=paper"),
        _arm("b", range(2), "search=hill", curriculum__stages=[{"x": "y" * 1000}]),
    ]
    with pytest.raises(StudyError) as raised:
        compare_arms(arms)
    assert "curriculum.last_only=true), or use --force" in str(raised.value)
    assert max(map(len, str(raised.value).splitlines())) <= 402


def test_runs_of_two_domains_are_not_compared() -> None:
    """Runs whose classes or tiers have other names are refused, --force or not."""
    tiers = {"done": {"above": {"fitness": 1}}}
    changes = {"classes__tiers": tiers, "classes__milestones": ["done"]}
    with pytest.raises(StudyError, match="one domain, with the same behaviours and tiers"):
        compare_arms([_arm("a", range(2)), _arm("b", range(2), **changes)], force=True)
    other = _arm("b", range(2), domain__factory="maze:Maze")
    with pytest.raises(StudyError, match="one domain"):
        compare_arms([_arm("a", range(2)), other], force=True)
