"""What reads foreign or damaged input, each with a promise that any bytes must keep.

A target's `check` returns whether the input was taken. It raises nothing but for a broken
promise: a refusal is an `IslandError` (or a value that marks it), a tree that was taken comes back
from each form that it is written in, and a page holds its data.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import shutil
import tempfile
from argparse import Namespace
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Final

from hydra._internal.utils import get_args_parser
from hypothesis import strategies as st

from islandgp.bt.analysis.lint import warnings
from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node
from islandgp.bt.core.parameters import adapter
from islandgp.bt.export.behaviortree_cpp import to_xml
from islandgp.bt.export.declared import declared
from islandgp.bt.export.import_cpp import read_tree
from islandgp.bt.export.json import from_json, to_json
from islandgp.compare.arms import Arm, find
from islandgp.compare.measures import read_runs
from islandgp.config.compose import planned
from islandgp.domain import Scene, Schema, Shape
from islandgp.domains.island.vocabulary import SCHEMA, VOCABULARY
from islandgp.errors import IslandError
from islandgp.evaluation.base import Problem
from islandgp.records.files import dump
from islandgp.records.folder import RunFolder
from islandgp.resources import resource
from islandgp.results import load
from islandgp.supervision.llm.answers import Accepted, check_decision, check_proposal
from islandgp.supervision.llm.budget import Ledger
from islandgp.supervision.llm.message import Reply, read_body, refused
from islandgp.supervision.llm.settings import Caps, LLMSettings
from islandgp.supervision.llm.transcript import Transcript
from islandgp.supervision.replay import Replay, ReplaySettings
from islandgp.viewer.page import page
from tests.fuzz.inputs import as_json, swapped, swaps, texts, values
from tests.llm.samples import DECISION as DECIDED
from tests.llm.samples import PROPOSAL, advise, answering, context, outcome, settings, supervisor
from tests.tracking.folders import closed_run
from tests.viewer.episodes import small

EXAMPLES: Final = sorted((resource("grammar") / "examples").glob("*.bt"))

TREES: Final = (
    *(file.read_bytes() for file in EXAMPLES[:4]),
    b"constant a = 3 subtree s(x, y) = when lap < x and not (foundGarbage or lap > y)"
    b" { repeater 2 { SeekCharger } } selector { use s(a, 2) when not lap < a or foundGarbage"
    b" abort lower { PatrolWaypoint } PatrolWaypoint }",
    b"subtree s(k, v, go) = when k < v { go } subtree t(x) = selector { x use s(lap, 2, x) }"
    b" use t(use s(batteryLevel, lap, use t(SeekCharger)))",
    b"domain island subtree r = sequence { SeekCharger ExecuteCharge } parallel success one"
    b" failure all { when batteryLevel < 20 abort lower { use r } inverter { PatrolWaypoint } }",
)

TOKENS: Final = tuple(
    b"selector sequence parallel inverter repeater when and or not ( ) { } , = abort lower none"
    b" both self use subtree constant include domain island success failure one all 1 2 3.5 -4 1e5"
    b" < <= == != > >= foundGarbage isHumanoidWantToClear lap batteryLevel PatrolWaypoint"
    b" SeekCharger"
    b' a b x "a.bt" "../a.bt" "/etc/passwd" # \n'.split(b" ")
)

XML_TOKENS: Final = (
    b'<root BTCPP_format="4">', b"</root>", b'<BehaviorTree ID="A">', b"</BehaviorTree>",
    b'<SubTree ID="A"/>', b"<Sequence>", b"</Sequence>", b"<Fallback>", b"</Fallback>",
    b"<ReactiveSequence>", b"</ReactiveSequence>", b"<Inverter>", b"</Inverter>",
    b"<ScriptCondition code='lap &lt; 1'/>", b'<Repeat num_cycles="3">', b"</Repeat>",
    b"<PatrolWaypoint/>", b"<SeekCharger name='rest'/>", b"&amp;", b"&lol;", b"&#0;", b"&#x10ffff;",
    b"<!DOCTYPE root [<!ENTITY lol 'lol'>]>", b"<!DOCTYPE r SYSTEM 'file:///etc/passwd'>",
    b"<?xml version='1.0' encoding='utf-16'?>", b"<?xml version='1.1'?>", b"<![CDATA[", b"]]>",
    b"<!--", b"-->", b"<include path='/etc/passwd'/>", b"xmlns:a='b'", b"<TreeNodesModel>",
    b"</TreeNodesModel>", b'<Action ID="selector"/>', b'_autoremap="true"', b"code='", b"1", b"'",
)  # fmt: skip


@dataclass(frozen=True)
class Target:
    """A reader, and what it is fed with."""

    inputs: st.SearchStrategy[bytes]
    check: Callable[[bytes], bool]  # whether the input was taken
    seeds: Callable[[], Sequence[bytes]]  # sound inputs
    share: float  # of a budget of inputs


def text_of(data: bytes) -> str:
    """As commands read files, but for bytes that are no UTF-8: those are lone surrogates here."""
    return data.decode("utf-8", "surrogateescape")


def same_everywhere(tree: Node) -> None:
    """A tree comes back from each form that it is written in."""
    assert parse(to_text(tree), VOCABULARY) == tree
    assert from_json(to_json(tree), VOCABULARY) == tree
    assert read_tree(to_xml(tree), VOCABULARY).tree == tree


def language(data: bytes) -> bool:
    """`check`, `fmt` and `export`."""
    text = text_of(data)
    try:
        formatted = format_text(text)
    except IslandError:
        formatted = ""
    try:
        tree = parse(text, VOCABULARY)
    except IslandError:
        return False
    warnings(text, VOCABULARY)
    assert format_text(formatted) == formatted
    assert parse(formatted, VOCABULARY) == tree
    same_everywhere(tree)
    return True


def xml(data: bytes) -> bool:
    """`import` of XML; the same file as a declaration."""
    try:
        declared(text_of(data), "PatrolWaypoint", name="m.xml")
        declared(as_json({"actions": {"A": {}}, "domain": "d"}).decode(), text_of(data), name="m")
    except IslandError:
        pass
    try:
        tree_import = read_tree(text_of(data), VOCABULARY)
    except IslandError:
        return False
    same_everywhere(tree_import.tree)
    return True


def json_tree(data: bytes) -> bool:
    """`import` of JSON."""
    try:
        tree = from_json(text_of(data), VOCABULARY)
    except IslandError:
        return False
    same_everywhere(tree)
    return True


def declaration(data: bytes) -> bool:
    """`--vocabulary FILE`."""
    try:
        vocabulary = declared(text_of(data), "when lap < 3 { PatrolWaypoint }", name="v.json")
    except IslandError:
        return False
    try:
        warnings("when lap < 3 { PatrolWaypoint }", vocabulary)
    except IslandError:
        return False
    return True


CHECKS: Final[tuple[Callable[[Reply], Any], ...]] = (
    partial(check_decision, rates=(0.05, 0.9)),
    partial(check_proposal, limits=Limits(8, 50), vocabulary=VOCABULARY, targets=("rare", "first")),
)


def answer(data: bytes) -> bool:
    """A server's body, and each check of its answer; all that is kept can be written down."""
    text = text_of(data)
    assert (refused(429, text, {"retry-after": text[:200]}).retry_after or 0) >= 0
    message = read_body("anthropic", text)
    accepted = False
    for reply in (message, Reply(text, "end_turn", None), Reply(text, "max_tokens", None)):
        if isinstance(reply, Reply):
            for check in CHECKS:
                checked = outcome(check, reply)
                accepted |= isinstance(checked, Accepted)
                repr(checked).encode()
        else:
            reply.message.encode()
    return accepted


@cache
def place() -> Path:
    """A folder for this process, in memory where that is to be had."""
    memory = Path("/dev/shm")
    folder = tempfile.mkdtemp(prefix="fuzz-", dir=memory if memory.is_dir() else None)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@cache
def runs() -> tuple[Path, Path]:
    """A finished run's folder, and one of a run that was stopped."""
    complete = closed_run(place() / "made/whole", place()).path
    stopped = closed_run(place() / "made/stopped", place(), 3).path
    return complete, stopped


FILES: Final = (
    "generations.jsonl", "summary.json", "about.json", "config.yaml", "costs.jsonl",
    "checkpoint.json", "best.bt",
)  # fmt: skip


@st.composite
def damaged_files(draw: st.DrawFn) -> bytes:
    """The name of one file of a run, whether the run is finished, and other contents for it."""
    finished = draw(st.integers(0, 1))
    folder = runs()[1 - finished]
    name = draw(st.sampled_from([file for file in FILES if (folder / file).exists()]))
    data = (folder / name).read_bytes()
    if name.endswith((".json", ".jsonl")) and draw(st.integers(0, 3)):
        lines = [json.loads(line) for line in ([data] if name[-1] == "n" else data.splitlines())]
        at = draw(st.integers(0, len(lines) - 1))
        lines[at] = swapped(lines[at], draw(swaps()))
        if name.startswith("checkpoint") and isinstance(lines[0], dict) and draw(st.booleans()):
            lines = [signed(lines[0].get("state"))]
        data = b"\n".join(map(as_json, lines)) + b"\n"
    else:
        data = draw(
            texts([data], (b"tree", b"seed: 1", b"- a", b"&a [*a]", b"!!python/name:os.system"))
        )
    return f"{finished} {name}\n".encode() + data


def signed(state: Any) -> dict[str, Any]:
    """A checkpoint whose checksum is right, with any content."""
    try:
        body = dump(state)
        return {"sha256": hashlib.sha256(body.encode()).hexdigest(), "state": state}
    except (ValueError, RecursionError):
        return {"sha256": "", "state": state}


def records(data: bytes) -> bool:
    """All that reads a run's folder: resumption, `verify`, `load`, `compare`, `sync`, `replay`."""
    head, _, body = data.partition(b"\n")
    finished, _, name = head.decode("ascii", "replace").partition(" ")
    if name not in FILES or finished not in ("0", "1"):
        return False
    folder = place() / "run"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(runs()[1 - int(finished)], folder)
    (folder / name).write_bytes(body)
    accepted = 0
    with suppress(IslandError):
        RunFolder(folder).verified()
    for reader in READERS:
        try:
            reader(folder)
            accepted += 1
        except IslandError as error:
            str(error).encode("utf-8", "surrogateescape")
    return accepted == len(READERS)


def _frames(folder: Path) -> None:
    results = load(folder)
    assert len(results.runs) == 1
    assert len(results.generations) >= 0
    assert len(results.individuals) >= 0


def _setting(folder: Path) -> None:
    Problem.recorded(RunFolder(folder).configuration())


def _compare(folder: Path) -> None:
    if runs := tuple(run for run in find([folder]) if run.finished):
        read_runs([Arm("a", "", runs)])


def _resume(folder: Path) -> None:
    run = RunFolder(folder)
    run.about()
    if run.begun() and not run.finished():
        run.resume()
    run.status()
    run.reason()
    run.completed_generations()


READERS: Final[tuple[Callable[[Path], object], ...]] = (
    _setting,
    _frames,
    _compare,
    _resume,
)


@cache
def recorded_lines() -> tuple[Any, ...]:
    """The lines of a transcript with every sort of line."""
    folder = place() / "recorded"
    folder.mkdir()
    llm, _ = supervisor(answering(), folder=folder)
    advise(llm)
    data = (folder / "transcript.jsonl").read_bytes()
    return tuple(map(json.loads, data.splitlines()))


@st.composite
def damaged_transcripts(draw: st.DrawFn) -> bytes:
    """A transcript with a line changed, or its bytes."""
    lines = list(recorded_lines())
    if draw(st.integers(0, 3)):
        at = draw(st.integers(0, len(lines) - 1))
        lines[at] = swapped(lines[at], draw(swaps()))
        return b"".join(as_json(line) + b"\n" for line in lines)
    data = b"".join(as_json(line) + b"\n" for line in lines)
    return draw(texts([data], (b'"line"', b'"attempt"')))


@cache
def capped() -> LLMSettings:
    """Settings with small caps."""
    caps = Caps(requests=9, input_tokens=9, output_tokens=9, usd=1, seconds=9)
    return settings().model_copy(update={"caps": caps})


def transcript(data: bytes) -> bool:
    """`supervisor=replay`, and what a resumed run counts."""
    file = place() / "transcript.jsonl"
    file.write_bytes(data)
    try:
        recorded = Transcript(file)
        recorded.unanswered()
        for attempt in recorded.attempts:
            recorded.of(attempt.call)
        ledger = Ledger(recorded, capped())
        ledger.totals()
        ledger.seconds_left()
        Replay.make(ReplaySettings(transcript=str(file)), run_context())
    except IslandError:
        return False
    return True


@cache
def run_context() -> Any:
    """What a run gives to its supervisor."""
    return context(None)


OVERRIDES: Final = (
    ["gp.population=12", "seed=3"],
    ["-m", "seed=range(3)", "supervisor=baseline,expert"],
    ["start=b.bt", "gp.trees.depth=[2,4]", "supervisor=baseline", "supervisor.policy.up=1.3"],
    ["experiment=smoke", "domain=island", "world=dense", "name=a"],
    ["++curriculum.stages.0.world={episode: {length: 10}}"],
)

OVERRIDE_TOKENS: Final = tuple(
    (
        b"gp.population seed = range( ) interval( choice( glob(*) [ { ${seed} ${oc.env:HOME} "
        b"${oc.decode:x} ${ _target_ _self_ @ ~ ++ hydra. hydra.callbacks.x._target_ os.system "
        b"hydra/launcher null ' shuffle( sort( tag( cast( str( extend_list( , : . / 1_0 --cfg "
        b"evaluator.factory antigravity:x gp.selection supervisor.policy.api_key "
    ).split()
)


@st.composite
def command_lines(draw: st.DrawFn) -> bytes:
    """Words of a command, one a line, some of them changed."""
    line = b"\n".join(word.encode() for word in draw(st.sampled_from(OVERRIDES)))
    return draw(texts([line], OVERRIDE_TOKENS))


def overrides(data: bytes) -> bool:
    """The command's words as jobs; at most three are composed."""
    arguments = [w for w in text_of(data).split("\n") if not w.startswith("-") or w == "-m"]
    args: Namespace = get_args_parser().parse_args([])
    args.overrides = [word for word in arguments if word != "-m"]
    args.multirun = "-m" in arguments
    try:
        for n, job in enumerate(planned(args, arguments, place())):
            assert job.folder.is_relative_to(place()) or "runs" in str(data)
            if n == 2:
                break
    except IslandError:
        return False
    return True


@st.composite
def episodes(draw: st.DrawFn) -> bytes:
    """Three scenes of a domain as JSON: names, places and texts that nobody expects."""
    wild = st.sampled_from([-1, 1e308, -1e308, float("nan"), float("inf"), 1e-320, 10**400])
    number = st.one_of(*[st.integers(0, 9)] * 9, wild)
    odd = st.sampled_from(["", "cat", "</script>", "\ud800", "{{data}}", "<!--"])
    word = st.one_of(*[st.sampled_from(["robot", "stone"])] * 3, odd)
    thing = st.tuples(word, number, number, number, word)
    scene = st.fixed_dictionaries(
        {"bounds": st.tuples(number, number, number, number), "fixed": st.lists(thing, max_size=2),
         "items": st.lists(thing, max_size=2), "movers": st.lists(thing, max_size=2),
         "frame": st.sampled_from([None, "", "ab"])}
    )  # fmt: skip
    return as_json(
        {"title": draw(word), "points": draw(number), "scenes": draw(st.lists(scene, max_size=3))}
    )


def recording(data: bytes) -> bool:
    """A domain's scenes on the page of `replay`."""
    inputs = json.loads(data)
    number = inputs["points"]
    points = number if isinstance(number, float) else max(-(10**300), min(10**300, number))
    try:
        scenes = [_scene(plain) for plain in inputs["scenes"]]
        recorded = small(scenes=scenes or [None], ticks=3, points=float(points))
        html = page(recorded, title=inputs["title"])
    except IslandError:
        return False
    embedded = html.split('id="data">')[1].split("</script>")[0]
    assert json.loads(embedded)["title"] == inputs["title"]
    html.encode()
    return True


def _scene(plain: dict[str, Any]) -> Scene:
    frame = plain["frame"]
    parts = {
        name: tuple(Shape(*shape) for shape in plain[name]) for name in ("fixed", "items", "movers")
    }
    frame_reader = None if frame is None else frame.encode
    return Scene(tuple(plain["bounds"]), frame=frame_reader, **parts)


def _bodies() -> list[bytes]:
    return [
        as_json({"content": [{"type": "text", "text": json.dumps(value)}],
                 "stop_reason": "end_turn", "usage": {"input_tokens": 10, "output_tokens": 5}})
        for value in (DECIDED, PROPOSAL, {**PROPOSAL, "trees": [PROPOSAL["tree"]] * 3})
    ]  # fmt: skip


def _answers() -> st.SearchStrategy[bytes]:
    plain = [DECIDED, PROPOSAL, {**PROPOSAL, "trees": [PROPOSAL["tree"], "A"]}]
    bodies = [json.loads(body) for body in _bodies()]
    tokens = (b"<think>", b"</think>", b"```json", b"```", *(name.encode() for name in DECIDED))
    inside = st.builds(
        lambda value: as_json({"content": [{"type": "text", "text": as_json(value).decode()}]}),
        values(plain),
    )
    return st.one_of(
        values(plain).map(as_json),
        values(bodies).map(as_json),
        inside,
        texts([*_bodies(), *map(as_json, plain)], (*tokens, *TOKENS[:30])),
    )


def _json_trees() -> list[bytes]:
    return [to_json(parse(text.decode(), VOCABULARY)).encode() for text in TREES]


def _xml_trees() -> list[bytes]:
    return [to_xml(parse(text.decode(), VOCABULARY)).encode() for text in TREES]


def _declarations() -> list[bytes]:
    return [as_json(adapter(Schema).dump_python(SCHEMA, mode="json"))]


def _plain_answers() -> list[bytes]:
    return [as_json(DECIDED), as_json(PROPOSAL), *_bodies()]


def _whole_files() -> list[bytes]:
    return [
        f"{finished} {name}\n".encode() + (folder / name).read_bytes()
        for finished, folder in zip((1, 0), runs(), strict=True)
        for name in FILES
        if (folder / name).exists()
    ]


def _whole_transcript() -> list[bytes]:
    return [b"".join(as_json(line) + b"\n" for line in recorded_lines())]


def _command_lines() -> list[bytes]:
    return ["\n".join(arguments).encode() for arguments in OVERRIDES]


def _still() -> list[bytes]:
    scene = {"bounds": [0, 0, 9, 9], "fixed": [["stone", 1, 1, 1, "a"]], "items": [], "movers": []}
    return [as_json({"title": "t", "points": 1, "scenes": [{**scene, "frame": None}]})]


def _changed(seeds: Sequence[bytes], pieces: Sequence[bytes] = ()) -> st.SearchStrategy[bytes]:
    """JSON with values swapped, or its bytes edited."""
    return st.one_of(values([*map(json.loads, seeds)]).map(as_json), texts(seeds, pieces))


def targets() -> dict[str, Target]:
    """By name, which is also its folder in the corpus."""
    forms = _declarations()
    return {
        "language": Target(texts(TREES, TOKENS), language, lambda: TREES, 25),
        "xml": Target(texts(_xml_trees(), XML_TOKENS), xml, _xml_trees, 5),
        "json": Target(_changed(_json_trees(), TOKENS), json_tree, _json_trees, 5),
        "declaration": Target(_changed(forms), declaration, _declarations, 5),
        "answer": Target(_answers(), answer, _plain_answers, 5),
        "records": Target(damaged_files(), records, _whole_files, 1),
        "transcript": Target(damaged_transcripts(), transcript, _whole_transcript, 2),
        "recording": Target(episodes(), recording, _still, 3),
        "overrides": Target(command_lines(), overrides, _command_lines, 1),
    }
