"""Writes the pages of the documentation's site into build/pages: `make docs` builds it from them.

    python docs/pages.py

They are README.md as the home page, the pages of `docs`, `studies` and `plugins`, CHANGELOG.md and
CONTRIBUTING.md, with their links made to fit; the reference of configuration keys; the reference
of the Python interface, which mkdocstrings fills in; the study's figures; and an episode that plays
in its page.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path

from reference import chapters, page

import islandgp

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
STUDIES = ROOT / "studies"
PLUGINS = ROOT / "plugins"
SITE_PAGES = ROOT / "build" / "pages"

AT_THE_TOP = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
}

MODULES = ("islandgp.domain.contract", "islandgp.domain.simulator", "islandgp.testing.check")
"""What an author of a domain imports besides `islandgp` itself."""

_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
_FENCE = re.compile(r"^```(\w+) (\S+)$", re.MULTILINE)  # its second word is for the tests
_CODE = re.compile(r"(^```.*?^```$|`[^`\n]+`)", re.DOTALL | re.MULTILINE)


def sources() -> dict[str, str]:
    """The place in the site of each file that it takes over, both as paths."""
    places = dict(AT_THE_TOP)
    for folder, top in ((DOCS, DOCS), (STUDIES, ROOT), (PLUGINS, ROOT)):
        for file in sorted(folder.rglob("*")):
            if file.suffix in (".md", ".css", ".gif", ".png", ".svg", ".csv"):
                places[file.relative_to(ROOT).as_posix()] = file.relative_to(top).as_posix()
    return places


def rewritten(text: str, source: str, places: dict[str, str]) -> str:
    """A page's Markdown with links that fit the site.

    A link to a file that the site does not have becomes its label, with the file's name.
    """

    def link(match: re.Match[str]) -> str:
        picture, label, target, anchor = match.groups()
        if ":" in target:
            return match[0]
        path = os.path.normpath(Path(source).parent / target)
        if path in places:
            near = os.path.relpath(places[path], Path(places[source]).parent)
            return f"{picture}[{label}]({near}{anchor or ''})"
        if not (ROOT / path).exists():
            raise SystemExit(
                f"{source}: expected a file at {target}, found none; correct the link."
            )
        if picture:
            raise SystemExit(f"{source}: expected a picture below docs, found {target}; move it.")
        return label if path in label else f"{label} (`{path}`)"

    parts = _CODE.split(text)  # odd ones are code, where brackets are no links
    joined = "".join(f"\0{i}\0" if i % 2 else part for i, part in enumerate(parts))
    linked = _LINK.sub(link, joined)
    code = [_FENCE.sub(_titled, part) for part in parts]
    return re.sub(r"\0(\d+)\0", lambda match: code[int(match[1])], linked)


def _titled(fence: re.Match[str]) -> str:
    """The first line of a block of code: a file's name is its title."""
    language, word = fence.groups()
    return f'```{language} title="{word}"' if "." in word else f"```{language}"


def api() -> str:
    """The reference of the Python interface."""
    lines = [
        "# Python interface\n",
        "The names that `islandgp` itself exports.\n",
        *(
            f"::: {islandgp._HOMES[name]}.{name}\n"
            for name in islandgp.__all__
            if name in islandgp._HOMES
        ),
        "`islandgp.__version__` is the version, as text.\n",
        "## A domain of your own\n",
        "The classes of a domain and its contract tests; [A domain of your own](own_domain.md)"
        " uses them step by step.\n",
        *(f"::: {module}\n    options:\n      show_root_heading: true\n" for module in MODULES),
    ]
    return "\n".join(lines)


def replay(file: Path) -> str:
    """The page of the replay; the recording is written to `file`."""
    from islandgp.cli import islandgp as command

    tree = ROOT / "grammar" / "examples" / "all_rounder.bt"
    command.main(["replay", str(tree), "-o", str(file)], standalone_mode=False)
    return (
        "# An episode\n\nThe example tree `all_rounder` in the world of seed 0, as `islandgp replay"
        " grammar/examples/all_rounder.bt` shows it. [Open it on a page of its own]"
        f"({file.name}).\n\n"
        f'<iframe src="{file.name}" title="A replay of all_rounder" style="width: 100%;'
        ' height: 85vh; border: 1px solid #8886"></iframe>\n'
    )


GENERATED: dict[str, Callable[[], str]] = {
    "configuration.md": lambda: page(chapters()),
    "api.md": api,
    "episode.md": lambda: replay(SITE_PAGES / "all_rounder.html"),
}


def write() -> None:
    """Writes all pages; what was there before is removed."""
    shutil.rmtree(SITE_PAGES, ignore_errors=True)
    places = sources()
    for source, place in places.items():
        target = SITE_PAGES / place
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.suffix == ".md":
            text = (ROOT / source).read_text(encoding="utf-8")
            target.write_text(rewritten(text, source, places), encoding="utf-8")
        else:
            shutil.copyfile(ROOT / source, target)
    for name, generate in GENERATED.items():
        (SITE_PAGES / name).write_text(generate(), encoding="utf-8")


if __name__ == "__main__":
    write()
