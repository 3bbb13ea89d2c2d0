"""The facts of a run in prompts follow its configuration."""

from __future__ import annotations

from dataclasses import replace

import pytest

from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.supervision.base import RunContext
from islandgp.supervision.llm.prompts import run_facts
from islandgp.supervision.llm.questions import Questions
from islandgp.text import in_points, rounded
from tests.llm.samples import context, settings, state
from tests.llm.test_prompts import CAPABILITIES


def system(part: str, run_context: RunContext, *overrides: str) -> str:
    """A system prompt, in one line."""
    text = Questions(settings(*overrides), run_context).request(part, state(), CAPABILITIES).system
    return " ".join(text.split())


@pytest.mark.parametrize("prompts", ["paper", "informed"])
def test_tiers_are_of_as_many_episodes_as_judge(prompts: str) -> None:
    """With several episodes counters are means over them."""
    prompt_set = f"prompts={prompts}"
    one, three = context(), context(None, "gp.episodes=3")
    assert "Complete Robot: in one episode pickups" in system("rate", one, prompt_set)
    text = system("rate", three, prompt_set)
    assert "Complete Robot: on the mean of 3 episodes pickups" in text
    assert "in one episode" not in text
    assert "means over 3 episodes" in text
    assert "means over 3 episodes" in system("tree", three, prompt_set)


def test_prompts_describe_what_mutation_hits() -> None:
    """It leaves elites and injected trees alone where `gp.mutate_elites` is false."""
    spared = context(None, "gp.mutate_elites=false")
    assert "also the best ones" in system("rate", context())
    assert "the best individuals and a tree that you write are kept" in system("rate", spared)
    assert "it is mutated, evaluated" in system("tree", context())
    assert "mutation leaves it alone" in system("tree", spared)


@pytest.mark.parametrize(
    ("key", "sentence"),
    [
        ("gp.reseed_every=generation", "Every generation has new worlds (the same world for all"),
        ("gp.reseed_every=epoch", "Every epoch has new worlds"),
        ("gp.reseed_every=never", "The worlds never change"),
        ("gp.shared_seed=false", "a world of its own for each individual"),
    ],
)
def test_prompts_describe_when_worlds_change(key: str, sentence: str) -> None:
    """As `gp.reseed_every` and `gp.shared_seed` are set."""
    assert sentence in system("rate", context(None, key))


def test_prompts_have_factors_if_the_curriculum_has_some() -> None:
    """Without any neither the fields nor the curriculum are mentioned."""
    with_factors = system("rate", context())
    assert "next_multipliers.garbage" in with_factors
    assert "next_multipliers.patrol" not in with_factors, "no stage names it"
    run_context = context()
    stage = run_context.curriculum.stages[0].model_copy(update={"multipliers": {}})
    flat = run_context.curriculum.model_copy(update={"stages": (stage,)})
    without = replace(run_context, curriculum=flat)
    assert "next_multipliers" not in system("rate", without)
    assert run_facts(without)["curriculum"] == ""


def test_prompts_have_length_and_endings_of_an_episode() -> None:
    """With the world's own numbers, and a meaning for each ending."""
    text = system("tree", context(None, "world.episode.length=60"))
    assert "An episode has at most 60 s, in ticks of 0.1 s." in text
    assert all(f"{word}: {meaning}" in text for word, meaning in SCHEMA.endings.items())


def test_small_points_are_not_rounded_away() -> None:
    """A domain of small returns shows its differences; large ones stay short."""
    numbers = [rounded(v) for v in (0.01234, -0.004, 12.34, 99.96, 812.42, -0.0, 4000.4)]
    assert numbers == [0.0123, -0.004, 12.3, 100, 812, 0, 4000]
    assert [in_points(v, "+") for v in (0.0123, -0.5, 21000.4)] == ["+0.0123", "-0.5", "+21,000"]


def test_a_domain_without_descriptions_has_run_facts() -> None:
    """`about` and `endings` may be missing."""
    run_context = context()

    class Plain:
        schema = replace(SCHEMA, endings={})

    plain = replace(run_context, schema=Plain.schema, domain_in=lambda _: Plain())  # type: ignore[arg-type, return-value]
    assert "Why an episode ended" not in run_facts(plain)["episode"]
    assert "one episode a generation" in run_facts(plain)["episode"]
