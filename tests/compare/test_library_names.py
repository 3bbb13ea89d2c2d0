"""The names of a run's library trees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from islandgp.bt.core.language import parse, to_text
from islandgp.compare.library import library_names
from islandgp.gate import user_folder
from tests.domains.courier import SCHEMA
from tests.domains.test_words_in_runs import CONFIG
from tests.records.configured import naming


def test_other_files_of_the_folder_have_no_name(tmp_path: Path) -> None:
    """Trees that were changed since, and files that are no text."""
    (tmp_path / "home.bt").write_text("Drive", encoding="utf-8")
    (tmp_path / "other.bt").write_text("NoAction", encoding="utf-8")
    (tmp_path / "latin.bt").write_bytes("# Stra\xdfe\nDrive".encode("latin-1"))
    config: dict[str, Any] = yaml.safe_load(CONFIG)
    config["library"] = {"folder": str(tmp_path)}
    with user_folder(naming(tmp_path / "conf", "tests.domains.courier:Courier")):
        assert list(library_names(config).values()) == ["home"]


def test_names_of_trees_with_written_defaults(tmp_path: Path) -> None:
    """A record has the canonical text, without the argument that is written but the default."""
    (tmp_path / "home.bt").write_text("when place != road { Drive(to: road) }", encoding="utf-8")
    config: dict[str, Any] = yaml.safe_load(CONFIG)
    config["library"] = {"folder": str(tmp_path)}
    recorded = to_text(parse("when place != road { Drive }", SCHEMA.vocabulary))
    with user_folder(naming(tmp_path / "conf", "tests.domains.courier:Courier")):
        assert library_names(config) == {recorded: "home"}
