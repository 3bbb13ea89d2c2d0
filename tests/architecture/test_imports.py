"""Imports go one way (docs: the layout), and slow libraries are imported where they are used."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from collections import Counter
from graphlib import TopologicalSorter
from itertools import chain, combinations
from pathlib import Path

import pytest

from tests.architecture.sources import PACKAGE, ROOT, imports, module_name, modules

LAYERS: list[tuple[str, ...]] = [
    # A module imports from its own layer and those above it in this list, never from below.
    (
        "startup",
        "errors",
        "plain",
        "seeding",
        "resources",
        "installed",
        "plugin",
        "time_limit",
        "gate",
        "text",
        "text_files",
        "atomic_files",
        "statistics",
    ),
    ("bt.core",),
    ("bt.analysis", "bt.export", "leaves"),
    ("domain", "binding"),
    ("scoring", "domains"),
    ("gp",),
    ("search", "evaluation"),
    ("supervision",),
    ("evolution",),
    ("records", "viewer", "tracking", "compare", "results"),
    ("config", "running"),
    ("experiment", "commands", "testing", "cli", "__main__"),
]
NAMES_ONLY = ("", "evolution", "bt", "gp")  # packages whose __init__ holds nothing but names

MAY_IMPORT: dict[str, tuple[str, ...]] = {
    # library: the modules that may
    "pymunk": ("domains.island",),
    "gymnasium": ("domains.gymnasium",),
    "hydra": ("config", "running", "commands"),
    "omegaconf": ("config",),
    "mlflow": ("tracking",),
    "anthropic": ("supervision.llm.client",),
    "httpx2": ("supervision.llm.client",),
    "xllamacpp": ("supervision.llm.client",),
    "scipy": ("statistics", "compare"),
    "matplotlib": ("compare",),
    "lark": ("bt",),
    "jinja2": ("compare.report", "supervision.llm.prompts", "viewer.page"),
    "numba": ("domains.island",),
    "llvmlite": ("domains.island.chipmunk",),
}

SLOW = (
    "mlflow",
    "scipy",
    "matplotlib",
    "anthropic",
    "httpx2",
    "pandas",
    "lark",
    "rich",
    "gymnasium",
    "numba",
    "llvmlite",
)

DISTRIBUTIONS = {
    # import name: name on the index
    "hydra": "hydra-core",
    "yaml": "pyyaml",
}


def below(module: str, prefix: str) -> bool:
    """Whether a module is the prefix or lies under it."""
    return module == prefix or module.startswith(f"{prefix}.")


def package(module: str) -> str:
    """The entry of LAYERS that a module belongs to."""
    entries = [entry for entry in chain(*LAYERS) if below(module, entry)]
    assert entries, f"islandgp.{module}: add it to LAYERS, where it belongs"
    return max(entries, key=len)


def test_every_package_exists() -> None:
    """A new module or package must be added to a layer; there are at most twelve."""
    names = {name for path in modules() if (name := module_name(path)) not in NAMES_ONLY}
    assert {package(name) for name in names} == {*chain(*LAYERS)}
    assert len(LAYERS) <= 12


def test_the_picture_of_the_rooms_has_each_of_them() -> None:
    """`python -m docs.rooms` draws it."""
    picture = (ROOT / "docs" / "img" / "rooms.svg").read_text(encoding="utf-8")
    assert [name for name in chain(*LAYERS[1:]) if f">{name}</text>" not in picture] == []


def test_imports_go_one_way() -> None:
    """Nothing imports from a later layer, and packages of a layer do not import in a circle."""
    layers = {entry: number for number, entries in enumerate(LAYERS) for entry in entries}
    graph: dict[str, set[str]] = {entry: set() for entry in layers}
    for i in imports():
        target = i.name.removeprefix("islandgp").removeprefix(".")
        if i.top == "islandgp" and not {target, i.module} & {*NAMES_ONLY}:
            one, other = package(i.module), package(target)
            assert layers[other] <= layers[one], f"{i.module} imports {i.name}"
            graph[one] |= {other} - {one}
    TopologicalSorter(graph).prepare()  # raises CycleError


@pytest.mark.parametrize("pair", list(combinations(["supervision", "evaluation"], 2)))
def test_supervisors_and_evaluators_do_not_import_each_other(pair: tuple[str, str]) -> None:
    """Supervisors know no evaluator, and evaluators no supervisor."""
    for one, other in (pair, pair[::-1]):
        violations = [
            i for i in imports() if below(i.module, one) and below(i.name, f"islandgp.{other}")
        ]
        assert violations == []


@pytest.mark.parametrize("library", MAY_IMPORT)
def test_libraries_are_imported_in_their_layer_only(library: str) -> None:
    """Each of these libraries has its own place."""
    places = MAY_IMPORT[library]
    users = {i.module for i in imports() if i.top == library}
    assert {user for user in users if not any(below(user, place) for place in places)} == set()


@pytest.mark.parametrize("library", SLOW)
def test_slow_libraries_wait(library: str) -> None:
    """Slow libraries are imported in functions, not when a module is loaded."""
    importers = {i.module for i in imports() if i.top == library and i.at_load}
    in_functions = {
        "domains.island.chipmunk",
        "domains.island.engine",
        "domains.island.memory",
    }  # themselves imported so
    assert importers - in_functions == set()


def loaded_after(code: str) -> set[str]:
    """The slow libraries that a fresh interpreter has loaded after some code."""
    tail = f"\nimport sys\nprint(*[name for name in {SLOW!r} if name in sys.modules])"
    process = subprocess.run(
        [sys.executable, "-c", code + tail],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": "."},
        capture_output=True,
        text=True,
        check=True,
    )
    return set(process.stdout.split())


@pytest.mark.process
def test_starting_is_quick() -> None:
    """Importing the rim loads no slow library."""
    rim = (
        "config.settings",
        "config.compose",
        "running.run",
        "running.sweep",
        "running.app",
        "cli",
    )
    assert loaded_after("\n".join(f"import islandgp.{module}" for module in (*rim, "cli"))) == set()


@pytest.mark.process
def test_a_robot_loads_little() -> None:
    """A tree in a user's program loads no simulator and nothing that evolves or reports."""
    code = (
        "import islandgp\n"
        "tree = islandgp.load_tree('grammar/examples/all_rounder.bt')\n"
        "leaves = dict.fromkeys(tree.actions(), lambda: False)\n"
        "robot_tree = tree.bind(leaves, dict.fromkeys(tree.keys(), 0))\n"
        "assert robot_tree.tick() == islandgp.NodeStatus.FAILURE\n"
        "import sys\n"
        "heavy = {'pymunk', 'hydra', 'omegaconf', 'numpy', 'mlflow', 'pandas', 'matplotlib'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    assert loaded_after(code) <= {"lark"}


@pytest.mark.process
def test_validating_is_quick() -> None:
    """Choosing the language model or MLflow loads none of them before a run begins."""
    code = "from tests.composed import composed\ncomposed('supervisor=llm', 'tracking=mlflow')\n"
    assert loaded_after(code) == set()


@pytest.mark.process
def test_help_is_quick() -> None:
    """`islandgp --help` lists the commands without importing one."""
    code = (
        "import contextlib, io\n"
        "from islandgp.cli import islandgp\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        "    islandgp(['--help'], standalone_mode=False)\n"
        "import sys\n"
        "assert not [name for name in sys.modules if name.startswith('islandgp.commands.')]\n"
    )
    assert loaded_after(code) == set()


def declared(folder: Path) -> set[str]:
    """The names in a folder's pyproject.toml: dependencies and extras."""
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project.get("optional-dependencies", {})
    lines = [*project["dependencies"], *chain(*extras.values())]
    names = {re.split(r"[ <>=!~;\[]", line)[0].lower() for line in lines}
    return names - {"islandgp"}  # extras that hold other extras


def test_dependencies_are_declared() -> None:
    """Every import is in pyproject.toml, in the dependencies or in an extra."""
    imported = {i.top for i in imports()} - set(sys.stdlib_module_names) - {"islandgp"}
    assert {DISTRIBUTIONS.get(name, name) for name in imported} - declared(ROOT) == set()


def test_dependencies_are_documented() -> None:
    """Each dependency has its line in docs/dependencies.md, and each line its dependency."""
    text = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    documented = {
        name.lower() for name in re.findall(r"^\| \[?([\w.-]+)\]?.* \|$", text, re.MULTILINE)
    }
    plugins = [declared(file.parent) for file in ROOT.glob("plugins/*/pyproject.toml")]
    assert documented - {"package"} == declared(ROOT).union(*plugins)


def test_no_module_is_a_drawer() -> None:
    """A file is named for its one idea."""
    drawers = {"utils", "util", "helpers", "helper", "common", "misc", "manager", "tools"}
    assert [p for p in PACKAGE.rglob("*") if p.stem in drawers] == []


def test_no_global_random() -> None:
    """Randomness is an argument: nobody imports `random` or seeds NumPy."""
    assert [i.module for i in imports() if i.name == "random"] == []
    sources = {module_name(path): path.read_text(encoding="utf-8") for path in modules()}
    assert [name for name, text in sources.items() if "np.random.seed" in text] == []


def test_a_class_has_a_name_of_its_own() -> None:
    """No two modules of the package define classes of one name, but private ones."""
    pattern = re.compile(r"^class ([A-Z]\w*)", re.MULTILINE)
    names = [name for path in modules() for name in pattern.findall(path.read_text("utf-8"))]
    assert sorted(name for name, count in Counter(names).items() if count > 1) == []
