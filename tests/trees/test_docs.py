"""The documentation of the language: generated parts are up to date, every command runs."""

from __future__ import annotations

import importlib.util
import re
import shlex
from pathlib import Path
from types import ModuleType

import pytest
from click.shell_completion import ShellComplete

from islandgp.bt.core.format import format_text
from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.export.render import to_svg
from islandgp.cli import COMMANDS
from islandgp.cli import islandgp as group
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.resources import resource
from tests.trees.shell import Cli, CommandResult

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((resource("grammar") / "examples").glob("*.bt"))


def _generate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


generate = _generate()
TUTORIAL = generate.TUTORIAL.read_text(encoding="utf-8")


def test_language_is_up_to_date() -> None:
    """docs/language.md has the tables that the declarations give (python docs/generate.py)."""
    text = generate.LANGUAGE.read_text(encoding="utf-8")
    assert generate.filled(text, generate.tables()) == text
    for name in (
        *VOCABULARY.actions,
        *VOCABULARY.keys,
        *(kind for kind in KINDS if kind != "action"),
    ):
        assert name in text


def test_parameters_are_as_documented() -> None:
    """The two files of docs/language.md are equal trees in canonical form."""
    files = generate.files(generate.LANGUAGE.read_text(encoding="utf-8"))
    assert format_text(files["fetch.bt"]) == files["fetch.bt"]
    assert to_text(parse(files["fetch.bt"])) == files["fetch_expanded.bt"]


def test_the_vocabulary_file_fits_its_trees(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The trees and the vocabulary of docs/language.md are checked as the page shows it."""
    page = generate.LANGUAGE.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name, text in re.findall(r"^```(?:bt|json) (\S+)\n(.*?)^```$", page, re.S | re.M):
        Path(name).write_text(text, encoding="utf-8")
    command, shown = (
        re.search(rf"^```{kind} robot\n(.*?)^```$", page, re.S | re.M)[1]  # type: ignore[index]
        for kind in ("sh", "text")
    )
    result = islandgp(*command.split()[1:])
    assert (result.code, result.out) == (0, shown)


def test_the_drawing_of_a_tree_is_up_to_date() -> None:
    """docs/img/patrol.svg is the drawing of the tree above it, whose text is canonical."""
    match = re.search(r"```bt patrol.bt\n(.*?)```", generate.LANGUAGE.read_text("utf-8"), re.DOTALL)
    assert match is not None
    assert format_text(match[1]) == match[1]
    drawing = (ROOT / "docs" / "img" / "patrol.svg").read_text(encoding="utf-8")
    assert drawing == to_svg(parse(match[1]))


def test_costs_are_up_to_date() -> None:
    """docs/llm.md has the table that today's prices give for what was measured there."""
    text = generate.COST.read_text(encoding="utf-8")
    sizes = generate.documented_characters(text)
    assert list(sizes) == ["paper", "informed"]
    assert generate.cost_table(sizes) in text


def test_tab_completion() -> None:
    """The shell is offered the commands by their beginning, and files for their arguments."""
    complete = ShellComplete(group, {}, "islandgp", "_ISLANDGP_COMPLETE")
    assert [item.value for item in complete.get_completions([], "s")] == [
        name for name in COMMANDS if name.startswith("s")
    ]
    assert [item.type for item in complete.get_completions(["check"], "")] == ["file"]
    options = [item.value for item in complete.get_completions(["play"], "--")]
    assert {"--seeds", "--stage", "--set"} <= set(options)


def commands(text: str) -> list[str]:
    """The lines of the blocks that begin with ```sh."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in block.splitlines()]


WITH_EPISODES = ("run", "play", "trace", "replay", "prune", "explain")


def _result_of(islandgp: Cli, arguments: list[str]) -> CommandResult:
    """The outcome of a command; `> FILE` at its end writes its output, as a shell does."""
    if ">" not in arguments:
        return islandgp(*arguments)
    *command, _, file = arguments
    result = islandgp(*command)
    Path(file).write_text(result.out, encoding="utf-8")
    return result


def test_tutorial_runs(islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands of the tutorial that need no episode run unchanged; the slow test runs all."""
    monkeypatch.chdir(tmp_path)
    for name, text in generate.files(TUTORIAL).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    for line in commands(TUTORIAL):
        program, *arguments = shlex.split(line)
        assert program == "islandgp"
        if arguments[0] in WITH_EPISODES or "runs/" in line:
            continue
        result = _result_of(islandgp, arguments)
        assert result.code == (arguments[0] == "diff"), line
        if arguments == ["check", "interrupted_charge.bt"]:
            assert "ExecuteCharge can never succeed" in result.out
        elif arguments[0] == "check":
            assert "warning:" not in result.out


@pytest.mark.slow
def test_tutorial_shows_the_output(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each line of its ```text blocks begins one that the commands before it print."""
    monkeypatch.chdir(tmp_path)
    for name, text in generate.files(TUTORIAL).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    printed_lines: list[str] = []
    count = 0
    for kind, block in re.findall(r"^```(sh|text)\n(.*?)^```$", TUTORIAL, re.DOTALL | re.MULTILINE):
        if kind == "sh":
            printed_lines = []
            for command in block.splitlines():
                arguments = shlex.split(command)[1:]
                result = _result_of(islandgp, arguments)
                assert result.code == (arguments[0] == "diff"), command
                printed_lines += [line.rstrip() for line in result.out.splitlines()]
            continue
        count += 1
        for line in block.splitlines():
            assert any(printed.startswith(line) for printed in printed_lines), line
    assert count >= 10


def test_tutorial_trees_are_in_canonical_form() -> None:
    """What the tutorial shows is how `fmt` writes it, but for the first tree's three lines."""
    for name, text in generate.files(TUTORIAL).items():
        parse(text)
        if name != "patrol.bt":
            assert format_text(text) == text


def test_exports_page_runs(islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands of docs/exports.md run unchanged, where the examples are."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grammar").symlink_to(resource("grammar"))
    for line in commands((ROOT / "docs" / "exports.md").read_text(encoding="utf-8")):
        assert islandgp(*shlex.split(line)[1:]).code == 0, line
