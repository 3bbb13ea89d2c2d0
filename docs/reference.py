"""The reference of every configuration key, as a page of the site: docs/pages.py writes it.

Types, ranges and the check of a value are those of the pydantic models; defaults are what a run
gets; meanings are the comments beside a model's field and beside the key in `conf`, and the
paper's section is named where one of the two names it.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from textwrap import dedent
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic import BaseModel, SecretStr
from pydantic.fields import FieldInfo

from islandgp.commands.setting import configured
from islandgp.config.settings import Settings
from islandgp.plugin import ComponentConfig, path_of
from islandgp.resources import resource
from islandgp.supervision.expert import ExpertSettings

CONF = resource("conf")

_PAPER = re.compile(
    r"\b(?:[Ss]ections? [\d.]*\d(?:,? and [\d.]*\d)?|Tables? \d+|Eq\. \(\d+\)|Fig\. \d+)"
)
_CHOICES = ("search", "supervisor", "evaluator", "tracking")
"""Groups whose key `policy` has other keys with each option."""

_ABSENT: Any = object()
"""The default of a key that has none."""

_LONGEST = 48  # characters of a default; a longer one is read in its file

_BOUNDS = {"ge": ">= {}", "gt": "> {}", "le": "<= {}", "lt": "< {}"}
_ONE = {"entries": "entry", "characters": "character"}
_SIZES = {"min_length": "at least {} {}", "max_length": "at most {} {}"}


@dataclass(frozen=True, slots=True)
class Key:
    """One line of the reference."""

    path: str  # as in an override; NAME and N are a key of a mapping and a place in a list
    type: str
    range: str  # empty: any value of the type
    default: str
    meaning: str
    paper: str  # sections, tables and equations of the paper


@dataclass(frozen=True, slots=True)
class Chapter:
    """A group of configuration, or one of its options."""

    title: str
    files: tuple[Path, ...]  # of conf: each option of the group
    keys: tuple[Key, ...]


def chapters() -> list[Chapter]:
    """The whole configuration, in the order of a run's settings."""
    settings = configured(["supervisor=expert", "tracking=mlflow"])
    comments = _comments(_files("config"))
    scalars = [n for n in Settings.model_fields if not (CONF / n).is_dir() and n != "domain"]
    all_chapters = [
        Chapter("Of a run", _files("config"), tuple(_some(settings, scalars, comments)))
    ]
    for name in (n for n in Settings.model_fields if n not in scalars):
        value, files = getattr(settings, name), _files(name)
        comments = _comments(files)
        if name in _CHOICES:
            all_chapters += [_option(name, file) for file in files]
        elif name == "allocation":  # each search has its own
            for file in files:
                slots = configured([f"search={file.stem}"]).allocation
                keys = tuple(_keys(type(slots), slots, name, _comments([file])))
                all_chapters.append(Chapter(f"`{name}` of `search={file.stem}`", (file,), keys))
        else:
            keys = tuple(_keys(type(value), value, name, comments))
            all_chapters.append(Chapter(f"`{name}`", files, keys))
    for file in sorted((CONF / "hydra" / "launcher").glob("*.yaml")):
        all_chapters.append(
            Chapter(f"`hydra/launcher={file.stem}`", (file,), tuple(_launcher(file)))
        )
    return all_chapters


def page(all_chapters: Iterable[Chapter]) -> str:
    """The reference as Markdown."""
    parts = [
        "# Configuration keys\n\nEvery key that a run takes, as `key=value` on the command line or"
        " in a YAML file; see [Running](running.md). `NAME` is a name of your own, or"
        " one that is there, and `N` for a place in a list, from 0. This page is made from the"
        " models that check the configuration and from the files in `conf`.\n"
    ]
    for chapter in all_chapters:
        files = ", ".join(f"`conf/{file.relative_to(CONF)}`" for file in chapter.files)
        parts.append(f"\n## {chapter.title}\n\n{files}\n\n")
        rows = [
            (f"`{key.path}`", key.type, key.range, key.default, key.meaning, key.paper)
            for key in chapter.keys
        ]
        head = ("key", "type", "range", "default", "meaning", "paper")
        lines = [head, tuple("---" for _ in head), *rows]
        parts += [f"| {' | '.join(_cell(text) for text in line)} |\n" for line in lines]
    return "".join(parts)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _files(group: str) -> tuple[Path, ...]:
    file = CONF / f"{group}.yaml"
    return (file,) if file.exists() else tuple(sorted((CONF / group).glob("*.yaml")))


def _option(group: str, file: Path) -> Chapter:
    """An option of a group with a `policy`."""
    value = getattr(configured([f"{group}={file.stem}"]), group)
    # A search's file is one of the whole configuration, so its keys begin with the group's name.
    comments = {path.removeprefix("search."): note for path, note in _comments([file]).items()}
    if group == "search":
        shared = _comments(_files("search/breeding"))
        comments = {f"policy.breeding.{path}": note for path, note in shared.items()} | comments
    if issubclass(value.factory.Settings, ExpertSettings):
        comments = {**_comments([CONF / group / "expert.yaml"]), **comments}
    return Chapter(
        f"`{group}={file.stem}`", (file,), tuple(_keys(type(value), value, group, comments))
    )


def _launcher(file: Path) -> Iterator[Key]:
    """Keys of a launcher."""
    comments = _comments([file])
    for path, value in _leaves(yaml.safe_load(file.read_text(encoding="utf-8"))):
        note = comments.get(path, "") or "a parameter of submitit"
        yield Key(f"hydra.launcher.{path}", type(value).__name__, "", _default(value), note, "")


def _leaves(values: Mapping[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if name == "defaults":
            continue
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{path}{name}.")
        else:
            yield f"{path}{name}", value


def _some(value: BaseModel, names: Iterable[str], comments: Mapping[str, str]) -> Iterator[Key]:
    for name in names:
        yield from _field(type(value), name, getattr(value, name), name, name, comments)


def _keys(
    model: type[BaseModel], value: Any, path: str, comments: Mapping[str, str], inner: str = ""
) -> Iterator[Key]:
    """The keys of a model.

    Args:
        value: what the configuration has there: a model, a mapping, or None.
        inner: line of the model in its file.
    """
    for name, field in model.model_fields.items():
        if name == "policy" and isinstance(value, ComponentConfig):
            policy = value.factory.Settings
            yield from _keys(
                policy, value.settings(), f"{path}.{name}", comments, f"{inner}{name}."
            )
            continue
        if value is None:
            configured_value = _ABSENT if field.is_required() else field.default
        else:
            configured_value = (
                value.get(name) if isinstance(value, Mapping) else getattr(value, name)
            )
        yield from _field(
            model, name, configured_value, f"{path}.{name}", f"{inner}{name}", comments
        )


def _field(
    model: type[BaseModel],
    name: str,
    configured_value: Any,
    path: str,
    inner: str,
    comments: Mapping[str, str],
) -> Iterator[Key]:
    field = model.model_fields[name]
    below, step = _model_in(field.annotation)
    if below is None or step:
        note = _join(_field_comment(model, name), comments.get(inner, ""))
        paper = ", ".join(dict.fromkeys(_PAPER.findall(note)))
        kind = "class" if name == "factory" else _type(field.annotation)
        yield Key(path, kind, _range(field), _default(configured_value), note, paper)
    if below is not None:
        below_value = None if step or configured_value is _ABSENT else configured_value
        yield from _keys(below, below_value, f"{path}{step}", comments, f"{inner}{step}.")


def _model_in(kind: Any) -> tuple[type[BaseModel] | None, str]:
    """The model that a type holds, and the step to it: `.NAME` in a mapping, `.N` in a list."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind, ""
    origin, inner = get_origin(kind), [a for a in get_args(kind) if a is not Ellipsis]
    if origin is Annotated or origin in (Union, UnionType):
        for part in inner:
            if (model := _model_in(part))[0] is not None:
                return model
    elif isinstance(origin, type) and inner and (model := _model_in(inner[-1])[0]):
        return model, ".NAME" if issubclass(origin, Mapping) else ".N"
    return None, ""


def _type(kind: Any) -> str:
    """A type in words."""
    origin, inner = get_origin(kind), get_args(kind)
    if kind is None or kind is type(None):
        return "null"
    if origin is Literal:
        return "choice"
    if origin is Annotated:
        name = _type(inner[0])
        return "class" if "ImportString" in repr(kind) else name
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_type(part) for part in inner))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"mapping of {_type(inner[1])}"
    if isinstance(origin, type) and issubclass(origin, tuple | list | frozenset | set):
        parts = [part for part in inner if part is not Ellipsis]
        if Ellipsis in inner or len(parts) == 1:
            return f"list of {_type(parts[0])}"
        return f"[{', '.join(_type(part) for part in parts)}]"
    if isinstance(kind, type):
        type_names = {SecretStr: "secret", bool: "bool", int: "int", float: "float", str: "text"}
        return type_names.get(
            kind, "mapping" if issubclass(kind, BaseModel | dict) else kind.__name__
        )
    return "class" if "ImportString" in repr(kind) else "any"


def _range(field: FieldInfo) -> str:
    """What a value may be, of its field and of its parts."""
    listed = _type(field.annotation).startswith(("list", "mapping", "["))
    bounds = _bounds(field.metadata, "entries" if listed else "characters")
    return "; ".join(dict.fromkeys([*bounds, *_inner(field.annotation)]))


def _inner(kind: Any) -> Iterator[str]:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Literal:
        yield ", ".join(f"`{choice}`" for choice in inner)
        return
    if origin is Annotated:
        for constraint in inner[1:]:
            yield from _bounds(getattr(constraint, "metadata", [constraint]), "characters")
        inner = inner[:1]
    for part in inner:
        yield from _inner(part)


def _bounds(metadata: Iterable[Any], unit: str) -> Iterator[str]:
    for limit in metadata:
        for name, template in _BOUNDS.items():
            if (bound := getattr(limit, name, None)) is not None:
                yield template.format("2^63" if bound >= 2**63 else f"{bound:,}".removesuffix(".0"))
        for name, template in _SIZES.items():
            if (bound := getattr(limit, name, None)) is not None:
                yield template.format(bound, unit if bound != 1 else _ONE[unit])
        if (pattern := getattr(limit, "pattern", None)) is not None:
            yield f"`{pattern}`"


def _default(value: Any) -> str:
    if value is _ABSENT:
        return ""
    if inspect.isclass(value) or inspect.isfunction(value):
        return f"`{path_of(value)}`"
    text = json.dumps(value, default=_plain, ensure_ascii=False)
    if len(text) > _LONGEST:
        return "in the file"
    return f"`{text[1:-1] if isinstance(value, str) and value else text}`"


def _plain(value: Any) -> Any:
    return value.model_dump(mode="json") if isinstance(value, BaseModel) else str(value)


def _join(field: str, file: str) -> str:
    """The description of a key in the model and in its file."""
    texts = [text for text in (field, file) if text]
    if len(texts) == 2 and (file.startswith(field) or field.startswith(file)):
        return max(texts, key=len)
    return "; ".join(texts)


@cache
def _fields_comments(model: type[BaseModel]) -> dict[str, str]:
    """The comment or the docstring of each field that a class itself declares."""
    source = dedent(inspect.getsource(model))
    lines, comments = source.splitlines(), {}
    [declared] = ast.parse(source).body
    assert isinstance(declared, ast.ClassDef)
    for at, part in enumerate(declared.body):
        if not (isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)):
            continue
        assert part.end_lineno is not None
        after = lines[part.end_lineno - 1].encode()[part.end_col_offset :].decode()
        comments[part.target.id] = after.partition("#")[2].strip()
        following = declared.body[at + 1] if at + 1 < len(declared.body) else None
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            comments[part.target.id] = " ".join(str(following.value.value).split())
    return comments


def _field_comment(model: type[BaseModel], name: str) -> str:
    for kind in model.__mro__:
        if issubclass(kind, BaseModel) and kind is not BaseModel:
            comments = _fields_comments(kind)
            if name in comments:
                text = comments[name]
                break
    else:
        text = ""
    if text:
        return text
    below, _ = _model_in(model.model_fields[name].annotation)
    return (below.__doc__ or "").splitlines()[0] if below else ""


def _comments(files: Iterable[Path]) -> dict[str, str]:
    """The comment beside each key of YAML files, by its path; the first file that has one."""
    comments: dict[str, str] = {}
    for file in files:
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines()
        for path, key, value in _nodes(yaml.compose(text)):
            last = value.end_mark if value.end_mark.line == key.end_mark.line else key.end_mark
            after = lines[last.line][last.column :] if last.line < len(lines) else ""
            comment = re.search(r"(?:^|\s)#\s*(.*)", after)
            if comment and path not in comments:
                comments[path] = comment[1].strip()
    return comments


def _nodes(node: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Each key with its value, of nested mappings."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield f"{path}{key.value}", key, value
            yield from _nodes(value, f"{path}{key.value}.")
