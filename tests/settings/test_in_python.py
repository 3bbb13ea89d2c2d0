"""Configurations composed in a program of the user's own."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import hydra
import pytest

import islandgp
from islandgp.errors import ConfigError
from islandgp.records.folder import RunFolder, Status
from islandgp.resources import resource
from tests.running.commands import TINY, fake


@pytest.mark.parametrize(
    "arguments", [("seed=1,2", "-m"), ("--nope",), ("--version",), ("--cfg=job",)]
)
def test_options_are_refused_and_the_program_goes_on(arguments: tuple[str, ...]) -> None:
    """They are the command line's: here there is one experiment, and nothing to print."""
    with pytest.raises(ConfigError, match=r"Expected overrides .*, found the option -"):
        islandgp.compose(*arguments)


def test_threads_may_compose_at_the_same_time() -> None:
    """Each gets its own experiment."""
    with ThreadPoolExecutor(4) as pool:
        seeds = pool.map(lambda seed: islandgp.compose(f"seed={seed}").settings.seed, range(4))
        assert list(seeds) == list(range(4))


def test_a_folder_of_configuration_has_any_name(tmp_path: Path) -> None:
    """Its path may have letters and signs that mean something in Hydra's overrides."""
    folder = tmp_path / "gewächs (1), 'x' \"y\""
    (folder / "experiment").mkdir(parents=True)
    text = "# @package _global_\ngp:\n  population: 6\n"
    (folder / "experiment" / "mine.yaml").write_text(text, encoding="utf-8")
    experiment = islandgp.compose("experiment=mine", config_dir=folder)
    assert experiment.settings.gp.population == 6


def test_a_program_that_uses_hydra_keeps_its_configuration() -> None:
    """Composing inside of its block neither fails nor takes its configuration away."""
    with hydra.initialize_config_dir(str(resource("conf")), version_base="1.3"):
        assert islandgp.compose("seed=3").settings.seed == 3
        assert hydra.compose("config", ["seed=5"]).seed == 5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stage": 9}, r"^stage: expected 0 to 3, found 9$"),
        ({"stage": -1}, r"^stage: expected 0 to 3, found -1$"),
        ({"worlds": [3, -1]}, r"^worlds: expected seeds from 0 to 4294967295, found -1$"),
        ({"worlds": ["one"]}, r"^worlds: expected seeds .*, found 'one'$"),
    ],
)
def test_a_stage_or_world_that_is_not_there(options: dict[str, Any], message: str) -> None:
    """The error comes before any episode."""
    with pytest.raises(ConfigError, match=message):
        islandgp.compose().evaluate("PatrolWaypoint", **options)


class _Enough(Exception): ...


def test_a_run_calls_back_after_each_generation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception of the callback stops the run; the same call continues it."""
    monkeypatch.chdir(tmp_path)
    overrides = [*TINY, *fake("Instant"), "tracking=off"]
    generations: list[int] = []

    def callback(record: islandgp.GenerationRecord) -> None:
        generations.append(record.snapshot.generation)
        if generations == [0, 1, 2]:
            raise _Enough

    with pytest.raises(_Enough):
        islandgp.run(*overrides, on_generation=callback)
    (file,) = tmp_path.glob("runs/*/*/about.json")
    folder = RunFolder(file.parent)
    assert (folder.status(), folder.error()) == (Status.KILLED, "")
    assert folder.completed_generations() == 3
    results = islandgp.run(*overrides, on_generation=callback)
    assert generations == [0, 1, 2, *range(6)]
    assert list(results.generations["generation"]) == [*range(6)]
    assert islandgp.run(*overrides, on_generation=callback).path == results.path
