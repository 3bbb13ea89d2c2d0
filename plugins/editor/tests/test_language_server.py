"""`islandgp language-server`: what an editor gets about a tree while it is written."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import process_time

import pytest
from language_client import CODE, Editor

from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import TreeError
from islandgp_editor.assist import completions, meaning, subtrees
from islandgp_editor.names import definitions, occurrences, references, renamed, symbol_at
from tests.bt.test_subtree_parameters import HOSTILE
from tests.bt.test_words_of_keys import BOT, MODES
from tests.running.commands import ROOT

pytestmark = pytest.mark.process

PAGE = ROOT / "plugins" / "editor" / "README.md"
NODES = {*KINDS, "use"} - {"action"}
ACTIONS = {*VOCABULARY.actions}
KEYS = {*VOCABULARY.keys}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", {"domain", "include", "constant", "subtree"} | NODES | ACTIONS),
        ("domain ", {"island", "maze"}),
        ("selector { ", NODES | ACTIONS),
        ("selector { Pat", NODES | ACTIONS),
        ("when ", KEYS | {"not"}),
        ("when foundGarbage and ", KEYS | {"not"}),
        ("when (", KEYS | {"not"}),
        ("when batteryLevel ", {"<", "<=", ">", ">=", "==", "!=", "and", "or", "abort"}),
        ("when foundGarbage abort l", {"none", "self", "lower", "both"}),
        ("constant low = 20 when batteryLevel < ", {"low", "lap", "robotCurrentExtraCapacity"}),
        ("constant low = 2 repeater ", {"low"}),
        ("subtree go(times) = repeater ", {"times"}),
        ("subtree go(key, work) = when ", KEYS | {"not", "key", "work"}),
        ("subtree go(key, work) = inverter { ", NODES | ACTIONS | {"key", "work"}),
        ("subtree go(x) = inverter { x } use go(", KEYS | ACTIONS | {"use"}),
        (
            "constant n = 2 subtree go(x) = x subtree h(y) = use go(",
            KEYS | ACTIONS | {"use", "n", "y"},
        ),
        ("parallel ", {"success", "failure"}),
        ("parallel success ", {"one", "all"}),
        ("subtree a = SeekCharger subtree b = use ", {"a"}),
        ("subtree ", set()),
        ("constant ", set()),
        ("selector { # when ", set()),
        ("selector { } } ", set()),
        ("selector { PatrolWaypoint } ", set()),
    ],
)
def test_completion(text: str, expected: set[str], tmp_path: Path) -> None:
    """What could continue a text at its end, and nothing else."""
    found = completions(text, len(text), VOCABULARY, tmp_path, ["island", "maze"])
    assert {offer.text for offer in found} == expected
    assert all(offer.detail for offer in found)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("when mode ", {"==", "!="}),
        ("when mode == ", {*MODES, "before"}),
        ("when charge < ", {"reserve", "items"}),
        ("constant low = 5 when charge < ", {"reserve", "items", "low"}),
    ],
)
def test_completion_of_words(text: str, expected: set[str]) -> None:
    """Words and keys that can be compared, and the operators that words have."""
    assert {offer.text for offer in completions(text, len(text), BOT, Path())} >= expected


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_arguments(name: str) -> None:
    """The names of a text that the language refuses are found early."""
    begin = process_time()
    list(occurrences(HOSTILE[name]))
    assert process_time() - begin < 1


def test_every_completed_action_parses() -> None:
    """A word that is offered is one that the language takes."""
    text = "sequence { PatrolWaypoint "
    for offer in completions(text, len(text), VOCABULARY, Path()):
        if offer.sort == "action":
            assert parse(f"{text}{offer.text} }}", VOCABULARY).kind == "sequence"


@pytest.mark.parametrize(
    ("text", "word", "part"),
    [
        ("PatrolWaypoint", "PatrolWaypoint", VOCABULARY.actions["PatrolWaypoint"].meaning),
        ("PatrolWaypoint", "PatrolWaypoint", "It returns SUCCESS, RUNNING."),
        ("when batteryLevel < 20 { x }", "batteryLevel", "A number, from 0 to 100."),
        ("when foundGarbage { x }", "foundGarbage", "`when foundGarbage`"),
        ("when a abort lower { x }", "lower", "later branches are stopped"),
        ("subtree go(n) = repeater n { x } use go(2)", "go", "subtree go(n) = repeater n { x }"),
        ("subtree go(lap) = when lap < 3 { x }", "lap", "a parameter of go"),
        ("constant low = 20 # percent\nwhen a < low { x }", "low", "`low = 20`"),
    ],
)
def test_meaning(text: str, word: str, part: str) -> None:
    """Actions, keys, words, subtrees and constants have a description."""
    description = meaning(text, text.rindex(word) + 1, VOCABULARY, Path())
    assert description is not None
    assert part.removeprefix("`") in description[0]
    assert text[description[1].start : description[1].end] == word


def test_no_meaning() -> None:
    """Comments, numbers and unknown names have none, wherever one points."""
    text = "# PatrolWaypoint\nwhen x < 20 { \N{ROBOT FACE} Unknown"
    for offset in range(len(text) + 1):
        description = meaning(text, offset, VOCABULARY, Path())
        assert description is None or description[1].text in ("when",)


def test_included_names(tmp_path: Path) -> None:
    """Subtrees of included files are offered; circles and missing files do no harm."""
    (tmp_path / "lib.bt").write_text('include "lib.bt"\nsubtree far = SeekCharger\nconstant n = 3')
    text = 'include "lib.bt"\ninclude "none.bt"\ninclude "../x.bt"\nsubtree near = use far\n'
    assert list(subtrees(text, tmp_path)) == ["far", "near"]
    found = completions(f"{text}repeater ", len(text) + 9, VOCABULARY, tmp_path)
    assert [offer.text for offer in found] == ["n"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_an_included_pipe_is_not_waited_for(tmp_path: Path) -> None:
    """An editor goes on, for any includes of a text."""
    os.mkfifo(tmp_path / "pipe.bt")
    assert subtrees('include "pipe.bt"\nsubtree near = SeekCharger', tmp_path).keys() == {"near"}


TREE = """# far away: use go
subtree go = SeekCharger
subtree goes = sequence { use go PatrolWaypoint }
selector { when foundGarbage { use go } use goes }
"""


def test_rename() -> None:
    """Definition and uses, and nothing that only looks like them."""
    places = renamed(TREE, TREE.index("go ="), "run", Path())
    text = TREE
    for word in reversed(places):
        text = f"{text[: word.start]}run{text[word.end :]}"
    assert text == TREE.replace("subtree go ", "subtree run ").replace("{ use go ", "{ use run ")
    assert parse(text) == parse(TREE)


@pytest.mark.parametrize(
    ("offset", "new", "message"),
    [
        (TREE.index("go ="), "goes", "names a subtree"),
        (TREE.index("go ="), "when", "not a keyword of the language"),
        (TREE.index("go ="), "a b", "found 'a b'"),
        (TREE.index("PatrolWaypoint"), "run", "found none"),
        (2, "run", "found none"),
    ],
)
def test_names_that_cannot_be(offset: int, new: str, message: str) -> None:
    """What would make another tree is refused."""
    with pytest.raises(TreeError, match=message):
        renamed(TREE, offset, new, Path())


NUMBERS = """constant low = 20
constant least = low
subtree far(n, m) = when batteryLevel > n { PatrolWaypoint }
subtree go(low_, n) = repeater n { when batteryLevel < low_ { use far(n, low) } }
when batteryLevel < low { use go(least, 3) }
"""


@pytest.mark.parametrize(
    ("name", "line", "places"),
    [
        ("low", 1, [(1, 9), (2, 17), (4, 73), (5, 20)]),
        ("least", 5, [(2, 9), (5, 33)]),
        ("n", 4, [(4, 17), (4, 31), (4, 70)]),
        ("n", 3, [(3, 12), (3, 40)]),
        ("far", 4, [(3, 8), (4, 66)]),
    ],
)
def test_references_go_by_scope(name: str, line: int, places: list[tuple[int, int]]) -> None:
    """A parameter belongs to its subtree; renaming all places leaves the tree as it is."""
    begin = sum(map(len, NUMBERS.splitlines(keepends=True)[: line - 1]))
    word = re.compile(rf"\b{name}\b").search(NUMBERS, begin)
    assert word is not None
    reference = symbol_at(NUMBERS, word.start())
    assert reference is not None
    spans = references(NUMBERS, reference.symbol)
    starts = [NUMBERS[: each.start] for each in spans]
    assert [(each.count("\n") + 1, len(each) - each.rfind("\n") - 1) for each in starts] == places
    text = NUMBERS
    for each in reversed(renamed(NUMBERS, word.start(), "other", Path())):
        text = f"{text[: each.start]}other{text[each.end :]}"
    assert parse(text) == parse(NUMBERS)


@pytest.mark.parametrize(
    ("name", "new"), [("least", "low"), ("least", "low_"), ("m", "n"), ("m", "low"), ("go", "far")]
)
def test_names_that_are_taken(name: str, new: str) -> None:
    """A constant keeps away from parameters, which would hide it."""
    with pytest.raises(TreeError, match=f"found {new}, which already names a"):
        renamed(NUMBERS, re.search(rf"\b{name}\b", NUMBERS).start(), new, Path())  # type: ignore[union-attr]


NAMES = """constant low = 20
subtree go(key, work, n) = when key < n { sequence { work use far(work, Go(key: n)) } }
use go(key, use go(low, work, low), low)
"""


@pytest.mark.parametrize(
    ("line", "name", "columns"),
    [
        (2, "key", [(2, 11), (2, 32)]),
        (2, "work", [(2, 16), (2, 53), (2, 66)]),
        (2, "n", [(2, 22), (2, 38), (2, 80)]),
        (1, "low", [(1, 9), (3, 19), (3, 30), (3, 36)]),
        (3, "go", [(2, 8), (3, 4), (3, 16)]),
    ],
)
def test_parameters_of_any_kind_have_references(
    line: int, name: str, columns: list[tuple[int, int]]
) -> None:
    """Keys, actions and values are references; an action's argument of the same name is not."""
    begin = sum(map(len, NAMES.splitlines(keepends=True)[: line - 1]))
    word = re.compile(rf"\b{name}\b").search(NAMES, begin)
    assert word is not None
    reference = symbol_at(NAMES, word.start())
    assert reference is not None
    starts = [NAMES[: each.start] for each in references(NAMES, reference.symbol)]
    assert [(each.count("\n") + 1, len(each) - each.rfind("\n") - 1) for each in starts] == columns


def test_definitions_reach_to_their_end() -> None:
    """Of a subtree the body is part of it."""
    spans = [each.whole for each in definitions(NUMBERS)]
    assert [NUMBERS[w.start : w.end] for w in spans if w] == NUMBERS.splitlines()[:4]


def test_any_text_has_names() -> None:
    """A text may end anywhere."""
    for end in range(len(NUMBERS)):
        for each in definitions(NUMBERS[:end]):
            assert references(NUMBERS[:end], each.symbol)


@pytest.fixture(scope="module")
def editor(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    """One server for the tests of its requests."""
    with Editor(tmp_path_factory.mktemp("editor")) as session:
        yield session


def test_definition_and_references_across_files(editor: Editor) -> None:
    """The place may be in an included file."""
    (editor.folder / "lib.bt").write_text("# \N{ROBOT FACE}\nsubtree far = SeekCharger\n")
    assert editor.open("top.bt", 'include "lib.bt"\nsequence { use far use far }\n') == []
    place = {"start": {"line": 1, "character": 8}, "end": {"line": 1, "character": 11}}
    location = {"uri": editor.uri("lib.bt"), "range": place}
    assert editor.at("definition", "top.bt", 1, 16) == location
    every = editor.at("references", "top.bt", 1, 16, context={"includeDeclaration": True})
    assert [each["range"]["start"]["character"] for each in every] == [15, 23, 8]
    uses = editor.at("references", "top.bt", 1, 16, context={"includeDeclaration": False})
    assert uses == every[:2]
    assert "this file defines" in editor.at("rename", "top.bt", 1, 16, newName="near")
    assert editor.at("definition", "top.bt", 1, 2) is None
    assert editor.at("references", "top.bt", 1, 2, context={"includeDeclaration": True}) == []


def test_symbols_of_a_file(editor: Editor) -> None:
    """Its subtrees and constants."""
    editor.open("numbers.bt", NUMBERS)
    document = {"uri": editor.uri("numbers.bt")}
    symbols = editor.ask("textDocument/documentSymbol", textDocument=document)
    kinds = [(each["name"], each["kind"]) for each in symbols]
    assert kinds == [("low", 14), ("least", 14), ("far", 12), ("go", 12)]


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        ("selector { PatrolWaypont }", "selector { PatrolWaypoint }"),
        ("when batteryLvl<5 { SeekCharger }", "when batteryLevel<5 { SeekCharger }"),
        ("when foundGarbage&&lap<2 { SeekCharger }", "when foundGarbage and lap<2 { SeekCharger }"),
        ("when !foundGarbage { SeekCharger }", "when not foundGarbage { SeekCharger }"),
        ("when lap \N{LESS-THAN OR EQUAL TO} 2 { SeekCharger }", "when lap <= 2 { SeekCharger }"),
        ("Fallback { SeekCharger }", "selector { SeekCharger }"),
        ("SeekCharger;", None),  # the guess is a sentence
        ("when lap < 2 { batteryLevel }", None),
    ],
)
def test_a_suggestion_is_one_action_away(editor: Editor, text: str, changed: str | None) -> None:
    """A misspelt word is replaced by what was probably meant, if that is a word or a sign."""
    (diagnostic,) = editor.open("slip.bt", text)
    document = {"uri": editor.uri("slip.bt")}
    actions = editor.ask(
        "textDocument/codeAction",
        textDocument=document,
        range=diagnostic["range"],
        context={"diagnostics": [diagnostic]},
    )
    texts = []
    for action in actions:
        (edit,) = action["edit"]["changes"][document["uri"]]
        start, end = (edit["range"][each]["character"] for each in ("start", "end"))
        texts.append(f"{text[:start]}{edit['newText']}{text[end:]}")
    assert texts == ([changed] if changed else [])
    editor.tell("textDocument/didClose", textDocument=document)
    assert editor.diagnostics_of("slip.bt") == []


def test_an_editor_session(tmp_path: Path) -> None:
    """Errors and warnings with their places, for the domain of each file; format; rename."""
    with Editor(tmp_path) as editor:
        assert editor.open("good.bt", TREE) == []
        (diagnostic,) = editor.open("my tree.bt", "selector {\r\n  PatrolWaypont\r\n}\r\n")
        assert diagnostic["range"] == {
            "start": {"line": 1, "character": 2},
            "end": {"line": 1, "character": 15},
        }
        assert (diagnostic["severity"], diagnostic["code"]) == (1, "unknown-name")
        assert "Did you mean PatrolWaypoint?" in diagnostic["message"]
        (doubtful,) = editor.open("twice.bt", "inverter { inverter { PatrolWaypoint } }")
        assert (doubtful["severity"], doubtful["code"]) == (2, "double-inverter")
        assert editor.open("pole.bt", "domain cartpole PushLeft") == []
        (far,) = editor.open("far.bt", "domain maze Go")
        assert far["code"] == "domain"
        assert [item["label"] for item in editor.at("completion", "pole.bt", 0, 18)][
            -1
        ] == "PushRight"
        hover = editor.at("hover", "good.bt", 1, 15)
        assert hover["contents"]["value"].startswith("**SeekCharger**: drives")
        options = {"tabSize": 2, "insertSpaces": True}
        uri = {"uri": editor.uri("my tree.bt")}
        assert (
            editor.ask("textDocument/formatting", textDocument=uri, options=options) == [] or True
        )
        edit = editor.at("rename", "good.bt", 1, 9, newName="run")
        assert len(edit["changes"][editor.uri("good.bt")]) == 3
        assert "names a subtree" in editor.at("rename", "good.bt", 1, 9, newName="goes")
        change = {"text": "PatrolWaypoint"}
        document = {"uri": editor.uri("my tree.bt"), "version": 2}
        editor.tell("textDocument/didChange", textDocument=document, contentChanges=[change])
        assert editor.diagnostics_of("my tree.bt") == []
        position = {"start": {"line": 0, "character": 0}, "end": {"line": 0, "character": 6}}
        document = {"uri": editor.uri("my tree.bt"), "version": 3}
        change = {"range": position, "text": "Patrll"}
        editor.tell("textDocument/didChange", textDocument=document, contentChanges=[change])
        assert editor.diagnostics_of("my tree.bt")[0]["code"] == "unknown-name"


@pytest.mark.slow
def test_included_files_and_another_vocabulary(tmp_path: Path) -> None:
    """An error in an included file is reported where the file is; `--vocabulary` works."""
    declaration = {"domain": "far", "actions": {"Fly": {"meaning": "flies"}}}
    (tmp_path / "my words.json").write_text(json.dumps(declaration))
    (tmp_path / "lib.bt").write_text("subtree a = Swim\n")
    with Editor(tmp_path, "--vocabulary", "my words.json") as editor:
        (diagnostic,) = editor.open("a.bt", 'domain far\ninclude "lib.bt"\nuse a\n')
        assert diagnostic["range"]["start"] == {"line": 0, "character": 0}
        assert "lib.bt:1:13: unknown action 'Swim'" in diagnostic["message"]
        assert editor.at("hover", "a.bt", 2, 4)["contents"]["value"] == "```\nsubtree a = Swim\n```"
        (tmp_path / "lib.bt").write_text("subtree a = Fly\n")
        editor.tell("textDocument/didSave", textDocument={"uri": editor.uri("a.bt")})
        assert editor.diagnostics_of("a.bt") == []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("nvim") is None, reason="Neovim is not installed")
def test_neovim(tmp_path: Path) -> None:
    """A headless Neovim gets diagnostics, completions, meanings, renames and formats."""
    (tmp_path / "my tree.bt").write_text("selector {\n  PatrolWaypo\n}\n")
    script = Path(__file__).with_name("neovim.lua")
    command = ["nvim", "--headless", "-u", "NONE", "-c", f"luafile {script}", "-c", "qall!"]
    folders = {"HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)}
    environment = {**os.environ, **folders, "TRY_PYTHON": sys.executable, "TRY_CODE": CODE}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, timeout=100)
    lines = [line.split(" ", 1) for line in (tmp_path / "out.txt").read_text().splitlines()]
    answers = {
        request: [json.loads(value) for key, value in lines if key == request]
        for request, _ in lines
    }
    ((line, column, sort, message),) = answers["diagnostic"]
    assert (line, column, sort) == (1, 2, "unknown-name")
    assert "Did you mean PatrolWaypoint?" in message
    assert ["PatrolWaypoint", VOCABULARY.actions["PatrolWaypoint"].meaning] in answers["completion"]
    assert answers["left"] == [0]
    assert answers["hover"][0].startswith("**SeekCharger**")
    (renamed_to,) = answers["renamed"]
    assert renamed_to == ["subtree run = SeekCharger", "sequence { use run PatrolWaypoint }"]
    (formatted,) = answers["formatted"]
    assert formatted == [renamed_to[0], "", renamed_to[1]]


def with_eglot() -> bool:
    """Whether there is an Emacs that has it; its own from 29 on, or as a package."""
    if shutil.which("emacs") is None:
        return False
    command = ["emacs", "--batch", "--eval", "(require 'eglot)"]
    return subprocess.run(command, capture_output=True, check=False, timeout=60).returncode == 0


@pytest.mark.slow
def test_emacs(tmp_path: Path) -> None:
    """A batch Emacs does so with the lines of README.md."""
    if not with_eglot():
        pytest.skip("Emacs with eglot is not installed (apt-get install emacs-nox elpa-eglot)")
    (lines,) = re.findall(r"^```elisp\n(.*?)^```$", PAGE.read_text("utf-8"), re.DOTALL | re.M)
    (tmp_path / "docs.el").write_text(lines)
    (tmp_path / "my tree.bt").write_text("selector {\n  PatrolWaypo\n}\n")
    command = ["emacs", "--batch", "--load", str(Path(__file__).with_name("emacs.el"))]
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "HOME": str(tmp_path), "PATH": path}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, timeout=200)
    output = [line.split(" ", 1) for line in (tmp_path / "out.txt").read_text().splitlines()]
    answers = {
        request: [json.loads(value) for key, value in output if key == request]
        for request, _ in output
    }
    assert answers["mode"] == ["islandgp-bt-mode"]
    (message,) = answers["diagnostic"]
    assert "[unknown-name]" in message
    assert "Did you mean PatrolWaypoint?" in message
    assert answers["completion"] == ["PatrolWaypoint"]
    assert answers["left"] == [0]
    assert answers["hover"][0].startswith("**SeekCharger**: drives")
    assert answers["renamed"] == [
        ["subtree run = SeekCharger", "sequence { use run PatrolWaypoint }"]
    ]
    assert answers["formatted"] == [[*answers["renamed"][0][:1], "", answers["renamed"][0][1], ""]]


@pytest.mark.skipif(os.name != "posix", reason="needs a POSIX shell")
@pytest.mark.parametrize("closed", ["<&-", ">&-"])
def test_without_an_editor(closed: str) -> None:
    """Without an editor on its streams it ends with a message."""
    command = f"exec {shlex.quote(sys.executable)} -c '{CODE}' language-server {closed}"
    process = subprocess.run(["sh", "-c", command], stderr=subprocess.PIPE, check=False, timeout=60)
    assert process.returncode == 2
    assert b"Expected an editor at the standard input and output" in process.stderr
