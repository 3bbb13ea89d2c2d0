"""docs/search.md: its loop, its search and its commands run unchanged; its table is complete."""

from __future__ import annotations

import json
import re
import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import islandgp
from islandgp.bt.core.language import parse
from islandgp.evolution.loop import evolve
from islandgp.running.app import main
from tests.evolution.fake import Fake
from tests.evolution.runs import Constant
from tests.profiles import sweep
from tests.running.commands import ROOT
from tests.search.searches import NAMES

TEXT = (ROOT / "docs/search.md").read_text(encoding="utf-8")
SMALL = ("gp.population=6", "gp.generations=4", "world.episode.length=20", "progress=off")


def blocks(kind: str) -> list[str]:
    """The blocks ```KIND of the page."""
    return re.findall(rf"^```{kind}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


COMMANDS = [shlex.split(line) for block in blocks("sh") for line in block.splitlines()]
RUNS = [command[3:] for command in COMMANDS if command[0] == "python"]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with the page's search in it."""
    _, module = blocks("python")
    (yaml,) = blocks("yaml")
    (tmp_path / "truncation.py").write_text(module, encoding="utf-8")
    (tmp_path / "mine" / "search").mkdir(parents=True)
    (tmp_path / "mine" / "search" / "truncation.yaml").write_text(yaml, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_every_search_has_its_row() -> None:
    """The table has what conf/search has, and names its papers."""
    rows = re.findall(r"^\| `(\w+)`[^|]*\|[^|]*\|([^|]*)\|[^|]+\|$", TEXT, re.MULTILINE)
    assert sorted(name for name, _ in rows) == NAMES
    cited = {name for name, paper in rows if re.search(r"\d{4}|\[the paper\]", paper)}
    assert set(NAMES) - cited == {"random", "random_paper", "compose"}


@sweep("arguments", RUNS, ids=" ".join, quick=3)
def test_every_command_composes(arguments: list[str], project: Path) -> None:
    """Without running it."""
    config_dir = project / "mine" if "--config-dir" in arguments else None
    plain = [w for w in arguments if w not in ("-m", "--config-dir", "mine") and "," not in w]
    assert islandgp.compose(*plain, config_dir=config_dir).settings.search.name in (
        *NAMES,
        "truncation",
    )


@pytest.mark.slow
def test_every_command_runs(project: Path) -> None:
    """One after the other in one folder, on small runs; the comparison finds both arms."""
    from click.testing import CliRunner

    from islandgp.cli import islandgp as command

    for arguments in COMMANDS:
        if arguments[0] == "python":
            small = SMALL if "budget" not in " ".join(arguments) else (*SMALL[:1], *SMALL[2:])
            assert main([*small, *arguments[3:], "evaluator=serial"]) == 0
        else:
            result = CliRunner().invoke(command, arguments[1:])
            assert result.exit_code == 0, result.output
    assert list((project / "runs").rglob("summary.json"))


def test_the_loop_runs_unchanged(capsys: pytest.CaptureFixture[str]) -> None:
    """A line for each generation, and the best tree of the last one."""
    loop = blocks("python")[0]
    exec(loop.replace("gp.population=20", "gp.population=6").replace("range(10)", "range(3)"), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines[:3]] == ["0", "1", "2"]
    assert parse("\n".join(lines[3:]))
    assert len(loop.splitlines()) <= 20


@sweep("name", [name for name in NAMES if name != "paper"], quick=2)
def test_a_user_s_loop_equals_the_run(name: str) -> None:
    """With the same seed and advice; but for the paper's search, whose rate rises in a crisis."""
    experiment = islandgp.compose(
        f"search={name}", "supervisor=baseline", "seed=3", *SMALL, "tracking=off"
    )
    search, streams = experiment.search(), islandgp.Streams(seed=3)
    state, loop = search.start(), []
    for generation in range(4):
        individuals = search.ask(state, streams)
        evaluated = experiment.evaluate_population(individuals, generation)
        state = search.tell(state, evaluated, islandgp.Advice(rate=0.3))
        loop.append(
            [(e.individual.id, islandgp.to_text(e.individual.tree), e.fitness) for e in evaluated]
        )

    class Serial(Fake):
        def evaluate(self, jobs: Any) -> Any:
            return [experiment.evaluate(job.tree, [job.seed], stage=job.stage)[0] for job in jobs]

    steps = evolve(experiment.plan, 3, Constant(0.3), Serial(), search=experiment.search())
    run = [[(i.id, i.tree, i.fitness) for i in step.record.individuals] for step in steps]
    assert loop == run


def test_a_user_s_worlds() -> None:
    """Each individual meets the given worlds, and is worth their mean."""
    experiment = islandgp.compose("search=hill", *SMALL)
    individuals = [*experiment.search().ask(experiment.search().start(), islandgp.Streams(0))][:2]
    evaluated = experiment.evaluate_population(individuals, 2, worlds=[5, 6, 7])
    for e in evaluated:
        single = experiment.evaluate(e.individual.tree, [5, 6, 7], stage=0)
        assert e.episodes == tuple(o.fitness for o in single)
        assert e.fitness == pytest.approx(sum(e.episodes) / 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"generation": -1}, r"^generation: expected 0 or more, found -1$"),
        ({"generation": 1.5}, r"^generation: expected 0 or more, found 1\.5$"),
        ({"worlds": []}, r"^worlds: expected at least one seed, found none$"),
        ({"worlds": [-3]}, r"^worlds: expected seeds from 0 to 4294967295, found -3$"),
    ],
)
def test_a_generation_or_world_that_is_not_there(options: dict[str, Any], message: str) -> None:
    """The error comes before any episode."""
    experiment = islandgp.compose("search=hill", *SMALL)
    individuals = experiment.search().ask(experiment.search().start(), islandgp.Streams(0))
    with pytest.raises(islandgp.IslandError, match=message):
        experiment.evaluate_population(individuals, **options)


def test_a_user_s_search_from_the_command_line(project: Path) -> None:
    """From a module and a YAML file outside of the package."""
    arguments = ["--config-dir", "mine", "search=truncation", "experiment=smoke", "tracking=off"]
    assert main([*arguments, *SMALL, "evaluator=serial", "supervisor=expert"]) == 0
    (file,) = project.glob("runs/smoke/*/generations.jsonl")
    records = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    assert len(records) == 4
    for before, after in pairwise(records):
        best = max(before["individuals"], key=lambda i: i["fitness"])
        elite, injected, *children = after["individuals"]
        assert (elite["origin"], elite["parents"]) == ("elite", [best["id"]])
        assert injected["origin"] == "injected"
        assert before["guidance"]["injected"]
        names = {i["id"] for i in before["individuals"]}
        assert all(names.issuperset(i["parents"]) for i in children)


@sweep(
    ("name", "word", "line"),
    [
        (
            "map_elites",
            "descriptor=[pickups,pickups]",
            "each name once, found 'pickups' twice",
        ),
        ("novelty", "descriptor=[laps,laps]", "expected each name once, found 'laps' twice"),
        (
            "nsga2",
            "objectives=[fitness,-fitness]",
            "each name once, found 'fitness' twice",
        ),
        ("racing", "bound_width=inf", "input should be a finite number"),
        ("racing", "parsimony=inf", "input should be a finite number"),
    ],
    quick=3,
)
def test_a_setting_without_effect_is_refused(name: str, word: str, line: str) -> None:
    """In one line, before anything runs: a counter twice, or an infinite weight."""
    with pytest.raises(islandgp.IslandError, match=line) as excinfo:
        islandgp.compose(f"search={name}", f"search.policy.{word}")
    assert "\n" not in str(excinfo.value)
