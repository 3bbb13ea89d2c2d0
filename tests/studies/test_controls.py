"""The control arms: trees without a target, guidance without a state, and half of a supervisor."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from islandgp.bt.core.node import Node, size
from islandgp.errors import SupervisionError
from islandgp.gp.record import record_values
from islandgp.records.files import dump
from islandgp.running.app import main
from islandgp.running.parts import make_supervisor
from islandgp.supervision.expert import Expert
from studies.controls.fixed import Fixed, FixedSettings
from studies.controls.untargeted import Untargeted, early_targets
from studies.controls.yoked import Yoked, YokedSettings
from tests.composed import composed
from tests.evolution.runs import plan, records, run
from tests.llm.samples import context, state
from tests.running.commands import fake
from tests.samples import CLASSES, snapshot
from tests.samples import state as state_after
from tests.studies.configured import CONF, studied

QUICK = (
    "gp.generations=2",
    "gp.population=4",
    "tracking=off",
    "progress=off",
    *fake("Instant"),
)

LACKS_CHARGING = state(complete=1)
RICH = replace(
    state(complete=9),
    now=replace(
        state(complete=9).now, behaviour_counts=dict.fromkeys(state().now.behaviour_counts, 30)
    ),
)


def draws(supervisor: Untargeted, at: object, n: int = 700) -> Counter[str | None]:
    return Counter(
        supervisor.advise(at, np.random.default_rng(i)).target  # type: ignore[arg-type]
        for i in range(n)
    )


def untargeted(library: str = "combined") -> Untargeted:
    supervisor = make_supervisor(studied("supervisor=untargeted", f"library={library}"), None)
    assert isinstance(supervisor, Untargeted)
    return supervisor


def test_random_injection_is_blind_to_the_state() -> None:
    """The same draws give the same tree, for any missing behaviour."""
    supervisor = untargeted()
    for seed in range(50):
        poor = supervisor.advise(LACKS_CHARGING, np.random.default_rng(seed))
        rich = supervisor.advise(RICH, np.random.default_rng(seed))
        assert (poor.target, poor.tree) == (rich.target, rich.tree)


def test_random_injection_draws_every_target_alike() -> None:
    """Seven targets, each a seventh of the time, within four standard deviations."""
    counts = draws(untargeted(), LACKS_CHARGING)
    assert set(counts) == set(CLASSES.targets)
    assert all(100 - 4 * 9.3 < count < 100 + 4 * 9.3 for count in counts.values())


def test_random_injection_is_blind_where_only_behaviours_have_trees() -> None:
    """A target without a tree is never drawn: it would be replaced by the rarest behaviour's."""
    supervisor = untargeted("single")
    counts = draws(supervisor, LACKS_CHARGING)
    assert set(counts) == set(CLASSES.behaviours)
    assert all(175 - 4 * 11.5 < count < 175 + 4 * 11.5 for count in counts.values())
    for seed in range(50):
        poor = supervisor.advise(LACKS_CHARGING, np.random.default_rng(seed))
        rich = supervisor.advise(RICH, np.random.default_rng(seed))
        assert poor.tree == rich.tree


def test_random_injection_is_as_compact_as_the_expert() -> None:
    """Until a Complete Robot has existed it has the trees that the expert has, and no others."""
    supervisor = untargeted()
    assert set(draws(supervisor, state())) == set(early_targets(CLASSES.targets))
    for i in range(50):
        tree = supervisor.advise(state(), np.random.default_rng(i)).tree
        assert tree is not None
        assert supervisor.settings.compact.admits(tree)


def test_random_injection_takes_trees_of_the_same_library() -> None:
    """Only the choice is random: every tree is one that the expert could have given."""
    supervisor = untargeted()
    library = set(supervisor.library.trees.values())
    trees: set[Node | None] = {
        supervisor.advise(RICH, np.random.default_rng(i)).tree for i in range(99)
    }
    assert trees <= library
    assert len(trees) > 4


def test_random_injection_keeps_the_expert_s_rate() -> None:
    """The rate still follows the state, so that the arms differ in one thing."""
    supervisor = untargeted()
    for at in (LACKS_CHARGING, RICH):
        expert = Expert.advise(supervisor, at, np.random.default_rng(0))
        guidance = supervisor.advise(at, np.random.default_rng(0))
        assert (guidance.mutation_rate, guidance.phase) == (expert.mutation_rate, expert.phase)
        assert guidance.source == "untargeted"


def led(folder: Path) -> list[dict[str, object]]:
    """The guidance in another run's record, which is written to a folder."""
    steps = run(plan("supervisor.inject=true"), make_supervisor(composed(), None), seed=8)
    folder.mkdir(parents=True)
    lines = [dump(record_values(record)) for record in records(steps)]
    (folder / "generations.jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [json.loads(line)["guidance"] for line in lines]


def test_another_seed_s_record_is_repeated(tmp_path: Path) -> None:
    """Rate and tree of each generation are the leader's, for any population here."""
    leader = led(tmp_path / "expert-seed1")
    settings = YokedSettings(record=str(tmp_path / "expert-seed{seed}"), first=0, seeds=5)
    run_context = replace(context(None), generations=8)
    steps = run(plan("supervisor.inject=true"), Yoked.make(settings, run_context), seed=0)
    answers = [record.guidance for record in records(steps)]
    assert len(answers) == 8
    for answer, was in zip(answers[:-1], leader[:-1], strict=True):
        assert answer is not None
        assert (answer.wanted_rate, answer.tree, answer.phase, answer.target) == (
            was["wanted_rate"],
            was["tree"],
            was["phase"],
            was["target"],
        )
        assert (answer.source, answer.notes) == ("yoked", {"led_by": "expert"})


def test_each_seed_is_led_by_the_next() -> None:
    """And the last by the first, so that each record leads once."""
    settings = YokedSettings(record="runs/x/expert-seed{seed}", first=0, seeds=5)
    assert [settings.folder(seed).name[-1] for seed in range(5)] == ["1", "2", "3", "4", "0"]


def test_a_sweep_may_start_at_any_seed() -> None:
    """The seeds lead each other in a ring; the error for one outside names the settings."""
    settings = YokedSettings(record="runs/x/expert-seed{seed}", first=3000, seeds=30)
    leaders = {seed: settings.other_seed(seed) for seed in range(3000, 3030)}
    assert (leaders[3000], leaders[3028], leaders[3029]) == (3001, 3029, 3000)
    assert set(leaders.values()) == set(leaders)
    assert settings.folder(3029) == Path("runs/x/expert-seed3000")
    for seed in (0, 2999, 3030):
        with pytest.raises(SupervisionError, match=rf"seed of 3000 to 3029, found {seed}; set "):
            settings.folder(seed)


def test_a_missing_or_unfinished_leader_is_reported(tmp_path: Path) -> None:
    """Before the run starts, with what to do."""
    settings = YokedSettings(record=str(tmp_path / "expert-seed{seed}"), first=0, seeds=5)
    with pytest.raises(SupervisionError, match="run it first, with seed=1"):
        Yoked.make(settings, context(None))
    led(tmp_path / "expert-seed1")
    with pytest.raises(SupervisionError, match="41 generations"):
        Yoked.make(settings, context(None))


@pytest.mark.parametrize(
    ("field", "value"), [("phase", "bored"), ("tree", "selector {"), ("wanted_rate", "high")]
)
def test_a_damaged_record_of_a_leader_is_reported(
    tmp_path: Path, field: str, value: object
) -> None:
    """Before the run starts, not in the generation in which it would be repeated."""
    led(tmp_path / "expert-seed1")
    file = tmp_path / "expert-seed1" / "generations.jsonl"
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    lines[3]["guidance"][field] = value
    file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    settings = YokedSettings(record=str(tmp_path / "expert-seed{seed}"), first=0, seeds=5)
    with pytest.raises(SupervisionError, match="found a damaged one"):
        Yoked.make(settings, replace(context(None), generations=8))


def test_without_a_leader_nothing_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and one line, even where only the last job of a sweep has none."""
    monkeypatch.chdir(tmp_path)
    overrides = ["--config-dir", str(CONF), "experiment=ablation_another_record", *QUICK]
    for n, missing_seed in enumerate((1, 2)):
        assert main([*overrides, "seed=0,1", "-m"]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        (line,) = captured.err.splitlines()
        assert line.startswith(
            "islandgp: Expected the record of another run in runs/paper/expert-seed"
            f"{missing_seed}, found none"
        )
        assert not (tmp_path / "runs" / "ablation_another_record").exists()
        if n == 0:
            led(tmp_path / "runs" / "paper" / "expert-seed1")


def test_fixed() -> None:
    """`fixed` gives the same rate in every state, and injects nothing."""
    fixed = Fixed(FixedSettings(rate=0.3))
    for history in ([snapshot(0)], [snapshot(0), snapshot(1, fitness_max=1e6, diversity=0.0)]):
        guidance = fixed.advise(state_after(history), np.random.default_rng(0))
        assert (guidance.mutation_rate, guidance.tree, guidance.source) == (0.3, None, "fixed")


def test_rate_only() -> None:
    """The supervisor's rates are applied; its trees are not injected."""
    supervisor = studied("experiment=ablation_rate_only").supervisor
    assert (supervisor.name, supervisor.adapt_mutation, supervisor.inject) == (
        "expert",
        True,
        False,
    )
    steps = run(plan("supervisor.inject=false"), make_supervisor(composed(), None))
    for record in records(steps)[:-1]:
        assert record.guidance is not None
        assert record.guidance.applied_rate in (record.guidance.wanted_rate, 0.5)
        assert not record.guidance.injected
    assert not any("injected" in record.origins for record in records(steps))


def test_injection_only() -> None:
    """Trees go in; the rate is the one of the start, but for emergencies, which do not last."""
    supervisor = studied("experiment=ablation_injection_only").supervisor
    assert (supervisor.name, supervisor.adapt_mutation, supervisor.inject) == (
        "expert",
        False,
        True,
    )
    run_plan = plan("supervisor.inject=true", "supervisor.adapt_mutation=false")
    steps = run(run_plan, make_supervisor(composed(), None))
    for record in records(steps)[:-1]:
        assert record.guidance is not None
        crisis = run_plan.gp.crisis.emergency_rate
        assert record.guidance.applied_rate == (
            crisis if record.guidance.crisis else run_plan.gp.mutation_rate
        )
        assert record.guidance.injected


def test_ablations_have_different_names() -> None:
    """Each arm's runs have their own folder, and every file of the group composes."""
    files = sorted((CONF / "experiment").glob("ablation_*.yaml"))
    names = {studied(f"experiment={file.stem}").name for file in files}
    assert names == {file.stem for file in files}
    assert len(names) == 6


def test_grammar_walk() -> None:
    """`grammar_walk` injects valid trees of a limited size, the same ones for the same stream."""
    walker = make_supervisor(studied("supervisor=grammar_walk", "supervisor.policy.nodes=12"), None)
    state = state_after([snapshot(0)])
    trees = [walker.advise(state, np.random.default_rng(seed)).tree for seed in (0, 1, 0)]
    assert trees[0] == trees[2] != trees[1]
    assert all(1 < size(tree) <= 12 for tree in trees if tree is not None)
