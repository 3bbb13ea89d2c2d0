"""`--groot`: a running tree for Groot2, by the protocol of BehaviorTree.CPP's Groot2Publisher.

Source: BehaviorTree.CPP, include/behaviortree_cpp/loggers/groot2_protocol.h (protocol 2) and
src/loggers/groot2_publisher.cpp. Requests and replies are ZeroMQ messages of several frames. The
first one of a request is its header; a reply repeats it and adds the ID of the tree. Breakpoints,
which could change what a robot does, and recordings are refused.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from threading import Event, Thread
from typing import Any, Final
from uuid import uuid4
from xml.etree import ElementTree as ET

from islandgp.binding import NodeStatus, RobotTree, Tree
from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import Node
from islandgp.bt.core.printer import head
from islandgp.errors import ConfigError

PROTOCOL: Final = 2
MAIN: Final = "Main"  # name of the tree and of its blackboard
HEADER: Final = struct.Struct("<BcI")  # protocol, kind of request, its number
STATUS: Final = struct.Struct("<HB")  # number of a node, its status
_CODES: Final = {
    None: 0,
    NodeStatus.RUNNING: 1,
    NodeStatus.SUCCESS: 2,
    NodeStatus.FAILURE: 3,
    NodeStatus.ABORTED: 11,  # idle, after it was running
}


class Groot:
    """The present state of a tree, as Groot2 asks for it."""

    def __init__(self, robot_tree: RobotTree) -> None:
        """Starts with the state of a tree."""
        self._tree: Tree | None = None
        self.add(robot_tree, False)

    def add(self, robot_tree: RobotTree, _: bool) -> None:
        """Sets the present state, perhaps of another tree."""
        import msgpack

        if robot_tree.tree is not self._tree:
            self._tree, self._id, self._xml = robot_tree.tree, uuid4().bytes, xml_of(robot_tree)
        codes = [_CODES[status] for status in robot_tree.statuses]
        self._payloads = {
            b"T": self._xml,
            b"S": b"".join(STATUS.pack(uid, code) for uid, code in enumerate(codes, 1)),
            b"B": msgpack.packb({MAIN: robot_tree.board}),
            b"D": b"[]",  # breakpoints: there are none
        }

    def reply(self, request: list[bytes]) -> list[bytes]:
        """The frames of the reply to those of a request."""
        if len(request[0]) != HEADER.size:
            return [b"error", b"wrong request header"]
        _, kind, number = HEADER.unpack(request[0])
        if kind not in self._payloads:
            return [b"error", b"islandgp has no breakpoints and no recordings"]
        return [HEADER.pack(PROTOCOL, kind, number) + self._id, self._payloads[kind]]


def xml_of(robot_tree: RobotTree) -> bytes:
    """The XML of a tree; each node is numbered in document order, from 1."""
    root = ET.Element("root", BTCPP_format="4")
    tree = ET.SubElement(root, "BehaviorTree", ID=MAIN, _fullpath="")
    models: dict[str, str] = {}  # the sort of each tag
    numbers = count(1)

    def add(parent: ET.Element, node: Node) -> None:
        tag = node.action or node.kind
        decorates = kind_of(node).decorates
        models[tag] = "Decorator" if decorates else "Control" if node.children else "Action"
        element = ET.SubElement(parent, tag, name=head(node), _uid=str(next(numbers)))
        for child in node.children:
            add(element, child)

    add(tree, robot_tree.tree.node)
    model = ET.SubElement(root, "TreeNodesModel")
    for tag, sort in sorted(models.items()):
        ET.SubElement(model, sort, ID=tag)
    return ET.tostring(root)


@contextmanager
def groot_served(groot: Groot, port: int) -> Iterator[None]:
    """Context manager: answers Groot2 on a port of the loopback interface.

    Raises:
        ConfigError: the port is in use.
    """
    import zmq

    context: Any = zmq.Context()
    socket = context.socket(zmq.REP)
    socket.linger, socket.rcvtimeo = 0, 100  # ms
    try:
        socket.bind(f"tcp://127.0.0.1:{port}")
    except zmq.ZMQError as error:
        context.destroy()
        reason = str(error.strerror).partition(" (")[0]
        raise ConfigError(
            f"Expected a free port as --groot, found {port} ({reason}); name another one"
        ) from None
    ended = Event()

    def serve() -> None:
        while not ended.is_set():
            try:
                socket.send_multipart(groot.reply(socket.recv_multipart()))
            except zmq.Again:
                continue

    thread = Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        context.destroy()
