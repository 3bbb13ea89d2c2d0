"""The library that is searched for: in the worlds of stages, and in runs that use it again."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from islandgp.evolution import single_behaviours
from islandgp.running.app import main
from tests.domains.test_outside import OWN, example
from tests.running.commands import TINY

__all__ = ["example"]

SHORT_RUN = (
    *OWN,
    *TINY,
    "gp.generations=2",
    "gp.validation=0",
    "evaluator=serial",
    "supervisor=expert",
)
BEHAVIOURS = ("localising", "driving", "picking", "placing")
IMPOSSIBLE = "world.ticks=12"  # too few for an item to be placed


@pytest.fixture
def short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches that find their trees in four rounds, and need not look for others longer."""
    monkeypatch.setattr(single_behaviours, "ROUNDS", 4)


def stages(*worlds: str) -> str:
    """A curriculum with a stage for each world."""
    entries = (
        f"{{epochs:[{n},{n}],multipliers:{{}},world:{world}}}" for n, world in enumerate(worlds, 1)
    )
    return f"curriculum.stages=[{','.join(entries)}]"


def library(folder: Path) -> dict[str, str]:
    """The trees of the only library that is kept."""
    (file,) = (folder / "runs/.libraries").glob("*.json")
    trees: dict[str, str] = json.loads(file.read_text())["trees"]
    return trees


def missing(output: str) -> list[str]:
    """The lines on behaviours without a tree."""
    return [line for line in output.splitlines() if "found no tree for" in line]


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
def test_what_the_first_stage_switches_off_is_found_in_a_later_one(
    example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where every skill fails in the first stage, the trees for them are of the second one."""
    assert main([*SHORT_RUN, stages("{failure:1,lost:1}", "{failure:0}")]) == 0
    errors = capsys.readouterr().err
    assert list(library(example)) == list(BEHAVIOURS[:3])  # four rounds place nothing
    first, second = ([x for x in errors.splitlines() if x.endswith(f"stage {n}")] for n in (1, 2))
    none = "islandgp: {}: no tree found in the world of stage {}"
    assert first == [none.format(name, 1) for name in BEHAVIOURS]
    assert [line for line in second if "no tree" in line] == [none.format("placing", 2)]


@pytest.mark.usefixtures("example", "short_search")
def test_stages_with_one_world_are_searched_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A world that was searched shows nothing new in another stage."""
    assert main([*SHORT_RUN, stages("{ticks:12}", "{ticks:12}", "{ticks:13}", "{ticks:12}")]) == 0
    errors = capsys.readouterr().err
    stages_searched = re.findall(r"^islandgp: (\w+): .* in the world of stage (\d)$", errors, re.M)
    assert stages_searched == [*((name, "1") for name in BEHAVIOURS), ("placing", "3")]


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
def test_what_is_missing_is_reported_once_in_every_run(
    example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the run that searches, by one that uses what is kept, and by each run of a sweep.

    Somebody edits the kept file: one line with its path and the behaviour, exit code 2.
    """
    assert main([*SHORT_RUN, IMPOSSIBLE, "gp.founders=true"]) == 0
    line = missing(capsys.readouterr().err)
    assert line == [
        "islandgp: library: found no tree for placing in any stage; supervisors inject none for"
        " that. Write a tree for each behaviour, and name their folder in library.folder"
    ]
    assert list(library(example)) == ["localising", "driving", "picking"]
    assert main([*SHORT_RUN, IMPOSSIBLE, "gp.founders=true", "seed=1", "progress=off"]) == 0
    errors = capsys.readouterr().err
    assert missing(errors) == line
    assert "searching" not in errors
    assert main([*SHORT_RUN, IMPOSSIBLE, "seed=2,3", "-m"]) == 0
    assert missing(capsys.readouterr().err) == line * 2
    (file,) = (example / "runs/.libraries").glob("*.json")
    trees = {**library(example), "driving": "sequence { MoveToPik }"}
    file.write_text(json.dumps({"episodes": 1, "trees": trees}))
    assert main([*SHORT_RUN, IMPOSSIBLE, "seed=4"]) == 2
    errors = capsys.readouterr().err
    assert f"{file.relative_to(example)}: driving:1:12: unknown action 'MoveToPik'" in errors
    assert "Traceback" not in errors


@pytest.mark.slow
@pytest.mark.usefixtures("short_search")
def test_the_search_counts_in_the_budget(example: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Of the run that searches, and of one beside it: a quarter at most, and a generation is left.

    The second job waits for the search of the first. A run that uses no library searches for none.
    """
    short = [word for word in SHORT_RUN if not word.startswith("gp.generations=")]
    budget = (*short, "progress=off", "budget.episodes=200")
    at_once = ("hydra/launcher=local", "hydra.launcher.n_jobs=2")
    assert main([*budget, *at_once, "seed=1,2", "-m"]) == 0
    assert capfd.readouterr().err.count("searching for a tree") == 1
    (file,) = (example / "runs/.libraries").glob("*.json")
    episodes = json.loads(file.read_text())["episodes"]
    assert 40 < episodes <= 50

    def costs() -> list[list[dict[str, int]]]:
        files = sorted(example.glob("runs/*/*/costs.jsonl"))
        return [[json.loads(line) for line in path.read_text().splitlines()] for path in files]

    assert [sum(cost["library"] for cost in run) for run in costs()] == [episodes] * 2
    assert all(episodes < sum(cost["episodes"] for cost in run) <= 200 for run in costs())
    file.unlink()
    for name, *others in (["none", "search=random"], ["least", "budget.episodes=8"]):
        assert main([*budget, f"name={name}", *others]) == 0
    left = [json.loads(path.read_text()) for path in (example / "runs/.libraries").glob("*.json")]
    assert left == [{"episodes": 0, "trees": {}}]


@pytest.mark.usefixtures("example", "short_search")
@pytest.mark.parametrize("supervisor", ["expert", "editor"])
def test_a_run_goes_on_where_no_behaviour_is_found(
    capsys: pytest.CaptureFixture[str], supervisor: str
) -> None:
    """If a world is too hard for random trees, the supervisor sets only rates, with a message."""
    hard = ("world.failure=1", "world.lost=1", "world.ticks=2", "search=paper")
    assert main([*SHORT_RUN, f"supervisor={supervisor}", *hard]) == 0
    (line,) = missing(capsys.readouterr().err)
    assert line.startswith(f"islandgp: library: found no tree for {', '.join(BEHAVIOURS)} in any")
