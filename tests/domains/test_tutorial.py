"""docs/own_domain.md: its code is that of the example, and each of its commands runs."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import ActionArgs, walk
from islandgp.bt.core.parameters import bound
from islandgp.bt.core.vocabulary import Vocabulary
from islandgp.evolution import single_behaviours
from islandgp.running.app import main
from tests.llm.server import MessagesServer
from tests.running.commands import Command, in_process

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "pick_place"
PAGE = (ROOT / "docs" / "own_domain.md").read_text(encoding="utf-8")
ARGUMENTS = "from islandgp.domain import Action, condition_leaf"
NOT_IN_EXAMPLE = ("library:\n  folder: trees", "from dataclasses import replace", ARGUMENTS)
"""How the snippets begin that are not part of the example; test_outside runs the second."""
SMALL = ("gp.population=6", "gp.generations=4")
QUICK = ("tracking=off", "progress=off", "evaluator=serial")


def commands() -> list[list[str]]:
    """The page's commands, in its order."""
    blocks = re.findall(r"```console\n(.*?)```", PAGE, re.DOTALL)
    lines = [line.removeprefix("$ ") for block in blocks for line in block.splitlines()]
    return [shlex.split(line) for line in lines]


def test_the_code_is_the_examples() -> None:
    """Each snippet of the page is in a file of the example, to the letter."""
    files = [
        path.read_text(encoding="utf-8")
        for path in EXAMPLE.rglob("*")
        if path.suffix in (".py", ".yaml", ".bt")
    ]
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    snippets = [text for language, text in blocks if language in ("", "python", "yaml")]
    assert len(snippets) > 8
    strange = [
        snippet
        for snippet in snippets
        if not any(snippet in text for text in files) and not snippet.startswith(NOT_IN_EXAMPLE)
    ]
    assert strange == []


def test_arguments_have_the_types_and_defaults_of_the_page() -> None:
    """The snippet declares them, and leaves get them as the text below it describes."""
    [snippet] = re.findall(rf"```python\n({ARGUMENTS}.*?)```", PAGE, re.DOTALL)
    names: dict[str, Any] = {}
    exec(snippet, names)
    vocabulary = Vocabulary("arm", names["ACTIONS"], {})
    tree = parse("sequence { MoveTo Grip Grip(tries: 3, gently: yes) Say IsPathClear }", vocabulary)
    leaves = [node.args for node in walk(tree) if isinstance(node.args, ActionArgs)]
    assert [bound(args, vocabulary.action(args.name).arguments) for args in leaves] == [
        {"goal": "dock", "speed": 0.5},
        {"force": 12.5, "tries": 1, "gently": False},
        {"force": 12.5, "tries": 3, "gently": True},
        {"what": "hello"},
        {"to": "dock"},
    ]


def test_the_domain_is_short() -> None:
    """The whole domain is less than 135 lines of plain Python."""
    text = (EXAMPLE / "pick_place.py").read_text(encoding="utf-8")
    assert len([line for line in text.splitlines() if line.strip()]) < 135


def follow(folder: Path, runner_in: Callable[[Path], Command], *small: str) -> str:
    """Runs the page's commands in a copy of the example; returns all that they printed.

    Args:
        folder: An empty folder, where the copy is made.
                runner_in: Returns a function that runs commands in the given folder.
        small: Overrides that every run takes besides.
    """
    example = folder / "pick and place"  # a name with blanks, as people have
    shutil.copytree(EXAMPLE, example, ignore=shutil.ignore_patterns("__pycache__", "runs"))
    run, output = runner_in(example), ""
    for arguments in commands():
        if arguments[:3] == ["python", "-m", "islandgp"]:
            output += run("run", *arguments[3:], *QUICK, *small)
        else:
            output += run(*arguments[1:])
    assert "Expected" not in output
    assert ElementTree.parse(example / "carry.xml").getroot().tag == "root"
    assert "<html" in (example / "carry.html").read_text(encoding="utf-8")
    return output


Run = Callable[..., str]


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Run]:
    """Runs the program in an empty folder; returns what it printed."""
    module = sys.modules.pop("pick_place", None)  # that of another test
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(EXAMPLE))
    monkeypatch.delenv("ANTHROPIC_API_KEY", raising=False)
    monkeypatch.setattr(single_behaviours, "ROUNDS", 4)  # of the search for a library

    def output_of(*overrides: str) -> str:
        assert main([*overrides, *QUICK]) == 0
        return capsys.readouterr().out

    yield output_of
    sys.modules.pop("pick_place", None)
    if module is not None:
        sys.modules["pick_place"] = module


@pytest.mark.slow
def test_the_commands_run(tmp_path: Path) -> None:
    """From check to compare, on small runs, in a folder with a blank in its name."""
    assert "irst Finished Robot" in follow(tmp_path, in_process, *SMALL)


@pytest.mark.slow
@pytest.mark.parametrize("supervisor", ["baseline", "editor", "expert"])
def test_every_supervisor_runs(run: Run, supervisor: str) -> None:
    """Each supervisor that needs no server runs on the domain."""
    overrides = ("--config-dir", str(EXAMPLE / "conf"), "domain=pick_place", "experiment=smoke")
    assert "Best robot" in run(*overrides, f"supervisor={supervisor}")


@pytest.mark.slow
def test_a_language_model_supervises_it(tmp_path: Path, run: Run) -> None:
    """Prompts, answers and trees of the domain, against the mock model; then the replay."""
    common = ("--config-dir", str(EXAMPLE / "conf"), "domain=pick_place", *SMALL)
    with MessagesServer() as server:
        overrides = ("supervisor=llm", f"supervisor.policy.base_url={server.url}", "runs=live")
        live = run(*common, *overrides)
        prompts = " ".join(str(request) for request in server.requests)
    assert "at most" not in live  # a note on answers that were lost
    assert "A mobile robot with an arm carries blocks" in prompts
    assert "MoveToPlace" in prompts
    assert "PatrolWaypoint" not in prompts
    (record,) = (tmp_path / "live").rglob("generations.jsonl")
    sources = [json.loads(line)["guidance"] for line in record.read_text().splitlines()][:-1]
    assert {guidance["source"] for guidance in sources} == {"llm"}
    replayed = f"supervisor.policy.transcript='{record.parent}'"
    run(*common, "supervisor=replay", replayed, "runs=again")
    (repeated,) = (tmp_path / "again").rglob("generations.jsonl")
    assert repeated.read_bytes() == record.read_bytes()
