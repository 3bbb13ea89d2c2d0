"""Keys that a configuration does not read change no individual; to set one is an error."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from islandgp.config.reads import acts, keys_read
from islandgp.config.settings import read_settings
from islandgp.errors import ConfigError
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.experiment import compose
from islandgp.running.app import main
from islandgp.running.parts import make_search, make_supervisor, plan_of
from islandgp.search.base import NoSettings
from islandgp.search.random_search import RandomSearch
from tests.composed import plain
from tests.running.commands import ROOT
from tests.search.searches import NAMES

SMALL = (
    *("evaluator=serial", "gp.population=10", "gp.generations=8", "world.episode.length=15"),
    *("curriculum.generations_per_epoch=1", "gp.validation=0"),
)
OTHER: dict[str, Any] = {
    "gp.tournament_size": 6,
    "gp.crossover": "branch",
    "gp.crossover_rate": 0.1,
    "gp.mutation_rate": 0.9,
    "gp.mutate_elites": False,
    "gp.trees.leaf": 0.9,
    "gp.mutation.number_sd": 0.9,
    "gp.mutation.operators.swap": 50,
    "gp.state.window": 2,
    "gp.state.improvement": 0.9,
    "gp.state.low_diversity": 0.99,
    "gp.crisis.diversity_below": 0.99,
    "gp.crisis.emergency_rate": 0.99,
    "allocation.elites": 0,
    "allocation.resurrected": 0,
    "allocation.niche_share": 0.1,
    "allocation.per": 60,
    "allocation.reevaluated": 0.4,
    "allocation.random": 0.4,
    "allocation.injected": 3,
    "curriculum.generations_per_epoch": 3,
    "curriculum.stages.0.multipliers.garbage": 9.0,
    "library.trees.pickup": ["single_humanoid"],
    "supervisor.adapt_mutation": None,
    "supervisor.inject": None,
    "supervisor.policy.rates.early_exploration": [0.01, 0.02],
    "supervisor.policy.rare": 1.0,
    "supervisor.policy.collapse": 0.99,
    "supervisor.policy.compact.nodes": 40,
    "supervisor.policy.up": 3.0,
}
"""Another value of keys that some configurations do not read; None: the other of true and false."""

VARIATION = {
    *("gp.tournament_size", "gp.crossover", "gp.crossover_rate", "gp.mutate_elites"),
    *("gp.trees.leaf", "gp.mutation.number_sd", "gp.mutation.operators.swap"),
    *("gp.crisis.emergency_rate", "allocation.elites", "curriculum.generations_per_epoch"),
}
RACING = {"gp.trees.leaf", "allocation.reevaluated", "allocation.random"}
SEEN = {
    ("paper", "baseline"): VARIATION,
    ("paper", "expert"): VARIATION | {"supervisor.inject"},
    ("racing", "expert"): RACING | {"allocation.injected", "supervisor.inject"},
    ("racing", "editor"): RACING,
    ("random", "expert"): {"gp.trees.leaf"},
}
"""Declared keys whose other value changes these small runs."""


def changed(config: dict[str, Any], key: str) -> dict[str, Any] | None:
    """The configuration with the other value of a key; None if it has no such key."""
    config = deepcopy(config)
    *path, last = key.split(".")
    section: Any = config
    for part in path:
        section = section[int(part)] if isinstance(section, list) else section.get(part)
        if section is None:
            return None
    if last not in section:
        return None
    value = OTHER[key]
    section[last] = not section[last] if value is None else value
    return config


def individuals(config: dict[str, Any]) -> Iterator[str]:
    """All individuals of a run, generation by generation."""
    settings = read_settings(config)
    plan = plan_of(settings, settings.make_domain())
    supervisor, evaluator = make_supervisor(settings, None), Serial(settings.problem())
    search = make_search(settings, plan)
    for step in evolve(plan, settings.seed, supervisor, evaluator, search=search):
        yield repr((step.record.worlds, step.record.individuals))


@cache
def base(search: str, supervisor: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """A small configuration and its individuals."""
    config = plain(f"search={search}", f"supervisor={supervisor}", *SMALL)
    return config, tuple(individuals(config))


PAIRS = sorted({*SEEN, *((search, "baseline") for search in NAMES)})


@pytest.mark.parametrize(("search", "supervisor"), PAIRS)
def test_a_key_that_is_not_read_changes_no_individual(search: str, supervisor: str) -> None:
    """Byte by byte, for each key that the configuration does not declare; declared ones act."""
    config, before = base(search, supervisor)
    keys = keys_read(read_settings(config))
    seen = SEEN.get((search, supervisor), set())
    assert all(acts(key, keys) for key in seen)
    others = config
    for key in OTHER:
        if not acts(key, keys):
            others = changed(others, key) or others
    assert tuple(individuals(others)) == before
    for key in seen:
        other = changed(config, key)
        assert other is not None
        assert tuple(individuals(other)) != before, key


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["gp.tournament_size=2,6", "-m"],
            "search=racing does not read gp.tournament_size; search=paper",
        ),
        (
            ["allocation.niche_share=0.5"],
            "allocation.niche_share: unknown key; search=paper has it.",
        ),
        (["search=racing,paper", "gp.crossover_rate=0.1,0.2", "-m"], "search=racing does not read"),
        (["search=random", "supervisor=baseline,expert", "-m"], "search=random with supervisor="),
        (
            ["supervisor=baseline,editor", "allocation.injected=1,2", "-m"],
            "search=racing with supervisor=baseline does not read allocation.injected; supervisor=",
        ),
        (["supervisor.inject=false", "allocation.injected=2"], "; supervisor.inject=true does"),
        (["budget.episodes=900", "gp.generations=3"], "budget.episodes=900 sets gp.generations"),
        (["supervisor=baseline", "search.policy.library=0", "library=single"], "not read library"),
    ],
)
def test_setting_a_key_that_nothing_reads_is_an_error(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2 and one line with the choice that reads it; no folder is made."""
    monkeypatch.chdir(tmp_path)
    assert main(["experiment=smoke", "tracking=off", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert not [*tmp_path.iterdir()]


def test_a_fixed_key_needs_one_job_that_reads_it() -> None:
    """In Python as on the command line; a search that reads the key may stand beside others."""
    with pytest.raises(ConfigError, match=r"search=racing does not read gp\.crossover"):
        compose("gp.crossover=branch")
    assert compose("search=paper", "gp.crossover=branch").settings.gp.crossover == "branch"


def test_in_a_file_of_the_user_it_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line names the file and the keys; those with the package's own values are left out."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf/experiment").mkdir(parents=True)
    file = tmp_path / "conf/experiment/mine.yaml"
    text = "# @package _global_\nname: mine\ngp: {tournament_size: 6, crossover_rate: 0.8}\n"
    file.write_text(text)
    compose("experiment=mine", config_dir="conf")
    error = capsys.readouterr().err
    assert error.startswith(f"islandgp: {file}: search=racing does not read gp.tournament_size;")
    compose("experiment=mine", "search=paper", config_dir="conf")
    assert not capsys.readouterr().err


def test_what_describes_a_robot_is_no_warning(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A domain's own file has a library and a curriculum for the choices that read them."""
    folder = ROOT / "examples/pick_place"
    monkeypatch.syspath_prepend(str(folder))
    compose("domain=pick_place", "supervisor=baseline", config_dir=folder / "conf")
    assert not capsys.readouterr().err


class Curious(RandomSearch):
    """Reads a key that its Settings do not declare."""

    Settings = NoSettings  # type: ignore[assignment] # it has no share of lists

    def ask(self, *_: Any) -> Any:
        """Raises AttributeError."""
        return self.plan.gp.tournament_size


def test_a_search_cannot_read_what_it_does_not_declare() -> None:
    """The plan that it gets has no other keys of `gp`, and no slots."""
    config = plain("search=random", "~search.policy.lists", "~search.policy.simplify")
    config["search"]["factory"] = f"{__name__}:Curious"
    settings = read_settings(config)
    search: Any = make_search(settings, settings.plan(settings.make_domain()))
    with pytest.raises(AttributeError, match="no attribute 'tournament_size'"):
        search.ask()
    with pytest.raises(AttributeError, match="elites"):
        _ = search.plan.allocation.elites
    assert search.plan.gp.limits.max_nodes == 50
