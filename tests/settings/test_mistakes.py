"""Wrong configurations: one line for each error, exit code 2, nothing started, nothing written."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from islandgp.errors import in_the_way
from islandgp.resources import resource
from islandgp.running.app import main
from tests.profiles import sweep
from tests.running.commands import ROOT
from tests.settings.test_composing import options

OFF = ("tracking=off", "evaluator=serial", "progress=off")


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each command has its own working folder."""
    monkeypatch.chdir(tmp_path)


def errors(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    """The lines of a command that must fail and leave nothing behind."""
    assert main([*OFF, *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("islandgp: ")
    assert "Traceback" not in captured.err
    assert list(Path.cwd().iterdir()) == []
    return captured.err.removeprefix("islandgp: ").splitlines()


ONE_LINE = [
    # words, the line
    (["gp.populaton=3"], "gp.populaton: unknown key; did you mean gp.population?"),
    (["domain.factory=json:Json"],
     "domain.factory='json:Json': invalid python path: cannot import name 'Json' from 'json'"),
    (["evaluator.policy.workers=-1"],
     "evaluator.policy.workers: unknown key; evaluator=processes has it."),
    (["supervisor=baseline", "supervisor.policy.dwn=2"],
     "supervisor.policy.dwn: unknown key; did you mean supervisor.policy.down?"),
    (["supervisor=llm", "supervisor.policy.apikey=x"],
     "supervisor.policy.apikey: expected no secret on the command line, found supervisor.poli"),
    (["gp.population.most=3"],
     "gp.population.most: unknown key; --cfg job prints"),
    (["hydra.launcher.n_jbs=2"],
     "hydra.launcher.n_jbs: unknown key; --cfg job prints"),
    (["rewards.maxima.garbage=1"],
     "rewards.maxima.garbage: unknown key; rewards=normalized has it."),
    (["search=paper", "search.policy.library=0"],
     "search.policy.library: unknown key; search=racing has it."),
    (["+gp.elites=3"], "gp.elites: unknown key;"),
    (["~seed=5"], "Could not delete from config. The value of 'seed' is 0 and not 5."),
    (["+gp.population=8"],
     "Could not append to config. An item is already at 'gp.population'. Either remove + prefi"),
    (["+rewards.events.collision.zzz=3"],
     "rewards.events.collision.zzz: unknown key; did you mean rewards.events.collision?"),
    (["gp.selection=tournamen"],
     "gp.selection: expected one of tournament or MODULE:FUNCTION, found 'tournamen'"),
    (["gp.population=many"], "gp.population='many': input should be a valid integer"),
    (["gp.population=3"], "gp.population=3: input should be greater than or equal to 4"),
    (["world.side=nan"], "world.side=nan: input should be"),
    (["rewards.events.collision.base=inf"],
     "rewards.events.collision.base=inf: input should be a finite number"),
    (["seed=-1"], "seed=-1: input should be greater than or equal to 0"),
    (["name='a b'"],
     "name='a b': string should match pattern '^[A-Za-z0-9][A-Za-z0-9._-]*$'"),
    (["resume=perhaps"], "resume='perhaps': input should be 'auto' or 'never'"),
    (["search=paper", "gp.tournament_size=50"],
     "gp.tournament_size: expected at most gp.population = 30, found 50"),
    (["world.start=[500,400]"],
     "world.start: expected points at least 2 m inside the 300 m island, found (500, 400)"),
    (["world.side=1e6"],
     "world.side: expected at most 100,000 cells to search for garbage, found"
     " 3,460,262,976"),
    (["world.episode.step=1000"],
     "world.episode.step: expected at most 420 s, the episode's length, found 1,000"),
    (["seed=true"], "seed: expected a number, found true"),
    (["supervisor=baseline", "supervisor.policy.rates=[0.1,true]"],
     "supervisor.policy.rates.1: expected a number, found true"),
    (["+rewards.events.picknick={component: garbage}"],
     "rewards.events.picknick: expected one of pickup, interaction, charge, shutdown, delivery,"),
    (["rewards.events.pickup.component=trash"],
     "rewards.events.pickup.component: expected one of garbage, battery, humanoid, delivery,"),
    (["rewards=normalized", "+rewards.maxima.fun=3"],
     "rewards.maxima.fun: expected one of garbage, battery, humanoid,"),
    (["hydra/launcher=local"], "hydra/launcher=local: expected a sweep, found a single run,"),
    (["rewards=normalized", "rewards.maxima.idle=0"],
     "rewards.maxima.idle: expected a number above 0, as others have one"),
    (["curriculum.stages.4.multipliers.garbage=2"],
     "Error merging override curriculum.stages.4.multipliers.garbage=2 (list index out of rang"),
    (["~curriculum.stages.7"],
     "curriculum.stages.7: unknown key; did you mean curriculum.stages.3?"),
    (["+curriculum.stages.2.multipliers.trash=3"],
     "curriculum.stages.2.multipliers.trash: expected one of garbage, battery, humanoid,"),
    (["classes.behaviours.charging=chargings"],
     "classes.behaviours.charging: expected one of pickups, interactions, deliveries, charges,"),
    # searches
    (["search=mapelites"], "search=mapelites: unknown option; did you mean map_elites?"),
    (["search=paper", "search.ranking=luck"],
     "search.ranking='luck': input should be 'evidence' or 'fitness'"),
    (["search=hill", "search.factory=islandgp.gp.plan:Plan"],
     "search.factory: expected a class with Settings, make, start, ask and tell, found"),
    (["search.factory=tests.settings.searches:Undeclared"],
     "search.factory: expected <class 'tests.settings.searches.Undeclared'> with class"
     " attributes uses, a frozenset of some of 'edits', 'rate', 'tree', and Memory,"),
    (["search=map_elites", "search.policy.bins=0"],
     "search.policy.bins=0: input should be greater than or equal to 1"),
    (["allocation.reevaluated=0.5", "allocation.random=0.5"],
     "allocation: expected reevaluated + random below 1, so that there are children, found"
     " 0.5 + 0.5; lower one of them"),
    (["allocation.injected=28"],
     "allocation.injected: expected at most gp.population - 3 = 27, found 28"),
    (["allocation=paper"], "allocation: expected the slots of the search (random, injected,"
     " reevaluated), found those of another one; leave out allocation, which follows the search"),
    (["search=map_elites", "allocation.reevaluated=1"],
     "allocation.reevaluated=1: input should be less than 1"),
    (["search=map_elites", "search.policy.descriptor=[pickups,flights]"],
     "search.policy.descriptor.1: expected one of pickups, interactions, deliveries, charges,"),
    (["search=nsga2", "search.policy.objectives=[fitness,-flights]"],
     "search.policy.objectives.1: expected one of fitness, nodes, pickups, interactions,"),
    (["search=lexicase", "search.policy.cases=episodes"],
     "search.policy.cases: expected several episodes an individual, found gp.episodes=1;"),
    (["search=hill", "search.policy.breeding.crossovers.branch=-1"],
     "search.policy.breeding.crossovers: expected weights >= 0 for some of subtree, branch,"),
    (["search=hill", "search.policy.breeding.mutation.subtree_depth=60"],
     "search.policy.breeding.mutation.subtree_depth=60: input should be less than or equal to 50"),
    (["search=hill", "search/breeding=none"],
     "search/breeding=none: unknown option; there are branches, paper"),
    (["search=compose", "library=automatic"],
     "search=compose: expected a library with a folder, found none;"),
    (["search=compose", "gp.max_nodes=4"],
     "search=compose: expected branches that fit into one tree, found that they break"),
    # names that do not fit together
    (["classes.milestones=[perfect]"],
     "classes.milestones: expected one of excellent, complete, full_service, balanced_elite, found"
     " 'perfect'"),
    (["classes.specialists.mixed=pickup"],
     "classes.behaviours: expected each name once, found 'pickup' twice"),
    (["domain.factory=nowhere"], "domain.factory='nowhere': invalid python path"),
    (["domain.factory=islandgp.running.run:run"],
     "domain.factory: expected a class with World, Rewards, make and run_episode, found <function"),
    (["domain=atlantis"], "domain=atlantis: unknown option; there are "),
    (["world.episode.step=1e-9"],
     "world.episode.length: expected at most 536,870,911 steps, found 4.2e+11"),
    (["seed=1,2", "hydra.sweeper._target_=a.Sweeper", "-m"],
     "hydra.sweeper._target_: expected a key of islandgp or one of hydra.launcher,"),
    (["world.garbage.initial=300"],
     "world.garbage.initial: expected at most 150 (garbage.most), found 300"),
    (["world.humanoids.speed=11"],
     "world.humanoids.speed: expected at most 10 (robot.speed), found 11"),
    (["world.obstacles.radius=[4,2]"],
     "world.obstacles.radius: expected at most 2 (the second number), found 4"),
    (["search=paper", "allocation.tournament_children=[25,18]"],
     "allocation.tournament_children: expected the lower number first, found [25, 18]"),
    (["~classes.tiers.complete"],
     "classes.milestones: expected one of excellent, full_service, balanced_elite, found"
     " 'complete'"),
    (["~gp.state.window"], "gp.state.window: expected a value, found none"),
    (["supervisor.policy.rates.refinement=[0.3,0.2]"],
     "supervisor.policy.rates.refinement: expected the lower number first, found [0.3, 0.2]"),
    (["world.episode.length=1000000", "world.humanoids.turn_every=[0.1,1]"],
     "world.humanoids.turn_every: expected at most 1,000,000 turns in an episode, found"),
    (["world.episode.length=1000000", "world.garbage.every=0.1"],
     "world.garbage.every: expected at most 1,000,000 items in an episode, found 10,000,000"),
    (["supervisor.factory=tests.running.evaluators:Instant"],
     "supervisor.factory: expected a class with Settings, make and advise, found <class"),
    (["evaluator.factory=islandgp.running.run:run"],
     "evaluator.factory: expected a class with Settings and make, found <function run"),
    (["seed=range(5)"],
     "seed=range(5): expected one value, found a sweep; give one, or add -m to"),
    (["--config-dir", "nope"], "--config-dir: expected a folder of configuration, found none at /"),
    (["--config-path", "nope"],
     "--config-path: expected --config-dir FOLDER, which adds your files to those of the package"),
    (["name=${nope}"],
     "name: expected a value, found none (Interpolation key 'nope' not found); give name=VALUE"),
    (["gp=4"], "Config group override must be a string or a list. Got int"),
    (["hydra.launcher=4"], "hydra.launcher: expected hydra/launcher=NAME, found 4."),
    (["seed=range(0)", "-m"],
     "seed=range(0): expected 1 to 1,000 jobs of a command, found none; write values as A,B"),
    (["seed=1,2"], "seed=1,2: expected one value, found a sweep; give one, or add -m to python"),
    (["+experiment=smoke"],
     "Multiple values for experiment. To override a value use 'override experiment: smoke'"),
    (["supervisor=[expert,baseline]"],
     "In 'supervisor/baseline': ConfigTypeError raised while composing config:"),
    (["rewards.events={}"],
     "rewards.events={}: expected keys to add or change, found none; remove keys with"
     " ~rewards.events.NAME."),
    (["--run", "-m"], "--run: expected no --multirun beside it, found both; leave one out"),
    (["world.robot.pickup_reach=20"],
     "world.robot.pickup_reach: expected at most 15 (robot.perception), found 20"),
    (["world.episode.step=1"],
     "world.episode.step: expected at most 0.16 s, found 1"),
    (["compare"],
     "compare: expected KEY=VALUE, found what cannot be read (missing EQUAL at '<EOF>'); a text"),
    (["gp.populaton=3", "--help"], "gp.populaton: unknown key; did you mean gp.population?"),
    (["supervisor=expet", "--cfg", "job"], "supervisor=expet: unknown option; did you mean expert"),
    (["world@x=island"],
     "Could not override 'world@x'. Did you mean to override world? To append to your default "),
    (["+hydra.callbacks.x._target_=builtins.print"],
     "hydra.callbacks.x._target_: expected a key of islandgp or one of"),
    (["hydra.run.dir=/proc/x"], "hydra.run.dir: expected a key of islandgp or one of"),
    (["domain=[island,cartpole]"],
     "Error resolving interpolation '${experiment}_${domain}', possible interpolation keys: ex"),
    (["runs=~/x"],
     "runs=~/x: expected KEY=VALUE, found what cannot be read (LexerNoViableAltException: runs"),
    (["world.chargers=[[1,2,3]]"], "world.chargers.0=[1, 2, 3]: tuple should have at most 2 items"),
    (["+classes.tiers.courier={atleast:{distance:1}}"],
     "classes.tiers.courier.atleast: unknown key; did you mean classes.tiers.courier.at_least?"),
    (["+classes.tiers.Courier={at_least:{distance:1}}"],
     "classes.tiers.Courier.[key]='Courier': string should match pattern '^[a-z][a-z0-9_]*$'"),
]  # fmt: skip

HUGE = {
    # settings that would take for ever, or more memory than there is: words, the line
    "deep trees": (["gp.max_nodes=1000", "gp.max_depth=50", "gp.trees.depth=[50,50]"],
     "gp.trees.depth: expected random trees of at most 2,000 nodes on average, found larger ones;"),
    "broad trees": (["gp.trees.children=[1,100000]"],
     "gp.trees.children.1=100000: input should be less than or equal to 1000"),
    "trees both deep and broad":
    (["gp.max_nodes=1000", "gp.trees.children=[1,1000]", "gp.trees.depth=[3,3]"],
     "gp.trees.depth: expected random trees of at most 2,000 nodes on average"),
    "endless levels": (["gp.trees.depth=[2,1000000000000000000000]"],
     "gp.trees.depth.1=1000000000000000000000: input should be less than or equal to 50"),
    "a deep subtree": (["gp.mutation.subtree_depth=1000000000"],
     "gp.mutation.subtree_depth=1000000000: input should be less than or equal to 50"),
    "a long sweep": (["seed=range(100000000)", "-m"],
     "seed=range(100000000): expected 1 to 1,000 jobs of a command, found more; write values"),
    "a fine sweep": (["gp.crossover_rate=range(0,1,0.0000000000001)", "-m"],
     "gp.crossover_rate=range(0,1,0.0000000000001): expected 1 to 1,000 jobs of a command,"),
    "a product": (["seed=range(100)", "gp.population=range(10,30)", "-m"],
     "gp.population=range(10,30): expected 1 to 1,000 jobs of a command, found more;"),
    "no step": (["seed=range(0,10,0)", "-m"],
     "seed=range(0,10,0): expected 1 to 1,000 jobs of a command, found none;"),
    "an interval": (["seed=interval(0,3)", "-m"],
     "seed=interval(0,3): expected 1 to 1,000 jobs of a command, found none; write values"),
    "digits": ([f"seed={'1' * 5000}"],
     "seed=11111111111111111111111111111111111111111111111111111111111111111111111111111111111"),
    "levels": ([f"gp.trees.depth={'[' * 400}{']' * 400}"],
     "maximum recursion depth exceeded"),
}  # fmt: skip


@pytest.mark.parametrize("case", HUGE.values(), ids=HUGE)
def test_what_would_never_end_is_one_line(
    case: tuple[list[str], str], capsys: pytest.CaptureFixture[str]
) -> None:
    """At once, before anything of the size is made."""
    arguments, line = case
    (message,) = errors(capsys, *arguments)
    assert message.startswith(line)


def test_a_deleted_working_folder_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """For any command."""
    Path.cwd().rmdir()
    assert main([*OFF]) == 2
    assert capsys.readouterr().err == (
        "islandgp: Expected a folder to work in, found that it was deleted; change to another"
        " one.\n"
    )


def test_the_version_is_that_of_this_package(capsys: pytest.CaptureFixture[str]) -> None:
    """Hydra's version is beside it."""
    assert main(["gp.population=3", "--version"]) == 0
    output = capsys.readouterr().out
    assert output == f"islandgp, version {version('islandgp')}; Hydra {version('hydra-core')}\n"


@pytest.mark.process
def test_a_file_that_shadows_a_python_module_is_named() -> None:
    """The message names the file, for any error that it causes."""
    assert in_the_way(Path.cwd()) == ""
    Path("inspect.py").touch()
    Path("mine.py").touch()
    process = subprocess.run(
        [sys.executable, "-m", "islandgp", "experiment=smoke"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr == f"islandgp: {in_the_way(Path.cwd())}\n"
    assert "found inspect.py in" in process.stderr
    Path("numpy.py").touch()  # a module that is installed
    assert "found inspect.py, numpy.py in" in in_the_way(Path.cwd())


PORT = "tracking.policy.uri: expected http://HOST:PORT with a port from 1 to 65535"
FILE = "tracking.policy.uri: expected a SQLite file that can be written, found"


@pytest.mark.parametrize(
    ("uri", "line"),
    [
        ("http://127.0.0.1:99999", PORT),
        ("http://me:pass@127.0.0.1:0", PORT),
        ("https://:5000", PORT),
        ("http://[::1:5000", PORT),
        ("http://me:p/ss@host", PORT),
        ("sqlite:////proc/x/y.db", f"{FILE} /proc/x/y.db: No such file or directory;"),
        ("sqlite:////dev/null/y.db", f"{FILE} /dev/null/y.db: Not a directory;"),
        ("sqlite:///.", f"{FILE} "),
    ],
)
def test_an_impossible_store_is_reported_before_the_start(
    uri: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """No run waits for it at its end, and no piece of a password is shown."""
    arguments = ["evaluator=serial", "progress=off", "tracking=mlflow"]
    assert main([*arguments, f"tracking.policy.uri='{uri}'"]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"islandgp: {line}")
    assert message.count("\n") == 1
    assert "me:" not in message
    assert list(Path.cwd().iterdir()) == []


@sweep(
    ("arguments", "line"),
    ONE_LINE,
    ids=[" ".join(arguments) for arguments, _ in ONE_LINE],
    quick=24,
)
def test_one_error_one_line(
    arguments: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line names the key and what was found, and what would be right."""
    (message,) = errors(capsys, *arguments)
    assert message.startswith(line)


def test_an_unknown_key_is_no_guess_for_another(capsys: pytest.CaptureFixture[str]) -> None:
    """Each has its line."""
    lines = errors(capsys, "+classes.foo=1", "+world.foo=1")
    assert [line.partition(":")[0] for line in lines] == ["classes.foo", "world.foo"]
    assert not any("did you mean" in line for line in lines)


FILES = [
    # text of a world's file, overrides besides it, the line
    (b"side: [1\nx: {", [],
     'while parsing a flow sequence in "{file}", line 1, column 7 expected'
     ' \',\' or \']\', but got'
     ' \':\' in "{file}", line 2, column 2'),
    (b"side: \x07", [],
     "unacceptable character #x0007: special characters are not allowed in"
     ' "{file}", position 6'),
    (b"defaults: [island]\nside: ${foo}", [],
     "world.side: expected a value, found none (Interpolation key 'foo' not found);"
     " give world.side=VALUE"),
    (b"defaults: [island]\nside: ${oc.env:NOPE}", [],
     "world.side: expected a value, found none (KeyError raised while resolving interpolation:"
     " \"Environment variable 'NOPE' not found\"); give world.side=VALUE"),
    (b"defaults: [nothing]", [], "In 'world/mine': Could not load 'world/nothing'."),
]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "arguments", "line"), FILES, ids=[str(text) for text, *_ in FILES]
)
def test_a_file_of_the_users_that_is_wrong_is_named(
    text: bytes,
    arguments: list[str],
    line: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """One line names the file, or the key in it, and what is wrong there."""
    folder = tmp_path_factory.mktemp("conf")
    file = folder / "world" / "mine.yaml"
    file.parent.mkdir()
    file.write_bytes(text)
    lines = errors(capsys, *arguments, "--config-dir", str(folder), "world=mine")
    assert lines == [line.replace("{file}", str(file))]


def test_a_file_that_another_one_hides_is_reported(
    capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Hydra would read the package's file of that name and never look at the user's."""
    folder = tmp_path_factory.mktemp("conf")
    (folder / "gp").mkdir()
    (folder / "gp" / "paper.yaml").write_text("population: 8\n", encoding="utf-8")
    (line,) = errors(capsys, "--config-dir", str(folder), "gp=paper")
    assert line.startswith("--config-dir: expected files with names of their own, found")


def test_a_domain_is_called_as_its_trees_name_it(
    capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Else its best tree would be played in another file's world."""
    folder = tmp_path_factory.mktemp("conf")
    (folder / "domain").mkdir()
    text = (resource("conf") / "domain" / "island.yaml").read_text(encoding="utf-8")
    (folder / "domain" / "isle.yaml").write_text(text, encoding="utf-8")
    (line,) = errors(capsys, "--config-dir", str(folder), "domain=isle")
    assert line.startswith("domain=isle: expected the file of a domain whose vocabulary is called")


def test_unknown_keys_of_a_launcher(capsys: pytest.CaptureFixture[str]) -> None:
    """The chosen launcher has its own keys."""
    lines = errors(capsys, "hydra/launcher=local", "hydra.launcher.n_jbs=2", "-m")
    assert lines == ["hydra.launcher.n_jbs: unknown key; did you mean hydra.launcher.n_jobs?"]


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
    (message,) = errors(capsys, word)
    assert message.startswith(line)
    group = word.partition("=")[0]
    names = message.split("there are ")[1].split(", ")
    assert set(options(group)) <= set(names), "and those of installed plug-ins"
    assert names == sorted(names)


def test_several_errors_several_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """All errors are reported at once, a line for each."""
    lines = errors(
        capsys,
        "gp.population=1",
        "gp.generations=none",
        "world.robot.speed=-2",
        "+rewards.events.pickup.bonus=3",
        "supervisor=baseline",
        "supervisor.policy.patience=0",
        "supervisor.policy.up=0.5",
    )
    assert [line.partition(":")[0] for line in lines] == [
        "gp.generations='none'",
        "gp.population=1",
        "rewards.events.pickup.bonus",
        "supervisor.policy.patience=0",
        "supervisor.policy.up=0.5",
        "world.robot.speed=-2",
    ]


def test_several_unknown_names_several_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """What the domain does not declare is reported at once, too: rewards, curriculum, classes."""
    lines = errors(
        capsys,
        "rewards.events.pickup.component=trash",
        "+curriculum.stages.0.multipliers.trash=3",
        "classes.behaviours.charging=chargings",
        "+classes.tiers.complete.above.fun=3",
    )
    assert [line.partition(":")[0] for line in lines] == [
        "rewards.events.pickup.component",
        "curriculum.stages.0.multipliers.trash",
        "classes.behaviours.charging",
        "classes.tiers.complete.above.fun",
    ]


@pytest.mark.parametrize("value", ["runs/default/expert=seed0", "it's", "[1,", 'a"=b', "{a: (}"])
def test_a_value_that_cannot_be_read_is_quoted(
    value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line names the override, and ends in words for a shell that mean the value as a text."""
    (message,) = errors(capsys, "supervisor=replay", f"supervisor.policy.transcript={value}")
    start = f"supervisor.policy.transcript={value}: expected KEY=VALUE, found what cannot be read ("
    assert message.startswith(start)
    (word,) = shlex.split(message.partition("needs quotes inside and out: ")[2])
    (override,) = OverridesParser.create().parse_overrides([word])
    assert override.value() == value


def test_a_sweep_is_checked_before_it_starts(capsys: pytest.CaptureFixture[str]) -> None:
    """One wrong job of a sweep, even the last, and none starts."""
    lines = errors(capsys, "experiment=smoke", "gp.population=12,8,3", "-m")
    assert lines == ["gp.population=3: input should be greater than or equal to 4"]


def test_a_sweep_over_the_options_of_a_group(tmp_path: Path) -> None:
    """`glob` takes the options whose names fit, also those in the user's own folder."""
    (tmp_path / "conf/supervisor").mkdir(parents=True)
    (tmp_path / "conf/supervisor/basic.yaml").write_text("defaults: [baseline]\nname: basic\n")
    overrides = [
        *OFF,
        "experiment=smoke",
        "gp.population=4",
        "gp.generations=2",
    ]
    overrides += ["world.episode.length=5", "evaluator=serial", "supervisor=glob(bas*)", "-m"]
    assert main([*overrides, "--config-dir", "conf"]) == 0
    supervisors = {path.name.partition("-")[0] for path in tmp_path.glob("runs/smoke/*/")}
    assert supervisors == {"baseline", "basic"}


def test_run_errors_have_no_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    """What only the run finds out is one message, too: a tree that is not there."""
    assert main([*OFF, "experiment=smoke", "library.trees.pickup=[nope]"]) == 2
    captured = capsys.readouterr()
    assert "nope.bt, found none; there are all_rounder" in captured.err
    assert "Traceback" not in captured.err
    assert list(Path.cwd().iterdir()) == []
