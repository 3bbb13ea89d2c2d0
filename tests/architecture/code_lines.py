"""Lines of code by folder, without blank lines, comments and docstrings: `make lines`.

python -m tests.architecture.code_lines [FOLDER]

The last line counts the modules of the package that a default run imports.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

NO_CODE: Final = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


DOCUMENTED: Final = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(source: str) -> int:
    """The number of lines of Python source on which there is code."""
    lines = {
        line
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type not in NO_CODE
        for line in range(token.start[0], token.end[0] + 1)
    }
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node) is not None:
            text = node.body[0]
            lines -= set(range(text.lineno, (text.end_lineno or text.lineno) + 1))
    return len(lines)


def by_folder(package: Path) -> Counter[str]:
    """The lines of code of each folder right below a package; its own modules are "."."""
    counted: Counter[str] = Counter()
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).parts
        folder = parts[0] if len(parts) > 1 else "."
        counted[folder] += code_lines(path.read_text(encoding="utf-8"))
    return counted


def of_a_default_run(package: Path) -> int:
    """The lines of code of the package's modules that a short default run imports."""
    command = [sys.executable, "-X", "importtime", "-m", package.name]
    command += ["gp.generations=1", "gp.population=4", "gp.validation=0", "tracking=off"]
    command += ["evaluator.policy.workers=1"]
    with TemporaryDirectory() as runs:
        process = subprocess.run(
            [*command, f"runs={runs}"],
            cwd=package.parent,
            capture_output=True,
            text=True,
            check=True,
        )
    names = set(re.findall(rf"\|\s+({package.name}(?:\.\w+)*)$", process.stderr, re.MULTILINE))
    paths = [package.joinpath(*name.split(".")[1:]) for name in names]
    modules = [(path.with_suffix(".py"), path / "__init__.py") for path in paths]
    files = [module if module.exists() else folder for module, folder in modules]
    return sum(code_lines(file.read_text(encoding="utf-8")) for file in files)


def main(package: Path) -> None:
    """Print a line for each folder, the sum, and the lines that a default run imports."""
    counted = by_folder(package)
    rows = [*sorted(counted.items()), ("in all", counted.total())]
    if package.name == "islandgp":
        rows.append(("of a run", of_a_default_run(package.resolve())))
    for folder, lines in rows:
        print(f"{folder:12}{lines:8,}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "islandgp"))
