"""Builds BehaviorTree.CPP 4.8 for the tests, from the source package of behaviortreepy.

    python tests/trees/btcpp/build_btcpp.py [FOLDER]

It takes a C++ compiler, CMake, and some minutes; the default folder is
build/behaviortree_cpp, where the tests look for it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGE = "behaviortreepy==0.1.4"  # bundles the sources of BehaviorTree.CPP 4.8.2
OFF = ("SHARED_LIBS", "BUILD_TOOLS", "EXAMPLES", "GROOT_INTERFACE", "SQLITE_LOGGING")


def build(folder: Path) -> None:
    """Leaves the headers in folder/include and the static libraries in folder/lib."""
    with tempfile.TemporaryDirectory() as place:
        download_folder = Path(place)
        pip = [
            sys.executable,
            "-m",
            "pip",
            "download",
            "--no-deps",
            "--no-binary",
            "behaviortreepy",
        ]
        subprocess.run([*pip, "-d", place, PACKAGE], check=True)
        archive = next(download_folder.glob("*.tar.gz"))
        subprocess.run(["cmake", "-E", "tar", "xf", archive], cwd=place, check=True)
        sources = next(download_folder.glob("*/BehaviorTree.CPP"))
        options = [*(f"-DBTCPP_{name}=OFF" for name in OFF), "-DBUILD_TESTING=OFF"]
        build_folder = download_folder / "made"
        options += ["-DCMAKE_BUILD_TYPE=Debug", "-DCMAKE_CXX_FLAGS=-O0 -g0"]
        subprocess.run(["cmake", "-S", sources, "-B", build_folder, *options], check=True)
        subprocess.run(["cmake", "--build", build_folder, "--parallel", "2"], check=True)
        (folder / "lib").mkdir(parents=True, exist_ok=True)
        for library in build_folder.rglob("*.a"):
            shutil.copy(library, folder / "lib")
        shutil.copytree(sources / "include", folder / "include", dirs_exist_ok=True)


if __name__ == "__main__":
    default = Path(__file__).parents[3] / "build" / "behaviortree_cpp"
    build(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
