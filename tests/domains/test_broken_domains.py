"""Faults in a user's domain: each is reported once, with its file and line.

The domain is that of the tutorial with one piece of its text replaced.
"""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from islandgp.errors import DomainError, EvaluationError
from islandgp.evaluation.base import Job, Problem, simulate
from islandgp.evaluation.serial import Serial
from islandgp.scoring.curriculum import Curriculum
from islandgp.testing import check_domain
from tests.domains.test_outside import OWN, example
from tests.domains.test_tutorial import EXAMPLE
from tests.profiles import sweep
from tests.running.commands import ROOT, TINY
from tests.trees.shell import Cli, shell

__all__ = ["example"]

TUCK = "        self.arm_tucked = True\n        return True"
"""What the action `Tuck` does."""

MEASURES = "    def measures(self):\n        return {}\n\n    def step(self):"

PREPARE = """from time import sleep

class PickPlace(SimulatorDomain):
    def prepare(self):
        sleep(0.3)
"""

Broken = Callable[[str, str], ModuleType]


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Broken:
    """Makes a module of the tutorial's domain with one piece of its text replaced."""

    def load(old: str, new: str) -> ModuleType:
        text = (EXAMPLE / "pick_place.py").read_text(encoding="utf-8")
        assert old in text
        file = tmp_path / "broken_domain.py"
        file.write_text(text.replace(old, new, 1), encoding="utf-8")
        spec = importlib.util.spec_from_file_location("broken_domain", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "broken_domain", module)
        spec.loader.exec_module(module)
        return module

    return load


def problem(module: ModuleType) -> Problem:
    """Its domain, with the settings of the tutorial."""
    text = (EXAMPLE / "conf/domain/pick_place.yaml").read_text(encoding="utf-8")
    config = yaml.safe_load(text)
    factory = module.PickPlace
    world = factory.World.model_validate(config["world"])
    rewards = factory.Rewards.model_validate(config["rewards"])
    return Problem.of(factory, world, rewards, Curriculum(**config["curriculum"]))


def faults(module: ModuleType, *, timeout: float = 20) -> dict[str, list[str]]:
    """The lines of each promise that is broken, found with a few trees."""
    check = check_domain(lambda: problem(module).domain, random_trees=4, timeout=timeout)
    return {promise: fault.splitlines() for promise, fault in check.faults.items()}


EPISODES = [
    # Old text, new text, the fault, and the text of the line that it names.
    ('self.log("failed")', 'self.log("faild")',
     "Expected an event of the schema (localised, moved, picked, placed, failed, tick), found"
     " 'faild'; perhaps failed is meant", "faild"),
    ('self.placed += event == "placed"', 'self.placed += {"picked": 0}[event]',
     "Expected no error, found KeyError: 'placed'", "picked\": 0"),
    ('self.placed += event == "placed"', '1 / (event == "picked")',
     "Expected no error, found ZeroDivisionError: division by zero", "1 / (event"),
    ('self.log("tick")', "yield",
     'Expected why the episode is over from `step`, a text, or "" to continue, found <generator'
     " object Robot.step>; leave `yield` out of it", "def step"),
    ('return "task done" if self.placed == self.world.blocks else ""', "return 1",
     'Expected why the episode is over from `step`, a text, or "" to continue, found 1',
     "def step"),
    ('"blocks_left": self.world.blocks - self.placed}', '"blocks_left": "3"}',
     "Expected a whole number of at least 0 and at most 9 as the value of the key blocks_left from"
     " `sense`, found '3'", "def sense"),
    ('"blocks_left": self.world.blocks - self.placed}', '"blocks_left": -1}',
     "Expected a whole number of at least 0 and at most 9 as the value of the key blocks_left from"
     " `sense`, found -1", "def sense"),
    ('"blocks_left": self.world.blocks - self.placed}', '"blocks_left": 1, "blocks_lft": 2}',
     "Expected values of declared keys from `sense`, found 'blocks_lft'; perhaps blocks_left is"
     " meant; declare it among the keys, or leave it out", "def sense"),
    ('"blocks_left": self.world.blocks - self.placed}', "}",
     "Expected a value of the key blocks_left from `sense`, found none", "def sense"),
    ("return {**own, **at,", "{**own, **at,",
     "Expected a dict of values by key from `sense`, found None", "def sense"),
    ("def Tuck(self)", "async def Tuck(self)",
     "Expected True, False or RUNNING from the action Tuck, found <coroutine object Robot.Tuck>;"
     " write `def` in place of `async def`", "def Tuck"),
    (TUCK, "        pass",
     "Expected True, False or RUNNING from the action Tuck, found None; return one in each branch",
     "def Tuck"),
    ('return (yield from self._drive("pick"))', 'return self._drive("pick")',
     "Expected True, False or RUNNING from the action MoveToPick, found <generator object"
     " Robot._drive>; write `return (yield from ...)` to run a generator of another method",
     "def MoveToPick"),
    ('self.log("failed")', 'self.log("failed", "1")',
     "Expected a finite amount of the event 'failed', found '1'", 'log("failed", "1")'),
    (TUCK, "        import sys; sys.exit(3)", "Expected no error, found SystemExit: 3", "sys.exit"),
    (TUCK, "        self.Tuck()",
     "Expected no error, found RecursionError: maximum recursion depth exceeded", "self.Tuck()"),
    ("    def step(self):", MEASURES.format("{'tickk': 1}"),
     "Expected values of declared counters from `measures`, found 'tickk'; perhaps tick is meant;"
     " declare it among the counters, or leave it out", "def measures"),
    ("    def step(self):", MEASURES.format("{'tick': '1'}"),
     "Expected a finite number as the value of the counter tick from `measures`, found '1'",
     "def measures"),
]  # fmt: skip


@sweep(
    ("old", "new", "fault", "line"),
    EPISODES,
    ids=[fault[9:60] for *_, fault, _ in EPISODES],
    quick=5,
)
def test_a_fault_of_an_episode_is_reported_once(
    broken: Broken, old: str, new: str, fault: str, line: str
) -> None:
    """By the first promise, with the line of the domain's file and the smallest tree."""
    module = broken(old, new)
    broken_promises = faults(module)
    assert list(broken_promises) == ["every episode runs"]
    (message,) = broken_promises["every episode runs"]
    assert message.startswith(f"{fault}, in {module.__file__}, line ")
    number = int(re.findall(r", line (\d+)", message)[0])
    text = Path(str(module.__file__)).read_text(encoding="utf-8").splitlines()[number - 1]
    assert line in text
    assert re.search(r" \(world seed \d+, tree .+\)$", message)


SIGNATURES = [
    # Old text, new text, and what Python says.
    ("def sense(self)", "def sense(self, time)",
     "TypeError: Robot.sense() missing 1 required positional argument: 'time'"),
    ("def __init__(self, world, seed, log)", "def __init__(self, world, log)",
     "TypeError: Robot.__init__() takes 3 positional arguments but 4 were given"),
    ("def Tuck(self)", "def Tukc(self)",
     "AttributeError: 'Robot' object has no attribute 'Tuck'. Did you mean: 'Tukc'?"),
    ("World, Episode, schema = World, Robot, SCHEMA", "World, schema = World, SCHEMA",
     "AttributeError: type object 'PickPlace' has no attribute 'Episode'"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "error"), SIGNATURES)
def test_a_method_that_is_missing_or_takes_other_arguments_is_named(
    broken: Broken, old: str, new: str, error: str
) -> None:
    """By Python's message."""
    (message,) = faults(broken(old, new))["every episode runs"]
    assert message.startswith(f"Expected no error, found {error.partition('. Did')[0]}")


TUCKS = 'Action("tucks the arm", uses=("arm",))'
PROMISES = [
    (TUCKS, 'Action("tucks the arm", statuses=frozenset({0}))',
     "actions return the statuses that they declare",
     "Expected Tuck to return FAILURE, found SUCCESS."),
    ('"blocks_left": self.world.blocks - self.placed}', '"blocks_left": 4.5}',
     "keys stay in their ranges", "Expected a whole number as 0 <= blocks_left <= 9, found 4.5"),
    ('Shape("robot", *TABLES', 'Shape("robo", *TABLES',
     "scenes use the declared styles",
     "Expected a style of the schema, found Shape(style='robo', x=0.0, y=0.0, size=0.4, text='')"),
    ("return Scene(bounds=(-5, -2, 5, 4), movers=(*tables, robot))", "return 'a scene'",
     "scenes use the declared styles", "Expected a Scene, found 'a scene'"),
    ("    World, Episode, schema = World, Robot, SCHEMA",
     "    World, Episode, schema = World, Robot, SCHEMA\n\n"
     "    def __init__(self, world, rewards):\n"
     "        super().__init__(world, rewards)\n        self.f = lambda: 1",
     "it can be sent to workers",
     "Expected no error, found AttributeError: Can't pickle local object"
     " 'PickPlace.__init__.<locals>.<lambda>'"),
]  # fmt: skip


@sweep(("old", "new", "promise", "fault"), PROMISES, quick=2)
def test_a_promise_that_is_broken_is_reported(
    broken: Broken, old: str, new: str, promise: str, fault: str
) -> None:
    """All episodes run, and one promise does not hold."""
    assert faults(broken(old, new)) == {promise: [fault]}


DECLARATIONS = [
    ('flag("the robot knows where it is")', '"the robot knows where it is"',
     "an instance of Key for the key localised of the domain pick_place, found"),
    ('"tick": Event("ticks")', '"tick": "ticks"',
     "an instance of Event as tick of the events of the domain pick_place, found 'ticks'"),
    ("0, 3, most=9)", '"0", 3, most=9)',
     "Expected a finite number as low of the key blocks_left of the domain pick_place, found '0'"),
    (TUCKS, 'Action("tucks the arm", statuses=frozenset({"DONE"}))',
     "Expected statuses among FAILURE, SUCCESS and RUNNING as statuses of the action Tuck of the"),
    (TUCKS, 'Action("tucks the arm", changes={"armtucked": 1})',
     "Expected keys of the vocabulary in its conditions and changes for the action Tuck of the"
     " domain pick_place, found 'armtucked'"),
    ('habits=("Check what has been reached before acting.", "Tuck the arm before driving.")',
     'habits="Check what has been reached before acting."',
     "Expected a valid tuple for the habits of the domain pick_place, found 'Check what"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "fault"), DECLARATIONS)
def test_a_declaration_of_a_wrong_type_is_refused(
    broken: Broken, old: str, new: str, fault: str
) -> None:
    """When the module is loaded."""
    with pytest.raises(DomainError, match=re.escape(fault)):
        broken(old, new)


# Code that does not return

HANGS = {
    "in a loop": ("        while True:\n            pass", "the action Tuck"),
    "in a system call": ("        import time; time.sleep(1e6)", "the action Tuck"),
    "in a helper": ("        self._rest()\n\n    def _rest(self):\n        while True: pass",
                    "the action Tuck"),
    "and catches exceptions": ("        while True:\n            try: sum(range(9))\n"
                               "            except Exception: pass", "the action Tuck"),
    "and catches all once": ("        while not self.arm_tucked:\n            try: sum(range(9))\n"
                             "            except: self.arm_tucked = True\n"
                             "        return True", "the function Tuck"),
}  # fmt: skip


@sweep("case", HANGS, quick=2)
def test_an_action_that_does_not_return_is_named(broken: Broken, case: str) -> None:
    """The suite ends after the first episode that takes too long, with the action and the line."""
    code, function = HANGS[case]
    module = broken(TUCK, code)
    (message,) = faults(module, timeout=0.2)["every episode runs"]
    assert f"found {function} still running after 0.2 s, in {module.__file__}, line " in message


def test_preparing_is_not_limited(broken: Broken) -> None:
    """A domain may compile before an episode, outside of the episode's time limit."""
    setting = problem(broken("class PickPlace(SimulatorDomain):", PREPARE))
    assert simulate(setting, Job("Localise", 0, 3), 0.2).seconds > 0


def test_other_code_that_does_not_return_is_named(broken: Broken) -> None:
    """By its function."""
    module = broken("    def sense(self):\n", "    def sense(self):\n        while True: pass\n")
    (message,) = faults(module, timeout=0.2)["every episode runs"]
    assert f"found the function sense still running after 0.2 s, in {module.__file__}" in message


def test_serial_runs_are_bounded(broken: Broken) -> None:
    """The error names the world, the tree and the action."""
    setting = problem(broken(TUCK, "        while True: pass"))
    evaluator = Serial(setting, episode_timeout=0.2)
    with pytest.raises(
        EvaluationError, match=r"world seed 3, .*the action Tuck still.*\nTuck"
    ) as excinfo:
        evaluator.evaluate([Job("Tuck", 0, 3)])
    assert "evaluator.policy.episode_timeout" in str(excinfo.value)
    assert (
        simulate(setting, Job("Localise", 0, 3), 20)
        == evaluator.evaluate([Job("Localise", 0, 3)])[0]
    )


# The commands


@pytest.fixture
def islandgp(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """The command line."""
    return shell(monkeypatch, capsys)


def edit(folder: Path, old: str, new: str) -> None:
    """Replaces a piece of the domain's text."""
    file = folder / "pick_place.py"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def check(islandgp: Cli, *arguments: str) -> tuple[int, str]:
    """Exit code and output of `islandgp domain --check`, without the promises that are kept."""
    result = islandgp("domain", *arguments, "--check", "--config-dir", "conf")
    assert result.err == ""
    return result.code, "\n".join(line for line in result.out.splitlines() if line[:2] != "ok")


@pytest.mark.slow
def test_a_sound_domain_reaches_all(example: Path, islandgp: Cli) -> None:
    """With the tree beside its module or without it: nothing is listed."""
    assert check(islandgp, "pick_place") == (0, "")
    (example / "carry.bt").unlink()
    assert check(islandgp, "pick_place") == (0, "")


@sweep(
    ("old", "new", "line"),
    [
        ('        self.log("moved")\n', "", "events never logged: moved"),
        ("at == \"place\" and self.have_block)", "at == 'nowhere')", "succeeded: Place"),
        ('"at_place": self.at == "place"', '"at_place": False', "at_place (always 0)"),
    ], quick=1,
)  # fmt: skip
def test_what_no_tree_reaches_is_listed(
    example: Path, islandgp: Cli, old: str, new: str, line: str
) -> None:
    """The exit code is that of the promises."""
    edit(example, old, new)
    code, out = check(islandgp, "pick_place")
    assert code == 0
    assert "Not reached by any of " in out
    assert line in out


@pytest.mark.slow
def test_a_tree_file_reaches_what_others_do_not(example: Path, islandgp: Cli) -> None:
    """Here a fault behind seven actions of a kind; the file is beside the domain's module."""
    edit(example, TUCK, f"        self.tucks = getattr(self, 'tucks', 0) + 1\n{TUCK}")
    count = "        before, self.tucks = getattr(self, 'tucks', 0), 0\n        1 / (before != 7)\n"
    edit(example, "    def Pick(self):\n", f"    def Pick(self):\n{count}")
    assert check(islandgp, "pick_place") == (0, "")
    tree = "sequence { repeater 7 { Tuck } Pick }"
    (example / "seven.bt").write_text(f"domain pick_place\n{tree}\n")
    code, out = check(islandgp, "pick_place")
    assert code == 1
    assert "Expected no error, found ZeroDivisionError: division by zero, in " in out
    assert f"tree {tree})" in out


@pytest.mark.slow
def test_trees_of_the_library_are_run(example: Path, islandgp: Cli) -> None:
    """One that cannot be read is left out in a line."""
    (example / "trees").mkdir()
    (example / "trees/all.bt").write_text((example / "carry.bt").read_text())
    (example / "carry.bt").write_text("domain pick_place\nMoveToPik\n")
    file = example / "conf/domain/pick_place.yaml"
    (example / "trees/none.bt").write_text("domain pick_place\nMoveToPick PlaceIt\n")
    each = "localising: [all], driving: [all], picking: [all], placing: [all]"
    library = f"{{folder: trees, trees: {{{each}}}}}"
    text = file.read_text(encoding="utf-8").replace("{folder: null}", library)
    file.write_text(text, encoding="utf-8")
    code, out = check(islandgp, "pick_place")
    assert code == 0
    first, second = out.splitlines()
    assert first.startswith(f"left out: {example}/carry.bt:2:1: unknown action 'MoveToPik'")
    assert second.startswith(f"left out: {example}/trees/none.bt:2:")


@pytest.mark.slow
def test_what_a_domain_prints_is_reported_once(example: Path, islandgp: Cli) -> None:
    """Episodes are many: a print in one of them would hide the rest."""
    edit(example, TUCK, f"        print('tucked')\n{TUCK}")
    assert check(islandgp, "pick_place") == (
        0, "\nIts code prints while episodes run, e.g. 'tucked'",
    )  # fmt: skip


@sweep(
    "arguments",
    [("play",), ("play", "--seeds", "2"), ("replay",)],
    quick=2,
)
def test_commands_are_bounded(example: Path, islandgp: Cli, arguments: tuple[str, ...]) -> None:
    """One line that names the action, exit code 2, and nothing written.

    On a busy machine the limit may be reached before the action starts: a longer one follows.
    """
    edit(example, TUCK, "        while True: pass")
    command, *others = arguments
    for seconds in ("1", "4", "30"):
        result = islandgp(
            command, "carry.bt", "--config-dir", "conf", "--timeout", seconds, *others
        )
        assert result.code == 2
        assert result.err.count("\n") == 1
        if f"the action Tuck still running after {seconds} s, in " in result.err:
            break
    assert "the action Tuck still running after " in result.err
    assert "--timeout" in result.err
    assert not (example / "replay.html").exists()


def test_an_import_that_fails_names_its_line(example: Path, islandgp: Cli) -> None:
    """What the domain's module imports is not there: exit code 2."""
    edit(example, "import numpy as np\n", "import numpyy as np\n")
    result = islandgp("domain", "pick_place", "--config-dir", "conf")
    assert result.code == 2
    place = f"No module named 'numpyy', in {example}/pick_place.py, line 7)"
    assert f"pick_place:PickPlace failed (ModuleNotFoundError: {place}" in result.err


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.skipif(sys.platform == "win32", reason="has no SIGALRM")
def test_a_serial_run_that_hangs_ends(example: Path) -> None:
    """Exit code 2, and the action's name; also where it catches everything, for ever."""
    overrides = (*OWN, *TINY, "evaluator=serial", "evaluator.policy.episode_timeout=0.5")
    forever = "        while True:\n            try: sum(range(9))\n            except: pass"
    edit(example, TUCK, forever)
    process = subprocess.run(
        [sys.executable, "-m", "islandgp", *overrides, "gp.validation=0"],
        cwd=example,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert process.returncode == 2
    assert "still running after 0.5 s, in " in process.stderr
