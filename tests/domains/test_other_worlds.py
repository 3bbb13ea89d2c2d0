"""The domains over environments of Gymnasium, by what all promise."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import pytest

from islandgp.bt.core.language import parse
from islandgp.config.settings import read_settings
from islandgp.domain import Domain, Scene
from islandgp.errors import ConfigError, IslandError
from islandgp.evaluation.base import Job
from islandgp.evaluation.processes import Processes
from islandgp.evaluation.serial import Serial
from islandgp.evolution.loop import evolve
from islandgp.experiment import compose, run
from islandgp.gp.record import Step
from islandgp.running.parts import make_search, make_supervisor
from islandgp.testing import check_domain
from tests.composed import composed, plain
from tests.profiles import sweep
from tests.running.commands import finish, kill_group, lines, start, wait_until
from tests.trees.shell import Cli, shell

pytest.importorskip("gymnasium", reason="extra `gymnasium` is not installed")

DOMAINS = Path(__file__).parents[2] / "islandgp" / "domains"
PAGE = (DOMAINS.parents[1] / "docs" / "domains.md").read_text(encoding="utf-8")
BY_HAND = {
    "cartpole": DOMAINS / "gymnasium" / "trees" / "cartpole.bt",
    "lunarlander": DOMAINS / "gymnasium" / "trees" / "lunarlander.bt",
    "pendulum": DOMAINS / "gymnasium" / "trees" / "pendulum.bt",
    "mountaincar": DOMAINS / "gymnasium" / "trees" / "mountaincar.bt",
}
SHORT = ("world.ticks=40",)
TINY = (*SHORT, "gp.population=6", "gp.generations=4", "gp.episodes=1", "supervisor=baseline")

NIGHTLY = pytest.mark.slow
every_world = pytest.mark.parametrize("world", BY_HAND)


@pytest.fixture
def islandgp(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `islandgp ARGUMENTS...`; see `shell`."""
    return shell(monkeypatch, capsys)


@cache
def short(world: str) -> Domain:
    """A domain with short episodes."""
    return composed(f"domain={world}", *SHORT).make_domain()


@pytest.mark.parametrize(
    "world", ["cartpole", "pendulum", pytest.param("lunarlander", marks=pytest.mark.slow)]
)
def test_environments_keep_the_promises_of_a_domain(world: str) -> None:
    """Flags and numbers, choices and arguments, described by configuration alone."""
    texts = [BY_HAND[world].read_text(encoding="utf-8")]
    assert check_domain(lambda: short(world), trees=texts, random_trees=4).faults == {}


@sweep(
    "world",
    [
        "cartpole",
        *(pytest.param(w, marks=NIGHTLY) for w in ("lunarlander", "pendulum")),
    ],
    quick=1,
)
def test_the_commands_work(islandgp: Cli, tmp_path: Path, world: str) -> None:
    """Check, play, replay and export, on a tree whose first line names the domain."""
    tree, quick = BY_HAND[world], ("--set", SHORT[0])
    assert "no warnings" in islandgp("check", tree).out
    result = islandgp("play", tree, "--seeds", 2, "--json", *quick)
    assert (result.code, len(json.loads(result.out))) == (0, 2)
    page, file = tmp_path / "page.html", tmp_path / "tree.xml"
    assert islandgp("replay", tree, "-o", page, *quick).code == 0
    assert '"frames":["iVBOR' in page.read_text(encoding="utf-8").replace(" ", "")
    assert islandgp("export", tree, "-o", file).code == 0
    assert ElementTree.parse(file).getroot().tag == "root"


def gallery_commands() -> list[list[str]]:
    """The commands of docs/domains.md on these domains, but pip's."""
    blocks = re.findall(r"^```sh\n(.*?)```", PAGE, re.DOTALL | re.MULTILINE)
    commands = [shlex.split(line) for block in blocks for line in block.splitlines()]
    return [command for command in commands if command[0] != "pip"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        # The suite runs on these domains above.
        pytest.param(command, marks=pytest.mark.slow if "--check" in command else ())
        for command in gallery_commands()
    ],
    ids=" ".join,
)
def test_the_gallery_s_commands(
    islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    """Each succeeds; runs are shortened. The page's file is in the folder."""
    if any("swimmer" in word for word in command):
        pytest.importorskip("mujoco", reason="extra `mujoco` is not installed")
    monkeypatch.chdir(tmp_path)
    for name, text in re.findall(r"^```yaml (\S+)\n(.*?)```", PAGE, re.DOTALL | re.MULTILINE):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    if command[0] == "islandgp":
        quick = ("--set", SHORT[0]) if command[1] == "domain" else ()
        assert islandgp(*command[1:], *quick).code == 0
        return
    config_dir = tmp_path / "conf" if "--config-dir" in command else None
    command = [word for word in command if word not in ("--config-dir", "conf")]
    overrides = [word for word in command[3:] if not word.startswith("gp.generations")]
    quick = [*TINY, "gp.generations=2", "gp.validation=0", "tracking=off", "evaluator=serial"]
    if any(word.startswith(("supervisor=", "experiment=random")) for word in overrides):
        quick.remove("supervisor=baseline")
    runs = run(*overrides, *quick, config_dir=config_dir).runs
    assert list(runs["status"]) == ["FINISHED"]


def steps_of(world: str, *overrides: str) -> list[Step]:
    """A tiny run in this process."""
    settings = composed(f"domain={world}", *TINY, *overrides)
    evaluator = Serial(settings.problem())
    plan = settings.plan(settings.make_domain())
    supervisor, search = make_supervisor(settings, None), make_search(settings, plan)
    return list(evolve(plan, settings.seed, supervisor, evaluator, search=search))


@every_world
def test_a_run_goes_on_from_any_generation(world: str) -> None:
    """Evolution from a saved state gives the same records."""
    settings = composed(f"domain={world}", *TINY)
    steps = steps_of(world)
    state = steps[1].state
    assert state is not None
    rest = evolve(
        settings.plan(settings.make_domain()),
        settings.seed,
        make_supervisor(settings, None),
        Serial(settings.problem()),
        start=state,
    )
    assert [step.record for step in rest] == [step.record for step in steps[2:]]


def begun(home: Path) -> bool:
    """Whether a run below a folder has three generations."""
    return any(lines(file) >= 3 for file in home.rglob("generations.jsonl"))


@pytest.mark.process
@every_world
@pytest.mark.slow
def test_one_worker_and_four_give_the_same_records(tmp_path: Path, world: str) -> None:
    """So does a run that was killed and started again."""
    overrides = (f"domain={world}", *TINY, "gp.generations=30", "tracking=off", "progress=off")
    records = []
    for workers in (1, 4):
        home = tmp_path / str(workers)
        home.mkdir()
        command = (*overrides, f"evaluator.policy.workers={workers}")
        if workers == 4:
            process = start(home, *command)
            wait_until(lambda: begun(home), process)  # noqa: B023 -- called at once
            kill_group(process)
        code, output = finish(start(home, *command))
        assert code == 0, output
        (file,) = home.rglob("generations.jsonl")
        records.append(file.read_bytes())
    assert records[0] == records[1]


@pytest.mark.process
@pytest.mark.slow
def test_arms_are_compared(islandgp: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`compare` writes its page for a domain of an extra, unseen worlds included."""
    monkeypatch.chdir(tmp_path)
    sweep = ("domain=cartpole", *TINY[:-1], "tracking=off", "progress=off", "name=s")
    for arm in ("baseline", "expert"):
        command = (*sweep, f"supervisor={arm}", "seed=range(3)", "-m")
        assert finish(start(tmp_path, *command))[0] == 0
    arms = [word for arm in ("expert", "baseline") for word in ("--arm", f"{arm}=supervisor={arm}")]
    result = islandgp("compare", *arms, "--worlds", 3, "--workers", 1, "-o", "out")
    assert result.code == 0, result.err
    assert (tmp_path / "out" / "index.html").is_file()


@pytest.mark.process
def test_processes_run_an_environment() -> None:
    """A worker makes the environment by itself."""
    problem = composed("domain=cartpole", *SHORT).problem()
    job = Job("PushLeft\n", 0, 3)
    evaluator = Processes(problem, 1)
    try:
        assert evaluator.evaluate([job]) == Serial(problem).evaluate([job])
    finally:
        evaluator.close()


def test_actions_are_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not in each step, where Gymnasium's check takes as long as the rest of CartPole's step."""
    spaces = pytest.importorskip("gymnasium").spaces
    monkeypatch.setattr(spaces.Discrete, "contains", lambda *_: pytest.fail("checked"))
    outcome = short("cartpole").run_episode(parse("PushLeft"), 0, {})
    assert outcome.counters["return"] > 0


def test_random_search_inherits_nothing() -> None:
    """Each individual of each generation is a new random tree, and none is mutated."""
    steps = steps_of("cartpole", "search=random", "supervisor=baseline")
    origins = {(i.origin, i.mutation) for step in steps for i in step.record.individuals}
    assert origins == {("random", "")}
    trees = [i.tree for step in steps for i in step.record.individuals]
    assert len(set(trees)) > len(trees) // 2


# Gymnasium


def test_the_return_is_the_fitness() -> None:
    """The counters are the environment's own numbers, step by step."""
    import gymnasium

    domain = composed("domain=cartpole").make_domain()
    outcome = domain.run_episode(parse("PushRight", domain.schema.vocabulary), 5, {})
    env, ended, total = gymnasium.make("CartPole-v1"), False, 0.0
    env.reset(seed=5)
    while not ended:
        _, reward, terminated, truncated, _ = env.step(1)
        total, ended = total + float(reward), terminated or truncated
    assert outcome.counters["return"] == outcome.fitness == total
    assert outcome.endings == ("terminated",)


class _Boards:
    """Keeps the blackboard of each tick, and which actions earn points."""

    def __init__(self) -> None:
        self.boards: list[tuple[float, ...]] = []
        self.earners: set[str] = set()

    def node(self, place: int, status: int) -> None: ...

    def tick(self, board: Sequence[float], _scene: Scene | None) -> None:
        self.boards.append(tuple(board))

    def credit(self, _component: str, _points: float, _event: str, action: str) -> None:
        self.earners.add(action)


@pytest.mark.parametrize(
    ("tree", "earner"),
    [
        ("PushRight", "PushRight"),
        ("Shove", "Shove"),
        ("sequence { PushRight Shove }", "Shove"),
        ("when angle > 99 { PushLeft }", ""),
    ],
)
def test_points_are_credited_to_the_action_that_was_chosen(tree: str, earner: str) -> None:
    """Also where two actions have one number, and where the tree chose none."""
    config = plain("domain=cartpole")
    config["world"]["actions"]["Shove"] = {"do": 1, "meaning": "pushes the cart to the right"}
    domain = read_settings(config).make_domain()
    boards = _Boards()
    domain.run_episode(parse(tree, domain.schema.vocabulary), 0, {}, boards)
    assert boards.earners == {earner}


def test_values_beyond_the_range_are_cut() -> None:
    """A key stays in its range for any observation."""
    config = plain("domain=cartpole")
    config["world"]["observations"]["speed"]["range"] = [-0.3, 0.3]
    domain = read_settings(config).make_domain()
    boards = _Boards()
    domain.run_episode(parse("PushRight", domain.schema.vocabulary), 0, {}, boards)
    speeds = [board[domain.schema.vocabulary.key_index["speed"]] for board in boards.boards]
    assert max(speeds) == 0.3
    assert len({speed for speed in speeds if -0.3 < speed < 0.3}) > 1


@pytest.mark.parametrize(
    ("overrides", "line"),
    [
        (
            ("domain=cartpole", "++world.observations.mixed={meaning: none}"),
            "world.observations.mixed.at: ",
        ),
        (("domain=cartpole", "world.environment=CartPool-v1"), "world.environment: expected one"),
        (("domain=cartpole", "world.actions.PushLeft.do=7"), "world.actions.PushLeft.do: expected"),
        (("domain=cartpole", "world.observations.speed.at=9"), "world.observations.speed.at: exp"),
        (
            ("domain=cartpole", "world.environment=Pendulum-v1"),
            "world.observations.turning.at: expe",
        ),
        (
            ("domain=cartpole", "world.observations.speed.range=[2,1]"),
            "Expected low < high, both from -1,000,000 to 1,000,000 for the key speed",
        ),
        (("domain=cartpole", "world.signals.lasting.of=hight"), "world.signals.lasting.of: expec"),
        (("domain=cartpole", "world.name=when"), "Expected a name of letters"),
    ],
)
def test_a_wrong_name_is_one_line(overrides: tuple[str, ...], line: str) -> None:
    """Key, what was expected and found."""
    with pytest.raises(IslandError) as excinfo:
        composed(*overrides)
    assert str(excinfo.value).startswith(line)
    assert "\n" not in str(excinfo.value)


def test_a_missing_extra_names_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the package is not installed."""
    monkeypatch.setattr("islandgp.domains.gymnasium.domain.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=r"pip install 'islandgp\[gymnasium\]'"):
        composed.__wrapped__("domain=cartpole", "seed=1")


def test_a_lander_lands_or_crashes_once() -> None:
    """A hard touch of the ground pays more than 100 points here, and is no landing."""
    landers = compose("domain=lunarlander", "tracking=off", "evaluator=serial")
    falling = landers.evaluate("Rest", range(300_000, 300_040))
    by_hand = landers.evaluate(BY_HAND["lunarlander"].read_text(), range(300_000, 300_004))
    for outcome in (*falling, *by_hand):
        assert outcome.counters["landed"] + outcome.counters["crashed"] <= 1
    assert sum(outcome.counters["landed"] for outcome in by_hand) >= 1
