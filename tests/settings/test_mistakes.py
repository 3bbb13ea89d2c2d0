"""Wrong configurations: one line for each error, exit code 2, nothing started, nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest

from islandgp.app import main
from tests.settings.test_composing import options

OFF = ("tracking=off", "evaluator=serial", "progress=off")


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each command is given in a folder of its own."""
    monkeypatch.chdir(tmp_path)


def errors(capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    """The lines of a command that must fail and leave nothing behind."""
    assert main([*OFF, *words]) == 2
    found = capsys.readouterr()
    assert found.out == ""
    assert found.err.startswith("islandgp: ")
    assert "Traceback" not in found.err
    assert list(Path.cwd().iterdir()) == []
    return found.err.removeprefix("islandgp: ").splitlines()


ONE_LINE = [
    # words, the line
    (["gp.populaton=3"], "gp.populaton: unknown key; did you mean gp.population?"),
    (["wrld.side=3"], "wrld.side: unknown key"),
    (["gp.mutation.operators.swapp=3"],
     "gp.mutation.operators.swapp: unknown key; did you mean gp.mutation.operators.swap?"),
    (["+gp.elites=3"], "gp.elites: unknown key;"),
    (["+sed=3"], "sed: unknown key; did you mean seed?"),
    (["+supervisor.policy.patiense=3", "supervisor=baseline"],
     "supervisor.policy.patiense: unknown key; did you mean supervisor.policy.patience?"),
    (["gp.population=many"], "gp.population='many': input should be a valid integer"),
    (["gp.population=2.5"], "gp.population=2.5: input should be a valid integer"),
    (["gp.population=null"], "gp.population=None: input should be a valid integer"),
    (["gp.population=3"], "gp.population=3: input should be greater than or equal to 4"),
    (["gp.crossover_rate=1.5"], "gp.crossover_rate=1.5: input should be less than or equal to 1"),
    (["world.robot.speed=0"], "world.robot.speed=0: input should be greater than 0"),
    (["world.side=nan"], "world.side=nan: input should be"),
    (["rewards.collision=inf"], "rewards.collision=inf: input should be a finite number"),
    (["seed=-1"], "seed=-1: input should be greater than or equal to 0"),
    (["name=a/b"], "name='a/b': string should match pattern"),
    (["resume=perhaps"], "resume='perhaps': input should be 'auto', 'never' or 'force'"),
    (["gp.tournament=50"], "gp.tournament: expected at most gp.population=30, found 50"),
    (["supervisor.lag=41"], "supervisor.lag: expected less than gp.generations=41, found 41"),
    (["world.start=[500,400]"],
     "world.start: expected points at least 2 m inside the 300 m island, found (500, 400)"),
    (["world.side=1e6"],
     "world.side: expected at most 100,000 cells of 16 m, in which garbage is looked for, found"
     " 3,906,250,000 on an island of 1e+06 m; take a smaller side or a larger robot.perception"),
    (["world.side=6000"], "world.side: expected at most 100,000 cells of 16 m"),
    (["world.robot.perception=0.1", "world.robot.speed=1.2", "world.humanoids.speed=1"],
     "world.side: expected at most 100,000 cells of 0.34 m"),
    (["world.episode.step=1e-9"],
     "world.episode: expected fewer than 536,870,912 steps, found 420 s in steps of 1e-09 s"),
    (["world.garbage.initial=300"],
     "world.garbage.initial: expected at most garbage.most=250, found 300"),
    (["world.humanoids.speed=9"], "world.humanoids.speed: expected at most robot.speed=5, found 9"),
    (["world.obstacles.radius=[4,2]"],
     "world.obstacles.radius: expected least before most, found [4, 2]"),
    (["world.obstacles.count=30", "world.obstacles.gap=60"],
     "world.obstacles: expected room for 30 obstacles, found room for"),
    (["allocation.tournament=[25,18]"],
     "allocation.tournament: expected 1 <= least <= most, found [25, 18]"),
    (["~classes.tiers.complete"],
     "classes.tiers: expected a threshold for each tier, missing complete"),
    (["~gp.state.window"], "gp.state.window: expected a value, found none"),
    (["supervisor=baseline", "supervisor.policy.rates=[0.5,0.1]"],
     "supervisor.policy.rates: expected 0 <= least <= most <= 1, found [0.5, 0.1]"),
    (["supervisor.policy.rates.refinement=[0.3,0.2]"],
     "supervisor.policy.rates.refinement: expected 0 <= low <= high <= 1"),
    (["gp.mutation.operators.subtree=-1"], "gp.mutation.operators: expected weights >= 0"),
    (["supervisor.factory=nowhere"], "supervisor.factory='nowhere': invalid python path"),
    (["supervisor.factory=islandgp.run:run"],
     "supervisor.factory: expected a class with Settings, make and advise, found <function run"),
    (["supervisor.factory=tests.running.evaluators:Instant"],
     "supervisor.factory: expected a class with Settings, make and advise, found <class"),
    (["evaluator.factory=islandgp.run:run"],
     "evaluator.factory: expected a class with Settings and make, found <function run"),
    (["seed=range(5)"],
     "seed=range(5): expected one value, found a sweep; add -m to run all of them."),
    (["seed=1,2"], "seed=1,2: expected one value, found a sweep; add -m to run all of them."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "line"), ONE_LINE, ids=[" ".join(words) for words, _ in ONE_LINE]
)
def test_one_error_one_line(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line names the key and what was found, and what would be right."""
    (found,) = errors(capsys, *words)
    assert found.startswith(line)


@pytest.mark.parametrize(
    ("word", "line"),
    [
        ("supervisor=expret", "supervisor=expret: unknown option; did you mean expert? there are "),
        ("supervisor=oracle", "supervisor=oracle: unknown option; there are "),
        ("evaluator=seriel", "evaluator=seriel: unknown option; did you mean serial? there are "),
        ("experiment=papr", "experiment=papr: unknown option; did you mean paper? there are "),
    ],
)
def test_unknown_options_list_those_there_are(
    word: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unknown supervisor, or any other option, lists those there are."""
    (found,) = errors(capsys, word)
    assert found.startswith(line)
    group = word.partition("=")[0]
    assert found.split("there are ")[1].split(", ") == options(group)


def test_several_errors_several_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """All that is wrong is told at once, a line for each."""
    found = errors(
        capsys,
        "gp.population=1",
        "gp.generations=none",
        "world.robot.speed=-2",
        "+rewards.pickup.bonus=3",
        "supervisor=baseline",
        "supervisor.policy.patience=0",
        "supervisor.policy.up=0.5",
    )
    assert [line.partition(":")[0] for line in found] == [
        "gp.generations='none'",
        "gp.population=1",
        "rewards.pickup.bonus",
        "supervisor.policy.patience=0",
        "supervisor.policy.up=0.5",
        "world.robot.speed=-2",
    ]


def test_an_override_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    """A word that is no override is told as what it is."""
    (found,) = errors(capsys, "gp.population")
    assert "gp.population" in found


def test_a_sweep_is_checked_before_it_starts(capsys: pytest.CaptureFixture[str]) -> None:
    """One wrong job of a sweep, even the last, and none starts."""
    found = errors(capsys, "experiment=smoke", "gp.population=12,8,3", "-m")
    assert found == ["gp.population=3: input should be greater than or equal to 4"]


def test_the_right_ones_run(capsys: pytest.CaptureFixture[str]) -> None:
    """The same words without a mistake run, and write into `runs` alone."""
    words = [*OFF, "experiment=smoke", "gp.population=4", "gp.generations=2", "supervisor=baseline"]
    assert main([*words, "gp.tournament=2", "world.episode.length=5"]) == 0
    found = capsys.readouterr()
    assert "Best fitness" in found.out
    assert [path.name for path in Path.cwd().iterdir()] == ["runs"]


def test_run_errors_have_no_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    """What only the run finds out is one message, too: a tree that is not there."""
    assert main([*OFF, "experiment=smoke", "supervisor.policy.trees.pickup=[nope]"]) == 2
    found = capsys.readouterr()
    assert "found 'nope'; there are all_rounder" in found.err
    assert "Traceback" not in found.err
    assert list(Path.cwd().iterdir()) == []
