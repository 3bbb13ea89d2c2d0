"""Groot2's view of a running tree; without ROS 2 and without Groot2.

The client is written from the protocol (groot2_protocol.h). It reads BehaviorTree.CPP's own
publisher first.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from test_view import port, succeed

from islandgp.binding import load_tree
from islandgp.errors import ConfigError
from islandgp_ros2.groot import Groot, groot_served

zmq = pytest.importorskip("zmq", reason="pip install 'islandgp-ros2[groot]'")
msgpack = pytest.importorskip("msgpack", reason="pip install 'islandgp-ros2[groot]'")

__all__ = ["port"]

NAMES = {0: "IDLE", 1: "RUNNING", 2: "SUCCESS", 3: "FAILURE", 4: "SKIPPED"}
IDLE = 10  # plus the status before


class Client:
    """Asks as Groot2 does."""

    def __init__(self, port: int) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.linger, self._socket.rcvtimeo = 0, 5000
        self._socket.connect(f"tcp://127.0.0.1:{port}")
        self.tree_id = b""

    def ask(self, kind: str, *frames: bytes) -> bytes:
        """The payload of a reply."""
        header = struct.pack("<BBI", 2, ord(kind), 4711)
        first, payload = self.send(header, *frames)
        assert (first[:6], len(first)) == (header, 22)
        self.tree_id = first[6:]
        return payload

    def send(self, *frames: bytes) -> tuple[bytes, bytes]:
        """The two frames of a reply. Raises ValueError with the text of an error."""
        self._socket.send_multipart(frames)
        first, payload = self._socket.recv_multipart()
        if first == b"error":
            raise ValueError(payload.decode())
        return first, payload

    def statuses(self) -> dict[str, str]:
        """The status of each node of the main tree, by the name that the tree gives it."""
        payload = self.ask("S")
        assert len(payload) % 3 == 0
        codes = dict(struct.iter_unpack("<HB", payload))
        root = ET.fromstring(self.ask("T"))
        nodes = root.iterfind("BehaviorTree//*")
        found = {node.attrib["name"]: codes[int(node.attrib["_uid"])] for node in nodes}
        assert len(found) == len(codes)
        return {name: NAMES[code] if code < IDLE else "IDLE" for name, code in found.items()}

    def board(self) -> Any:
        """The blackboard of the main tree."""
        return msgpack.unpackb(self.ask("B", b"Main"))["Main"]

    def close(self) -> None:
        """Ends the connection."""
        self._context.destroy()


@pytest.fixture
def client(port: int) -> Iterator[Client]:
    """A client of a free port."""
    with closing(Client(port)) as instance:
        yield instance


def test_the_client_reads_the_library(client: Client, port: int) -> None:
    """BehaviorTree.CPP's own publisher is read as the protocol says."""
    library = pytest.importorskip("behaviortreepy")
    tree = library.BehaviorTreeFactory().create_tree_from_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence name="all">'
        '<Script name="set" code="n:=7"/><Delay name="later" delay_msec="60000">'
        '<AlwaysSuccess name="end"/></Delay></Sequence></BehaviorTree></root>'
    )
    publisher = library.Groot2Publisher(tree, port)
    tree.tick_exactly_once()
    running = {"all": "RUNNING", "set": "SUCCESS", "later": "RUNNING", "end": "IDLE"}
    assert client.statuses() == running
    assert client.board() == {"n": 7}
    del publisher


def test_a_tree(client: Client, port: int, tmp_path: Path) -> None:
    """It has nodes with statuses, and keys; a tree that is loaded again has another ID."""
    file = tmp_path / "a <b>.bt"
    file.write_text("selector { when battery < 20 { Dock } inverter { Wave } Drive }")

    def drive() -> Iterator[None]:
        while True:
            yield

    leaves = {"Dock": succeed, "Wave": succeed, "Drive": drive}
    robot = load_tree(file).bind(leaves, {"battery": 80})
    groot = Groot(robot)
    with groot_served(groot, port):
        assert {*client.statuses().values()} == {"IDLE"}
        first = client.tree_id
        robot.tick()
        groot.add(robot, True)
        assert client.statuses() == {
            "selector": "RUNNING",
            "when battery < 20": "FAILURE",
            "Dock": "IDLE",
            "inverter": "FAILURE",
            "Wave": "SUCCESS",
            "Drive": "RUNNING",
        }
        assert client.board() == {"battery": 80.0}
        robot.stop()
        groot.add(robot, False)
        assert client.statuses()["Drive"] == "IDLE"
        assert client.tree_id == first
        file.write_text("Wave")
        groot.add(load_tree(file).bind(leaves), False)
        assert client.statuses() == {"Wave": "IDLE"}
        assert client.tree_id != first
        model = ET.fromstring(client.ask("T")).find("TreeNodesModel")
        assert [(each.tag, each.attrib) for each in model or ()] == [("Action", {"ID": "Wave"})]


def test_breakpoints_are_refused(client: Client, port: int, tmp_path: Path) -> None:
    """Nothing that Groot2 sends changes what the robot does; odd requests do no harm."""
    file = tmp_path / "t.bt"
    file.write_text("Drive")
    with groot_served(Groot(load_tree(file).bind({"Drive": succeed})), port):
        for kind in "IUrtZ":
            with pytest.raises(ValueError, match="no breakpoints and no recordings"):
                client.ask(kind, b"{}")
        assert client.ask("D") == b"[]"
        with pytest.raises(ValueError, match="wrong request header"):
            client.send(b"hello")
        assert client.statuses() == {"Drive": "IDLE"}
        with pytest.raises(ConfigError, match=f"free port as --groot, found {port}"):
            groot_served(Groot(load_tree(file).bind({"Drive": succeed})), port).__enter__()
