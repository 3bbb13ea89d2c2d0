"""Tests of pairs of arms: families, verdicts, and effects of factors."""

from __future__ import annotations

import pytest

from islandgp.compare.arms import Arm
from islandgp.compare.comparable import Comparison, compare_arms
from islandgp.compare.findings import (
    FIRST,
    REST,
    check_primary,
    effects,
    examine_all,
    factors,
    row_of,
    verdict,
)
from islandgp.compare.measures import FITNESS, MEAN_MAX, descendant, emergence, training_measures
from islandgp.errors import StudyError
from islandgp.statistics import paired_difference, paired_test
from tests.compare.fake_runs import fake_arm, fake_run
from tests.samples import CLASSES

MEASURES = training_measures(CLASSES)


def _study(seeds: int = 4, **arms: tuple[float, int | None]) -> Comparison:
    """Arms by highest fitness and first Complete generation, which rise with the seed."""
    return compare_arms(
        [
            fake_arm(
                name,
                [
                    fake_run(
                        name,
                        s,
                        generations=12,
                        best=value + s,
                        complete=None if first is None else first + s,
                    )
                    for s in range(seeds)
                ],
            )
            for name, (value, first) in arms.items()
        ]
    )


TWO = {"expert": (100.0, 2), "baseline": (50.0, 5)}


def test_a_row_by_hand() -> None:
    """Means, differences of the pairs, both tests; p adjusted over the family."""
    study = _study(6, **TWO)
    rows = examine_all(study, [MEAN_MAX, emergence("complete")])
    row = row_of(rows, "mean_fitness_max", ("expert", "baseline"))
    assert (row["mean_first"], row["mean_second"], row["difference"]) == (102.5, 52.5, 50.0)
    assert (row["difference_low"], row["difference_high"]) == (50.0, 50.0)
    assert (row["U"], row["r"]) == (36.0, -1.0)
    assert (row["pairs"], row["pairs_lower"], row["pairs_higher"]) == (6, 0, 6)
    assert row["paired_p"] == pytest.approx(2 / 64)
    assert (row["family"], row["family_size"]) == (FIRST, 2)
    assert row["paired_p_bh"] == pytest.approx(2 / 64)
    assert verdict(row) == "higher, shown"


def test_censored_runs_have_all_generations() -> None:
    """A run that never had one counts with all; two arms without any have no difference."""
    study = _study(expert=(100.0, 2), baseline=(50.0, None))
    rows = examine_all(study, [emergence("complete"), emergence("excellent")])
    row = rows.iloc[0]
    assert (row["mean_first"], row["mean_second"], row["censored_second"]) == (3.5, 12.0, 4)
    assert row["unit"] == "generations without one"
    assert verdict(rows.iloc[1]) == "never in either arm"


def test_too_few_runs_are_reported() -> None:
    """With four pairs no signed-rank test can be below 0.05."""
    row = examine_all(_study(4, **TWO), [MEAN_MAX]).iloc[0]
    assert verdict(row) == "not shown: too few runs (least p 0.12)"


def test_equal_pairs_are_equal() -> None:
    """Each pair has the same value."""
    study = _study(4, expert=(1.0, 1), baseline=(1.0, 1))
    row = examine_all(study, [MEAN_MAX]).iloc[0]
    assert verdict(row) == "equal in every pair"


def test_the_first_pair_is_a_family() -> None:
    """The other pairs are one; a measure that is not `main` is adjusted apart."""
    study = _study(expert=(3.0, 1), baseline=(2.0, 1), editor=(1.0, 1))
    rows = examine_all(study, [*FITNESS, descendant("complete")])
    sizes = dict(zip(rows["family"], rows["family_size"], strict=True))
    assert sizes == {FIRST: 7, f"{FIRST}, further": 1, REST: 14, f"{REST}, further": 2}


def test_an_endpoint_that_cannot_be_meant() -> None:
    """One message with what was expected and what was found."""
    check_primary(None, MEASURES)
    check_primary("first.complete", MEASURES)
    with pytest.raises(StudyError, match="a measure in --primary, found 'speed'; there are fit"):
        check_primary("speed", MEASURES)


def _factorial(*cells: tuple[str, str, float], seeds: int = 3) -> Comparison:
    arms: list[Arm] = []
    for a, b, value in cells:
        selection = f"gp.mutation_rate={a} gp.crossover_rate={b}"
        runs = [
            fake_run(
                seed=s,
                generations=4,
                best=value + s * (s + 1),
                path=f"{a}{b}{s}",
                gp__mutation_rate=float(a),
                gp__crossover_rate=float(b),
            )
            for s in range(seeds)
        ]
        arms.append(fake_arm(f"{a}-{b}", runs, selection))
    return compare_arms(arms)


def test_main_effects_and_interaction_by_hand() -> None:
    """Means 1, 3, 5, 11 of two by two: 6 for the first factor, 4 for the second, 4 for both."""
    study = _factorial(
        ("0.1", "0.5", 1.0), ("0.1", "0.9", 3.0), ("0.4", "0.5", 5.0), ("0.4", "0.9", 11.0)
    )
    assert factors(study) == {
        "gp.crossover_rate": ("0.5", "0.9"),
        "gp.mutation_rate": ("0.1", "0.4"),
    }
    frame = effects(study, [MEAN_MAX])
    assert dict(zip(frame["effect"], frame["difference"], strict=True)) == pytest.approx(
        {
            "gp.crossover_rate: 0.9 minus 0.5": 4.0,
            "gp.mutation_rate: 0.4 minus 0.1": 6.0,
            "gp.crossover_rate=0.9 and gp.mutation_rate=0.4, interaction": 4.0,
        }
    )
    assert list(frame["seeds"]) == [3, 3, 3]
    assert list(frame["p"]) == [0.25] * 3


def test_three_levels_are_compared_with_the_first() -> None:
    """Over the arms of the other factor."""
    study = _factorial(
        *(("0.1", b, v) for b, v in (("0.5", 1.0), ("0.9", 2.0))),
        *(("0.2", b, v) for b, v in (("0.5", 2.0), ("0.9", 3.0))),
        *(("0.4", b, v) for b, v in (("0.5", 4.0), ("0.9", 8.0))),
    )
    frame = effects(study, [MEAN_MAX]).set_index("effect")["difference"]
    assert frame["gp.mutation_rate: 0.2 minus 0.1"] == pytest.approx(1.0)
    assert frame["gp.mutation_rate: 0.4 minus 0.1"] == pytest.approx(4.5)
    assert frame["gp.crossover_rate: 0.9 minus 0.5"] == pytest.approx(2.0)
    both = "gp.crossover_rate=0.9 and gp.mutation_rate=0.4, interaction"
    assert frame[both] == pytest.approx(3.0)


def test_missing_combinations_have_no_effects() -> None:
    """Three of four cells, a single factor, or a single seed: there is nothing to average over."""
    three = _factorial(("0.1", "0.5", 1.0), ("0.1", "0.9", 3.0), ("0.4", "0.5", 5.0))
    assert factors(three) == {}
    assert len(effects(three, [MEAN_MAX])) == 0
    assert len(effects(_factorial(("0.1", "0.5", 1.0), ("0.4", "0.5", 5.0)), [MEAN_MAX])) == 0
    single = [("0.1", "0.5", 1.0), ("0.1", "0.9", 3.0), ("0.4", "0.5", 5.0), ("0.4", "0.9", 1.0)]
    assert len(effects(_factorial(*single, seeds=1), [MEAN_MAX])) == 0


def test_an_effect_of_one_factor_is_its_paired_difference() -> None:
    """With noise on the seeds: of the means over the other factor."""
    values = {("0.1", "0.5"): 1.0, ("0.1", "0.9"): 3.0, ("0.4", "0.5"): 5.0, ("0.4", "0.9"): 2.0}
    study = _factorial(*((a, b, v) for (a, b), v in values.items()), seeds=5)
    row = effects(study, [MEAN_MAX]).set_index("effect").loc["gp.mutation_rate: 0.4 minus 0.1"]
    by_arm = {name: [*study.of_arm(name)[MEAN_MAX.key]] for name in study.names}
    high, low = (
        [(x + y) / 2 for x, y in zip(by_arm[f"{a}-0.5"], by_arm[f"{a}-0.9"], strict=True)]
        for a in ("0.4", "0.1")
    )
    assert row["difference"] == pytest.approx(paired_difference(high, low).estimate)
    assert row["p"] == paired_test(high, low).p
