"""The page of a running tree, served on the loopback interface; without ROS 2."""

from __future__ import annotations

import json
import re
import socket
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

from islandgp.binding import RobotTree, load_tree
from islandgp.errors import ConfigError
from islandgp_ros2.view import LastMinute, viewed


def succeed() -> bool:
    """An action."""
    return True


@pytest.fixture
def robot(tmp_path: Path) -> RobotTree:
    """A tree whose key and action succeed."""
    file = tmp_path / "a <b>.bt"
    file.write_text("selector { when battery < 20 { Dock } Drive }")
    return load_tree(file).bind({"Dock": succeed, "Drive": succeed, "battery": 80})


@pytest.fixture
def port() -> int:
    """A free port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def get(port: int, path: str, host: str = "localhost") -> tuple[int, str]:
    """The status and the text of an answer."""
    connection = HTTPConnection("127.0.0.1", port, timeout=5)
    connection.request("GET", path, headers={"Host": f"{host}:{port}"})
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def data_of(page: str) -> Any:
    """The data of a replay page."""
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def test_the_last_minute(robot: RobotTree) -> None:
    """It has the statuses and the keys of 60 s, none while the tree waits, and no other tree's."""
    minute = LastMinute(robot, 0.5)
    for _ in range(3):
        robot.tick()
        minute.add(robot, True)
    data = data_of(minute.page())
    assert [node["label"] for node in data["nodes"]][2:] == ["Dock", "Drive"]
    assert data["statuses"] == [".s3", ".f3", ".4", ".s3"]
    assert data["board"][0]["changes"] == [0, None, 1, 80.0]
    for _ in range(200):
        minute.add(robot, True)
    assert data_of(minute.page())["ticks"] == 120
    other = load_tree(robot.tree.name).bind({"Dock": succeed, "Drive": succeed, "battery": 80})
    minute.add(other, False)
    assert data_of(minute.page())["ticks"] == 1


def test_only_this_computer_sees_it(robot: RobotTree, port: int) -> None:
    """Only its two pages are there, for no website, and nothing after the end."""
    with viewed(LastMinute(robot, 0.1), port):
        assert get(port, "/")[0] == get(port, "/minute")[0] == 200
        assert "a &lt;b&gt;.bt" in get(port, "/minute")[1]
        assert get(port, "/other")[0] == 404
        assert get(port, "/minute", "robots.example")[0] == 404
        with pytest.raises(ConfigError, match=f"free port as --view, found {port}"):
            viewed(LastMinute(robot, 0.1), port).__enter__()
    with pytest.raises(ConnectionRefusedError):
        get(port, "/")
