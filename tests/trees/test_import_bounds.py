"""What comes in: each change of meaning is reported; no input takes long or ends in a traceback."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import example, given

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Node, ParallelArgs, leaf, walk
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.import_cpp import read_tree
from islandgp.cli import main
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import LimitError, TreeError
from tests.bt.stage import short_tree
from tests.profiles import examples, sweep
from tests.strategies import nodes
from tests.trees.shell import Cli
from tests.trees.targets import main_tree

A, B = list(VOCABULARY.actions)[:2]
LIMIT = 6.0  # seconds; measured: below 2 for each


def xml_of(*trees: str, head: str = "") -> str:
    """A file with these trees, called T0, T1, ..., the first being the main one."""
    inside = "".join(
        f'<BehaviorTree ID="T{i}">{tree}</BehaviorTree>' for i, tree in enumerate(trees)
    )
    return f'<root BTCPP_format="4" main_tree_to_execute="T0">{head}{inside}</root>'


def short_xml(text: str) -> str:
    for letter, name in zip("ABC", VOCABULARY.actions, strict=False):
        text = text.replace(f"<{letter}/>", f"<{name}/>")
    return text


@examples(max_examples=300)
@given(tree=nodes(nav2=False))
@example(Node("parallel", ParallelArgs("all", "one"), (leaf("PatrolWaypoint"),)))
def test_every_export_comes_back(tree: Node) -> None:
    """Reading what was written gives the tree again, and nothing is lost on the way."""
    if not any(node.kind == "cooldown" for node in walk(tree)):  # which XML has no node for
        assert read_tree(to_xml(tree), VOCABULARY)[:2] == (tree, {})


LOST = {
    "<Sequence><A/><B/></Sequence>": "",
    "<Sequence><ScriptCondition code='lap &lt; 1'/><A/></Sequence>": "",
    "<ReactiveSequence><ScriptCondition code='lap &lt; 1'/><A/></ReactiveSequence>": "",
    "<Sequence><ScriptCondition code='lap == 1'/><A/></Sequence>": "equal",
    "<ReactiveFallback><Sequence><ScriptCondition code='foundGarbage'/><A/></Sequence><B/>"
    "</ReactiveFallback>": "",
    "<Timeout msec='100'><A/></Timeout>": "clock",
    "<Parallel><A/><B/></Parallel>": "judged",
    "<Parallel><A/></Parallel>": "",
    "<Repeat num_cycles='3'><A/></Repeat>": "repeat",
    "<Repeat num_cycles='1'><A/></Repeat>": "",
    "<RepeatPerTick num_cycles='3'><A/></RepeatPerTick>": "",
    "<JudgedParallel success='one' failure='all'><A/><B/></JudgedParallel>": "",
    "<InterruptibleFallback><When condition='lap &lt; 3'><A/></When><B/>"
    "</InterruptibleFallback>": "",
}


@pytest.mark.parametrize("text", LOST)
def test_losses_of_an_import(text: str) -> None:
    """Each node that does not mean quite the same is reported, and no other."""
    imported = read_tree(short_xml(xml_of(text)), VOCABULARY)
    assert {*imported.differences} == set(LOST[text].split())


def test_guards_that_are_not_observed() -> None:
    """A When in a composite of the library interrupts nothing there, so it does not here."""
    guard = "<When condition='foundGarbage'><A/></When>"
    text = short_xml(xml_of(f"<Fallback>{guard}<B/></Fallback>"))
    assert main_tree(text, VOCABULARY) == short_tree("selector { when p abort self { A } B }")
    behind = f"<Sequence><ScriptCondition code='lap &lt; 1'/>{guard}</Sequence>"
    text = short_xml(xml_of(f"<InterruptibleFallback>{behind}<B/></InterruptibleFallback>"))
    tree = main_tree(text, VOCABULARY)
    assert [n.args[1] for n in walk(tree) if n.guard] == ["none", "self"]


def test_a_parallel_that_fails_at_the_first_failure() -> None:
    """With success_count -1 any failure fails it over there, for any failure_count."""
    text = short_xml(xml_of('<Parallel success_count="-1" failure_count="2"><A/><B/></Parallel>'))
    assert main_tree(text, VOCABULARY) == short_tree("parallel { A B }")


def test_subtree_with_a_separate_blackboard() -> None:
    """A SubTree that reads the blackboard without _autoremap is reported."""
    asks = "<Sequence><ScriptCondition code='foundGarbage'/><A/></Sequence>"
    for inside, attributes, expected in (
        (asks, "", ["scope"]),
        (asks, "_autoremap='false'", ["scope"]),
        (asks, "_autoremap='true'", []),
        ("<A/>", "", []),
    ):
        text = short_xml(xml_of(f"<SubTree ID='T1' {attributes}/>", inside))
        losses = [*read_tree(text, VOCABULARY).differences]
        assert losses == expected, (inside, attributes)


def test_remapped_subtrees() -> None:
    """A SubTree asks the keys that its attributes name, through each SubTree around it."""
    asks = "<Sequence><ScriptCondition code='x'/><A/></Sequence>"
    uses = "<Fallback><SubTree ID='T1' y='{foundGarbage}'/><SubTree ID='T1' y='{lap}'/></Fallback>"
    text = short_xml(xml_of(uses, "<SubTree ID='T2' x='{y}'/>", asks))
    with pytest.raises(TreeError, match="lap is a number"):
        read_tree(text, VOCABULARY)
    text = text.replace("{lap}", "{isHumanoidWantToClear}")
    tree = main_tree(text, VOCABULARY)
    assert tree == short_tree("selector { when p abort none { A } when q abort none { A } }")


def test_version_3(islandgp: Cli, tmp_path: Path) -> None:
    """Files of version 3 are read where their nodes mean the same."""
    (tmp_path / "a.xml").write_text(
        "<root main_tree_to_execute='M'><BehaviorTree ID='M'><RetryUntilSuccesful num_attempts='1'>"
        f"<SubTreePlus ID='S' __autoremap='1'/></RetryUntilSuccesful></BehaviorTree>"
        f"<BehaviorTree ID='S'><{A} _description='x'/></BehaviorTree></root>"
    )
    result = islandgp("import", tmp_path / "a.xml")
    assert (result.code, result.err) == (0, "")
    assert result.out == f"# _description: x\nsubtree S = {A}\n\nretry 1 {{ use S }}\n"


def test_included_files(islandgp: Cli, tmp_path: Path) -> None:
    """An <include> brings the trees of a file beside this one; errors name their file."""
    include = "<include path='parts/b.xml'/>"
    (tmp_path / "parts").mkdir()
    (tmp_path / "a.xml").write_text(xml_of("<SubTree ID='T9'/>").replace(">", f">{include}", 1))
    part = tmp_path / "parts" / "b.xml"
    part.write_text(xml_of(f"<{A}/>").replace("T0", "T9"))
    assert f"subtree T9 = {A}" in islandgp("import", tmp_path / "a.xml").out
    part.write_text(xml_of("<Nope/>").replace("T0", "T9"))
    assert "b.xml:" in islandgp("import", tmp_path / "a.xml").err
    for path in ("../a.xml", "./../parts/../a.xml", "b.xml"):  # a circle does no harm
        part.write_text(xml_of(f"<{A}/>", head=f"<include path='{path}'/>").replace("T0", "T9"))
        assert f"subtree T9 = {A}" in islandgp("import", tmp_path / "a.xml").out
    part.write_text(xml_of(f"<{A}/>", head="<include path='../../a.xml'/>"))
    refused = islandgp("import", tmp_path / "a.xml").err
    assert refused.startswith("islandgp: parts/b.xml:1:")
    assert "in the folder of the tree or below" in refused
    assert "found '../../a.xml'" in refused
    part.unlink()
    part.symlink_to("/etc/hostname")
    assert "found 'parts/b.xml'" in islandgp("import", tmp_path / "a.xml").err


def test_one_of_several_trees(islandgp: Cli, tmp_path: Path) -> None:
    """--tree ID chooses; without a main tree the IDs are listed."""
    file = tmp_path / "trees.xml"
    file.write_text(short_xml(xml_of("<A/>", "<B/>")))
    assert islandgp("import", file).out == f"{A}\n"
    assert islandgp("import", file, "--tree", "T1").out == f"{B}\n"
    assert "there are 'T0', 'T1'" in islandgp("import", file, "--tree", "T2").err
    file.write_text(short_xml(xml_of("<A/>", "<B/>")).replace('main_tree_to_execute="T0"', ""))
    result = islandgp("import", file)
    assert (result.code, result.out) == (2, "")
    assert "'T0', 'T1'" in result.err
    assert "--tree ID" in result.err
    assert "there is no <BehaviorTree ID=''>" in islandgp("import", file, "--tree", "").err


def test_a_file_that_cannot_be_imported_is_refused(islandgp: Cli, tmp_path: Path) -> None:
    """An empty file and one in the language are refused with what is expected."""
    for number, text in enumerate(["", "\ufeff\n", f"selector {{ {A} {B} }}"]):
        file = tmp_path / f"my tree {number}.xml"
        file.write_text(text, encoding="utf-8")
        result = islandgp("import", file)
        assert (result.code, result.out) == (2, "")
        assert f"{file}: expected JSON or BehaviorTree.CPP XML, found another format" in result.err


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs /dev/zero")
def test_files_without_an_end(islandgp: Cli, tmp_path: Path) -> None:
    """What is read is bounded, for any kind of input."""
    tree = tmp_path / "a.bt"
    tree.write_text(A)
    for arguments in (["check"], ["fmt"], ["import"], ["check", tree, "--vocabulary"]):
        result = islandgp(*arguments, "/dev/zero")
        assert (result.code, result.out) == (2, "")
        assert "Expected at most 16,777,216 bytes in /dev/zero, found more" in result.err


def test_strict(islandgp: Cli, tmp_path: Path) -> None:
    """A loss is reported with its place; --strict writes nothing."""
    file = tmp_path / "t.xml"
    file.write_text(short_xml(xml_of("<Parallel><A/><B/></Parallel>")))
    result = islandgp("import", file)
    assert result.code == 0
    assert f"{file}:1:" in result.err
    assert "not the same (judged): there, Parallel ends" in result.err
    result = islandgp("import", file, "--strict")
    assert (result.code, result.out) == (2, "")
    assert "leave out --strict" in result.err


WRONG = {
    "includes": (xml_of("<A/>", head='<include path="other.xml"/>'), "the path of a text"),
    "entities": ('<!DOCTYPE r [<!ENTITY x "y">]>' + xml_of("&x;"), "no document type"),
    "external": ('<!DOCTYPE r SYSTEM "file:///etc/passwd">' + xml_of("<A/>"), "no document type"),
    "digits": (
        xml_of(f"<Sequence><ScriptCondition code='lap &lt; {'9' * 400}'/><A/></Sequence>"),
        "from -1000000 to 1000000",
    ),
    "cycles": (xml_of(f"<Repeat num_cycles='{'9' * 5000}'><A/></Repeat>"), "from 1 to 1,000,000"),
    "twice": (xml_of("<A/>").replace("</root>", '<BehaviorTree ID="T0"/></root>'), "defined twice"),
    "abort": (
        xml_of("<When condition='foundGarbage' abort='all'><A/></When>"),
        "expected abort none",
    ),
    "smuggled": (
        xml_of("<When condition='foundGarbage { PatrolWaypoint } when lap'><A/></When>"),
        "unexpected",
    ),
    "op": (xml_of("<When condition='lap'><A/></When>"), "lap is a number"),
    "flag": (xml_of("<When condition='foundGarbage &lt; 1'><A/></When>"), "is a flag"),
    "policy": (xml_of("<JudgedParallel success='two'><A/></JudgedParallel>"), "success from 1 to"),
    "conditions": (
        xml_of("<Sequence>" + "<ScriptCondition code='foundGarbage'/>" * 6000 + "<A/></Sequence>"),
        "at most 100 levels",
    ),
    "terms": (
        xml_of("<Sequence><ScriptCondition code='foundGarbage &amp;&amp; lap'/><A/></Sequence>"),
        "lap is a number",
    ),
    "nothing": (xml_of("<ScriptCondition/>"), "expected a condition such as"),
    "nul": (xml_of("<A/>") + "\0", "not XML"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_xml(case: str) -> None:
    """Each is refused in a message that is short and points into the file."""
    text, message = WRONG[case]
    with pytest.raises(TreeError) as excinfo:
        main_tree(short_xml(text), VOCABULARY, name="t.xml")
    assert message in str(excinfo.value)
    assert str(excinfo.value).startswith("t.xml:1:")
    assert len(str(excinfo.value)) < 500


def test_byte_order_marks(islandgp: Cli, tmp_path: Path) -> None:
    """Files as some editors write them are read."""
    (tmp_path / "t.xml").write_text("\ufeff" + to_xml(leaf(A)), encoding="utf-8")
    assert islandgp("import", tmp_path / "t.xml").out == f"{A}\n"


@pytest.mark.parametrize("command", [["check"], ["fmt"], ["import"], ["export", "--to", "pytrees"]])
def test_closed_input(command: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """`-` with a closed standard input is one line."""
    monkeypatch.setattr(sys, "argv", ["islandgp", *command, "-"])
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2


def test_fmt_goes_on(islandgp: Cli, tmp_path: Path) -> None:
    """A file that is no tree is reported, and those after it are formatted nevertheless."""
    files = [tmp_path / name for name in ("a.bt", "b.bt", "c.bt")]
    for file, text in zip(
        files, (f"selector{{{A}}}", "selector {", f"sequence{{{B}}}"), strict=True
    ):
        file.write_text(text)
    result = islandgp("fmt", *files)
    assert result.code == 2
    assert f"{files[1]}:1:" in result.err
    assert files[2].read_text() == f"sequence {{ {B} }}\n"
    assert files[1].read_text() == "selector {"


def test_diff_without_colour(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NO_COLOR is obeyed where the output could show colours."""
    (tmp_path / "a.bt").write_text(A)
    (tmp_path / "b.bt").write_text(B)
    monkeypatch.setattr("click.utils.should_strip_ansi", lambda *_, **__: False)
    monkeypatch.setattr("click._compat.should_strip_ansi", lambda *_, **__: False)
    assert "\x1b[" in islandgp("diff", tmp_path / "a.bt", tmp_path / "b.bt").out
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b[" not in islandgp("diff", tmp_path / "a.bt", tmp_path / "b.bt").out


# Sizes: linear, or refused at once.


def doubled(count: int) -> str:
    """A small file whose trees use each other twice: 2^count leaves, were they expanded."""
    use = "<Sequence><SubTree ID='T{0}'/><SubTree ID='T{0}'/></Sequence>"
    return short_xml(xml_of(*(use.format(i + 1) for i in range(count)), "<A/>"))


def quick(act: object, *arguments: object) -> object:
    before = time.process_time()
    try:
        return act(*arguments)  # type: ignore[operator]
    except TreeError as error:
        return error
    finally:
        assert time.process_time() - before < LIMIT


def test_subtrees_that_double() -> None:
    """20 trees in 2 kB are refused before they are expanded; few are read."""
    assert isinstance(quick(main_tree, doubled(20), VOCABULARY), LimitError)
    assert isinstance(quick(main_tree, doubled(90), VOCABULARY), LimitError)
    assert isinstance(quick(main_tree, doubled(8), VOCABULARY), Node)


@pytest.mark.slow
def test_many_children() -> None:
    """2,000 children are read; 200,000 are refused."""
    for tag in ("Sequence", "Fallback", "JudgedParallel", "InterruptibleSequence"):
        text = short_xml(xml_of(f"<{tag}>{'<A/>' * 2000}</{tag}>"))
        node = quick(main_tree, text, VOCABULARY)
        assert isinstance(node, Node)
        assert len(node.children) == 2000
    text = short_xml(xml_of(f"<Sequence>{'<A/>' * 200_000}</Sequence>"))
    assert isinstance(quick(main_tree, text, VOCABULARY), LimitError)


def guarded(levels: int, actions: Sequence[str]) -> str:
    """Actions in a sequence below nested guards."""
    lines = [f"when batteryLevel < {100 - i} {{" for i in range(levels)]
    return " ".join([*lines, "sequence {", *actions, "}", "}" * levels])


@sweep(
    ("levels", "count"), [(20, 1500), (1, 6000), (95, 300)], ids=["both", "wide", "deep"], quick=1
)
def test_check_of_large_trees(levels: int, count: int) -> None:
    """check takes a second or two for the largest trees that there are."""
    for actions in (["SeekCharger"], ["MoveToGarbage", "ExecuteCharge"]):
        text = guarded(levels, actions * (count // len(actions) ** 2))
        assert isinstance(quick(warnings, text, VOCABULARY), list)


def test_an_import_that_is_too_long_to_be_read_is_refused() -> None:
    """A tree whose canonical text is too long to be read back is refused."""
    lines = ["subtree s0 = sequence { SeekCharger ExecuteCharge }"]
    lines += [f"subtree s{i + 1} = selector {{ use s{i} use s{i} }}" for i in range(11)]
    for last, refused in ((8, False), (11, True)):
        text = "\n".join([*lines[: last + 1], f"use s{last}"])
        if refused:
            with pytest.raises(LimitError, match=r"(?s)canonical text.*at most 100000"):
                parse(text, VOCABULARY)
        else:
            tree = parse(text, VOCABULARY)
            assert parse(to_text(tree), VOCABULARY) == tree


def test_formatted_files_can_be_read() -> None:
    """So is a file that fmt would make too long, by indenting its comments."""
    comments = "\n".join(["# what a person wrote"] * 2000)
    text = "".join(["inverter {"] * 60) + "\n" + comments + f"\n{A}" + "}" * 60
    assert parse(text, VOCABULARY)
    with pytest.raises(LimitError, match="canonical form of at most 100000"):
        format_text(text)
