"""Recordings from logs of robots: MCAP files (ROS 2 or JSON messages) and ROS bags, as tables of one topic.

A frame is a message of the topic: the ``data`` of a ``std_msgs/*MultiArray``, or the ``values`` of all
``sensors`` of a ``tactile_msgs/TactileState``. What a recording is, and its class, say a folder a class with
a log a recording, another topic, or a table of times (docs/other_tools.md).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np

from eskin.data.text import MOST_BYTES, Reading, read_table
from eskin.golden.core import InputError, Record

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".mcap", ".db3", ".bag")
TYPES = ("MultiArray", "TactileState")
"""How the types of messages end that are frames."""
_START, _END, _CLASS = ("start", "begin", "from"), ("end", "stop", "to"), ("class", "label", "class_name")

Refuse = Callable[[str], NoReturn]


class _Log(NamedTuple):
    """Topics with the types of their messages, and what reads one topic: (log time, ns; message)."""

    topics: dict[str, str]
    read: Callable[[str], Iterator[tuple[int, Any]]]


def is_log(path: Path) -> bool:
    """Whether a path is an MCAP file, a bag's file, or the folder of a ROS 2 bag."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() in SUFFIXES


def read_log(path: Path, reading: Reading) -> pd.DataFrame:
    """One row a frame: ``time`` in seconds, then ``t0``, ``t1`` and so on; where ``reading`` names a topic or
    a table of labels also ``recording``, ``class`` and the table's other columns, without the frames of no
    recording.

    Raises
    ------
    InputError
        The log is damaged, has not one topic of frames, or no frame in a recording.
    """
    import pandas as pd

    def refuse(why: str) -> NoReturn:
        raise InputError(f"recordings '{path}': {why}")

    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if not file.is_file():  # opening a pipe without a writer would wait for ever
            refuse(f"{file.name} is no regular file; remove it or write it again")
    if sum(file.stat().st_size for file in files) > MOST_BYTES:
        refuse(f"has more than {MOST_BYTES >> 30} GB; split it")
    try:
        log = (_mcap if path.suffix.lower() == ".mcap" else _bag)(path, refuse)
        topic = _topic(log, reading, refuse)
        times, rows = _frames(log, topic, refuse)
        marks = [] if reading.label is None else _marks(log, reading.label, refuse)
    except (InputError, ModuleNotFoundError):
        raise
    except Exception as error:  # a damaged log can fail anywhere inside the libraries
        if isinstance(error, OSError) and error.errno:
            raise
        refuse(f"is damaged or no log ({type(error).__name__}); record it again, or try its own tools")
    frame = pd.DataFrame(rows, columns=[f"t{column}" for column in range(rows.shape[1])])
    frame.insert(0, "time", (times - times[0]) / 1e9)
    if reading.labels is not None:
        return _between(frame, times, _intervals(reading.labels), refuse)
    if reading.label is not None:
        begins = np.array([when for when, _ in marks])
        number = np.searchsorted(begins, times, side="right") - 1
        frame.insert(0, "class", [marks[mark][1] if mark >= 0 else "" for mark in number])
        frame.insert(0, "recording", number)
        frame = frame[frame["class"] != ""].reset_index(drop=True)
        if not len(frame):
            refuse(f"no frame follows a label of topic {reading.label}")
    return frame


def _topic(log: _Log, reading: Reading, refuse: Refuse) -> str:
    """The topic of frames: the one asked for, or the only one that can be."""
    listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(log.topics.items())[:12]) or "none"
    if reading.label is not None and reading.label not in log.topics:
        refuse(f"--class {reading.label}: is no topic; there are {listed}")
    if reading.samples is not None:
        if reading.samples not in log.topics:
            refuse(f"--samples {reading.samples}: is no topic; there are {listed}")
        return reading.samples
    fit = [name for name, kind in log.topics.items() if kind.endswith(TYPES) and name != reading.label]
    if len(fit) != 1:
        refuse(f"has {len(fit)} topics of frames; name one with --samples: {listed}")
    return fit[0]


def _frames(log: _Log, topic: str, refuse: Refuse) -> tuple[np.ndarray, np.ndarray]:
    """Times (ns: the header's, or when it was logged) and values of every message."""
    times: list[int] = []
    rows: list[np.ndarray] = []
    for when, message in log.read(topic):
        parts = (
            [sensor.values for sensor in message.sensors] if hasattr(message, "sensors") else [message.data]
        )
        row = np.concatenate([np.asarray(part) for part in parts])
        if row.ndim != 1 or row.dtype.kind not in "iuf" or not row.size:
            refuse(
                f"topic {topic}: message {len(rows)} holds no list of numbers; name another with --samples"
            )
        if rows and len(row) != len(rows[0]):
            refuse(
                f"topic {topic}: message {len(rows)} has {len(row)} values and the first {len(rows[0])}; a "
                "frame has one value a taxel"
            )
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        nanoseconds = 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)
        times.append(nanoseconds or when)
        rows.append(row)
    if not rows:
        refuse(f"topic {topic}: has no message")
    return np.array(times, dtype=np.int64), np.array(rows)


def _marks(log: _Log, topic: str, refuse: Refuse) -> list[tuple[int, str]]:
    """When a label begins (ns), and it; an empty one ends the recording before."""
    marks = [(when, str(message.data).strip()) for when, message in log.read(topic)]
    if not marks:
        refuse(f"--class {topic}: has no message, so no label")
    return sorted(marks)


# ---------------------------------------------------------------------- a table of times
def _intervals(path: Path) -> pd.DataFrame:
    """The rows of a table of times: start, end and class, then its other columns."""
    table = read_table(path, Reading())
    names = [name.lower() for name in table.names]
    frame = table.frame.set_axis(names or range(table.frame.shape[1]), axis=1)
    for what, words in (("start", _START), ("end", _END), ("class", _CLASS)):
        name = next((word for word in words if word in names), None)
        if name is None:
            table.refuse(
                f"has no column {what} ({', '.join(words)}); give start, end and class, a row a recording", 0
            )
        frame = frame.rename(columns={name: what})
    bounds = table.numbers([[*frame.columns].index("start"), [*frame.columns].index("end")])
    wrong = np.flatnonzero(bounds[:, 1] <= bounds[:, 0])
    if len(wrong):
        table.refuse("ends before it starts; correct the line", int(wrong[0]))
    return frame.assign(start=bounds[:, 0], end=bounds[:, 1])


def _between(frame: pd.DataFrame, times: np.ndarray, intervals: pd.DataFrame, refuse: Refuse) -> pd.DataFrame:
    """The frames of each interval, with its columns. Seconds count from the first frame, or as the log's
    clock where they begin after its first frame."""
    import pandas as pd

    seconds = times / 1e9 if intervals["start"].min() > frame["time"].iloc[-1] else frame["time"].to_numpy()
    parts = []
    for number, row in enumerate(intervals.itertuples(index=False)):
        part = frame[(seconds >= row.start) & (seconds < row.end)].copy()
        if not len(part):
            refuse(
                f"no frame lies between {row.start:g} and {row.end:g} s; give seconds from its first frame, or of its clock"
            )
        more = intervals.drop(columns=["start", "end"]).iloc[number]
        for name in reversed(more.index):
            part.insert(0, name, more[name])
        part.insert(0, "recording", number)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


# ---------------------------------------------------------------------- the libraries
def _mcap(path: Path, refuse: Refuse) -> _Log:
    """An MCAP file, whoever wrote it: ROS 2 messages and JSON."""
    from mcap.reader import SeekingReader

    def messages(topic: str | None = None) -> Iterator[Any]:
        with path.open("rb") as file:
            yield from SeekingReader(
                file, validate_crcs=True, record_size_limit=MOST_BYTES // 8
            ).iter_messages(topic and [topic])

    def read(topic: str) -> Iterator[tuple[int, Any]]:
        store: Any = None
        for schema, channel, message in messages(topic):
            if channel.message_encoding == "json":
                yield message.log_time, json.loads(message.data, object_hook=_object)
                continue
            if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
                refuse(
                    f"topic {topic}: is encoded as {channel.message_encoding or 'nothing'}; ROS 2 (cdr) and json are read"
                )
            if store is None:
                from rosbags.typesys import Stores, get_types_from_msg, get_typestore

                store = get_typestore(Stores.EMPTY)
                store.register(get_types_from_msg(schema.data.decode(), schema.name))
            yield message.log_time, store.deserialize_cdr(message.data, schema.name)

    return _Log({channel.topic: schema.name if schema else "" for schema, channel, _ in messages()}, read)


def _object(values: Record) -> SimpleNamespace:
    return SimpleNamespace(**values)


def _bag(path: Path, refuse: Refuse) -> _Log:
    """A ROS bag: a folder or file of ROS 2, a .bag of ROS 1."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.is_dir() and path.suffix == ".bag":  # rosbags goes by the name
        refuse("is the folder of a ROS 2 bag under a name of ROS 1; rename it without .bag")

    def opened() -> AnyReader:
        return AnyReader([path], default_typestore=get_typestore(Stores.LATEST))

    def read(topic: str) -> Iterator[tuple[int, Any]]:
        with opened() as reader:
            of_topic = [connection for connection in reader.connections if connection.topic == topic]
            for connection, when, raw in reader.messages(of_topic):
                yield when, reader.deserialize(raw, connection.msgtype)

    with opened() as reader:
        return _Log({connection.topic: connection.msgtype for connection in reader.connections}, read)
