"""Each sentence of a prompt is true of the run: five settings, whole prompts, checked claims."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from islandgp.bt.core.engine import ABORTED
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import SUCCESS, Node, depth, size, walk
from islandgp.config.settings import Settings
from islandgp.domain import Domain, Outcome
from islandgp.domains.island.vocabulary import SCHEMA
from islandgp.evaluation.base import Problem
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.experiment import compose
from islandgp.resources import resource
from islandgp.running.parts import make_search, make_supervisor, run_context
from islandgp.scoring.explain import usage
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, Guidance, RunContext, Supervisor
from islandgp.supervision.llm.history import deeds
from islandgp.supervision.llm.prompts import fixed_values
from islandgp.supervision.llm.questions import Questions
from islandgp.text import in_points, rounded
from tests.llm.samples import context, settings, state

EXAMPLES = resource("grammar").parent / "examples"
sys.path += [str(EXAMPLES / name) for name in ("minigrid", "pick_place")]
SMALL = ("gp.population=10", "gp.generations=3", "tracking=off")
INFORMED = "supervisor.policy.prompts=informed"
SETTINGS: dict[str, tuple[str, ...]] = {
    "island, racing": (INFORMED, "supervisor.edits=2", "world.episode.length=60"),
    "island, paper": ("search=paper", INFORMED, "world.episode.length=40"),
    "cartpole": ("domain=cartpole", "search=map_elites", "gp.episodes=2"),
    "minigrid": ("domain=minigrid", "search=hill", INFORMED, "gp.shared_seed=false"),
    "pick_place": ("domain=pick_place", "search=nsga2", INFORMED, "supervisor.edits=2"),
}


class Watch:
    """The expert, which keeps what a supervisor gets."""

    name = "watch"

    def __init__(self, expert: Supervisor) -> None:
        self.expert, self.seen = expert, list[tuple[GenerationView, PopulationState]]()
        self.last: GenerationView

    def on_generation(self, generation: GenerationView) -> None:
        self.last = generation

    def advise(self, at: PopulationState, rng: np.random.Generator) -> Guidance:
        self.seen.append((self.last, at))
        return self.expert.advise(at, rng)


@cache
def asked(name: str) -> tuple[Settings, RunContext, dict[str, tuple[str, str]]]:
    """The configuration of a setting, and its prompts after the last generation of a small run."""
    overrides = (*SMALL, *SETTINGS[name])
    folder = EXAMPLES / name
    conf: dict[str, Any] = {"config_dir": folder / "conf"} if folder.is_dir() else {}
    run = compose(
        *(o for o in overrides if not o.startswith("supervisor.")), "supervisor=expert", **conf
    ).settings
    watch = Watch(make_supervisor(run, None))
    plan = run.plan(run.make_domain())
    problem = run.problem()
    assert isinstance(problem, Problem)
    list(evolve(plan, 0, watch, Serial(problem), search=make_search(run, plan)))
    llm = compose(*overrides, "supervisor=llm", **conf).settings
    questions = Questions(llm.supervisor.settings(), run_context(llm))
    for view, _ in watch.seen:
        questions.on_generation(view)
    requests = {part: questions.request(part, watch.seen[-1][1]) for part in questions.parts}
    return llm, questions.context, {p: (r.system, r.turns[0]) for p, r in requests.items()}


def _claims(run: Settings, has: RunContext, part: str, system: str, user: str) -> dict[str, bool]:
    """Sentences of a prompt, each with whether it is as the configuration says."""
    by_rate = "rate" in run.search.factory.uses
    text = " ".join((system + user).split())
    words = set(re.findall(r"\w+", text))
    limits = run.gp.limits
    example_trees = [parse(t, has.schema.vocabulary) for t in _blocks(system)]
    report = re.search(r"```json\n(.*?)\n```", user, re.DOTALL)
    fields = json.loads(report[1]) if report else {}
    rewarded = "Points of an event" in text
    tiers = [has.classes.tier_title(name) for name in has.classes.tiers]
    counters = {m for t in run.classes.tiers.values() for m in (*t.at_least, *t.above, *t.at_most)}
    return {
        "no mutation rate": by_rate or not {"mutation_rate", "crossover_rate", "crisis"} & words,
        "mutated": by_rate or "mutated" not in text,
        "worlds change": "Every generation has new worlds" in text,
        "one world for all": ("same world" in text) is run.gp.shared_seed,
        "worlds for each": ("for each individual" in text) is not run.gp.shared_seed,
        "episodes": ("means over 2 episodes" in text) is (run.gp.episodes > 1),
        "largest trees": part == "rate"
        or f"{limits.max_depth} levels {'or' if part == 'tree' else 'and'} {limits.max_nodes} nodes"
        in text,
        "examples fit": all(
            depth(t) <= limits.max_depth and size(t) <= limits.max_nodes for t in example_trees
        ),
        "factors": ("factor" in text) is any(s.multipliers for s in run.curriculum.stages),
        "tiers are defined": all(f"- {tier}: " in system for tier in tiers),
        "counters are defined": all(
            f"{name} ({has.schema.counters[name].meaning})" in text
            for name in counters - {"fitness"}
        ),
        "rewards are defined": not rewarded
        or all(f"- {name}: " in system for name in run.rewards.events),
        "components are defined": not rewarded
        or all(f"{name}: {m}" in text for name, m in has.schema.components.items()),
        "fields are described": all(
            re.search(rf"\b{name}\b", system.partition("How to read")[2]) for name in fields
        ),
        "no tree twice": max(Counter(_trees(user, has)).values(), default=0) <= 1,
        "no report in edits": part != "edits" or "the report" not in text,
        "nothing open": "{{" not in text and "None" not in words,
    }  # fmt: skip


def _blocks(text: str) -> list[str]:
    fenced = re.findall(r"^```(\w*)\n(.*?)\n```$", text, re.DOTALL | re.MULTILINE)
    return [block for language, block in fenced if not language]


def _trees(user: str, has: RunContext) -> list[str]:
    """Canonical texts of the trees in a prompt that are not cut off."""
    return [to_text(parse(t, has.schema.vocabulary)) for t in _blocks(user) if "..." not in t]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] if n == "minigrid" else []) for n in SETTINGS],
)
def test_prompts_are_true(name: str) -> None:
    """Each sentence that can be checked is as the configuration says."""
    run, has, prompts = asked(name)
    for part, (system, user) in prompts.items():
        claims = _claims(run, has, part, system, user)
        assert [claim for claim, holds in claims.items() if not holds] == [], part


def test_prompts_of_the_island_are_short() -> None:
    """Meanings of fields and the language without the vocabulary: half of what they were."""
    system = asked("island, racing")[2]["tree"][0]
    fields = system.partition("## How to read the report")[2].partition("## Answer")[0]
    language = system.partition("## The language")[2].partition("\n\nActions")[0]
    assert len(fields) + len(language) < (4545 + 4382) / 2


class _Count:
    """Counts the successes of actions in an episode, and knows which ran."""

    def __init__(self, tree: Node) -> None:
        self.actions, self.counts = [node.action for node in walk(tree)], Counter[str]()
        self.ran = set[str]()

    def node(self, place: int, status: int) -> None:
        if self.actions[place] and status != ABORTED:
            self.ran.add(self.actions[place])
            self.counts[self.actions[place]] += status == SUCCESS

    def tick(self, *_: object) -> None: ...

    def credit(self, *_: object) -> None: ...


def test_traces_count_instant_actions() -> None:
    """Each action of the tree, with its ticks and successes; none that ran is denied."""
    domain = compose(
        "domain=pick_place", "tracking=off", config_dir=EXAMPLES / "pick_place" / "conf"
    ).domain
    tree = parse((EXAMPLES / "pick_place" / "carry.bt").read_text(), domain.schema.vocabulary)
    count = _Count(tree)
    domain.run_episode(tree, 0, {}, count)
    usages = usage(lambda t, seed, log: domain.run_episode(t, seed, {}, log), tree, [0])
    lines = deeds(tree, usages)
    for line, name in zip(lines, dict.fromkeys(filter(None, count.actions)), strict=True):
        assert line.startswith(f"- {name}")
        assert ("never ran" in line) == (name not in count.ran)
        assert f"succeeded {count.counts[name]}x" in line or name not in count.ran


def test_shipped_trees_are_within_the_limits() -> None:
    """Hand-written trees of the package and the examples can be what a model writes."""
    for folder, name in ((EXAMPLES / d, d) for d in ("minigrid", "pick_place")):
        run = compose(f"domain={name}", "tracking=off", config_dir=folder / "conf")
        for file in folder.glob("*.bt"):
            tree = parse(file.read_text(), run.domain.schema.vocabulary)
            limits = run.settings.gp.limits
            assert depth(tree) <= limits.max_depth, file
            assert size(tree) <= limits.max_nodes, file


def system(part: str, run_context: RunContext, *overrides: str) -> str:
    """A system prompt, in one line."""
    questions = Questions(settings(*overrides), run_context)
    text = questions.request(part, state()).system
    return " ".join(text.split())


@pytest.mark.parametrize(
    ("part", "override", "sentence"),
    [
        ("rate", "gp.episodes=3", "Complete Robot: on the mean of 3 episodes pickups"),
        ("rate", "gp.mutate_elites=true", "also the best ones and a tree that you write"),
        ("rate", "supervisor.inject=false", "with this chance, also the best ones."),
        ("rate", "gp.mutate_elites=false", "the best individuals and a tree that you write are"),
        ("tree", "gp.mutate_elites=true", "is mutated with the same chance as all others"),
        ("tree", "gp.mutate_elites=false", "mutation leaves it alone"),
        ("rate", "gp.reseed_every=epoch", "Every epoch has new worlds"),
        ("rate", "gp.reseed_every=never", "The worlds never change"),
        ("rate", "gp.shared_seed=false", "a world of its own for each individual"),
        ("tree", "world.episode.length=60", "An episode has at most 60 s, in ticks of 0.1 s."),
        ("tree", "supervisor.inject=true", "Why an episode ended: time: it had its full length"),
        ("rate", "supervisor.inject=true", "another stage has other factors"),
    ],
)
def test_sentences_follow_the_configuration(part: str, override: str, sentence: str) -> None:
    """Of mutation, episodes, worlds, and stages."""
    assert sentence in system(part, context(None, override))


def test_prompts_have_factors_if_the_curriculum_has_some() -> None:
    """Without any neither the fields nor the curriculum are mentioned."""
    run_context = context()
    assert "multipliers" in system("rate", run_context)
    stage = run_context.curriculum.stages[0].model_copy(update={"multipliers": {}})
    flat = run_context.curriculum.model_copy(update={"stages": (stage,)})
    without = replace(run_context, curriculum=flat)
    assert "multipliers" not in system("rate", without)
    assert fixed_values(without, without.library())["curriculum"] == ""


def test_small_points_are_not_rounded_away() -> None:
    """A domain of small returns shows its differences; large ones stay short."""
    numbers = [rounded(v) for v in (0.01234, -0.004, 12.34, 99.96, 812.42, -0.0, 4000.4)]
    assert numbers == [0.0123, -0.004, 12.3, 100, 812, 0, 4000]
    assert [in_points(v, "+") for v in (0.0123, -0.5, 21000.4)] == ["+0.0123", "-0.5", "+21,000"]


def test_a_domain_without_descriptions_has_run_facts() -> None:
    """`about` and `endings` may be missing."""
    run_context = context()

    class Plain(Domain):
        schema = replace(SCHEMA, endings={})

        def run_episode(self, *_: Any, **__: Any) -> Outcome:
            raise AssertionError("no episode is needed for facts")

    plain = replace(run_context, schema=Plain.schema, domain_in=lambda _: Plain(None, None))
    assert "Why an episode ended" not in fixed_values(plain, plain.library())["episode"]
    assert "one episode a generation" in fixed_values(plain, plain.library())["episode"]
