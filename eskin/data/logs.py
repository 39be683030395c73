"""Logs of robots as tables of one topic: MCAP files (ROS 2 or JSON messages) and ROS bags.

A frame is a message of the topic: the ``data`` of a ``std_msgs/*MultiArray``, or the ``values`` of all
``sensors`` of a ``tactile_msgs/TactileState``. Recordings and classes come from a folder per class with a log
per recording, from another topic, or from a table of times (docs/other_tools.md). Frames and labels go by one
clock: the log's, unless ``Reading.clock`` is header.
"""

import json
import re
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from eskin.data.table import (
    MOST_BYTES,
    DataFrame,
    Reading,
    Refuse,
    Table,
    check_regular,
    check_unpacked,
    table_of,
)
from eskin.data.text import read_text

SUFFIXES = (".mcap", ".db3", ".bag")
TYPES = ("MultiArray", "TactileState")
"""Endings of the message types that are frames."""
CLOCK_OFF_S = 1.0
"""A header's clock that is further off the log's is told."""


class _Log(NamedTuple):
    """Topics with the types of their messages, and what reads one topic: (log time, ns; message)."""

    topics: dict[str, str]
    read: Callable[[str], Iterator[tuple[int, Any]]]


def is_log(path: Path) -> bool:
    """True if a path is an MCAP file, a bag's file, or the folder of a ROS 2 bag."""
    return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix.lower() in SUFFIXES


def read_log(path: Path, reading: Reading, refuse: Refuse) -> Table:
    """One row a frame: ``time`` in seconds, then ``t0``, ``t1`` and so on; where ``reading`` names a topic or
    a table of labels also ``recording``, ``class`` and the table's other columns, without the frames of no
    recording.

    Raises
    ------
    InputError
        The log unpacks to far more than it holds, has not one topic of frames, or no frame in a
        recording; its clock is not there.
    """
    import pandas as pd

    _check_unpacked(path, refuse)
    log = (_mcap if path.suffix.lower() == ".mcap" else _bag)(path, refuse)
    topic = _topic(log, reading, refuse)
    times, stamps, messages = _read(log, topic, f"topic {topic}", reading, refuse)
    rows = _frames(messages, topic, refuse)
    frame = pd.DataFrame(rows, columns=[f"t{column}" for column in range(rows.shape[1])])
    frame.insert(0, "time", (times - times[0]) / 1e9)
    if reading.labels is not None or reading.label is not None:
        labels = _intervals(reading.labels, times) if reading.labels else _marks(log, reading, refuse)
        spans = pd.IntervalIndex.from_arrays(labels["start"], labels["end"], closed="left")
        number = spans.get_indexer(times)
        empty = labels[~labels.index.isin(number)]
        if reading.labels is None and (number >= 0).any():
            empty = empty[:0]
        for _, row in empty.iterrows():
            where = f"'{row['class']}' from {(row['start'] - times[0]) / 1e9:g} s on"
            refuse(
                f"no frame lies in the label {where}; give seconds from the first frame or on the log's clock"
            )
        groups = labels.drop(columns=["start", "end"]).rename_axis("recording").reset_index()
        frame = groups.merge(frame.assign(recording=number), on="recording")
    stamped, notes = stamps[stamps[:, 1] != 0], []
    if len(stamped):
        notes.append(f"times of frames and labels are the {reading.clock}'s (--clock log or header)")
        if missing := len(stamps) - len(stamped):
            notes.append(f"{missing} of {len(stamps)} stamps in the headers of topic {topic} are 0")
        off = np.abs(np.diff(stamped)).max() / 1e9
        if off > CLOCK_OFF_S:
            notes.append(f"the headers' clock of topic {topic} is up to {off:.4g} s off the log's")
    return table_of(frame, f"'{path}'", row_is="message", notes=tuple(notes))


def _topic(log: _Log, reading: Reading, refuse: Refuse) -> str:
    """The topic of frames: the wanted topic, or the only possible one."""
    listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(log.topics.items())[:12]) or "none"
    for option, topic in (("--class", reading.label), ("--samples", reading.samples)):
        if topic is not None and topic not in log.topics:
            refuse(f"{option} {topic}: is not a topic of this log; choose one of {listed}")
    if reading.samples is not None:
        return reading.samples
    fit = [name for name, kind in log.topics.items() if kind.endswith(TYPES) and name != reading.label]
    if len(fit) != 1:
        refuse(f"has {len(fit)} topics of frames; name one with --samples: {listed}")
    return fit[0]


def _read(
    log: _Log, topic: str, called: str, reading: Reading, refuse: Refuse
) -> tuple[np.ndarray, np.ndarray, list[Any]]:
    """The times of a topic's messages by the requested clock, ns; (messages, 2) when each was logged, and the stamp in
    its header (0: none), ns; and the messages."""
    read = [(when, _stamp(message), message) for when, message in log.read(topic)]
    if not read:
        refuse(f"{called}: has no message")
    stamps = np.array([each[:2] for each in read], dtype=np.int64)
    times = stamps[:, int(reading.clock == "header")]
    if reading.clock == "header" and (missing := (times == 0).sum()):
        of = f"{missing} of {len(times)} messages of topic {topic} have no stamp in a header"
        refuse(f"--clock header: {of}; leave it out to use the log's clock")
    return times, stamps, [message for *_, message in read]


def _frames(messages: list[Any], topic: str, refuse: Refuse) -> np.ndarray:
    """(messages, taxels) the values of every message."""
    rows: list[np.ndarray] = []
    for number, message in enumerate(messages):
        sensors = getattr(message, "sensors", None)
        parts = (
            [getattr(each, "values", None) for each in sensors]
            if sensors
            else [getattr(message, "data", None)]
        )
        row = np.concatenate([np.atleast_1d(np.asarray(part)) for part in parts])
        if row.ndim != 1 or row.dtype.kind not in "iuf" or not row.size:
            refuse(f"topic {topic}: message {number} holds no list of numbers; name another with --samples")
        if rows and len(row) != len(rows[0]):
            why = f"message {number} has {len(row)} values and the first {len(rows[0])}"
            refuse(f"topic {topic}: {why}; a frame has one value per taxel")
        rows.append(row)
    return np.array(rows)


def _stamp(message: Any) -> int:
    """The header's time, ns, as ROS 2 and ROS 1 call its parts; 0: none."""
    stamp = vars(getattr(getattr(message, "header", None), "stamp", SimpleNamespace()))
    seconds = stamp.get("sec", stamp.get("secs", 0))
    return int(seconds) * 10**9 + int(stamp.get("nanosec", stamp.get("nsecs", stamp.get("nsec", 0))))


def _marks(log: _Log, reading: Reading, refuse: Refuse) -> DataFrame:
    """Start, end (ns) and class of the labels of a topic: each lasts until the next, and an empty one is none."""
    import pandas as pd

    topic = str(reading.label)
    starts, _, messages = _read(log, topic, f"--class {topic}", reading, refuse)
    texts = [str(getattr(message, "data", None)).strip() for message in messages]
    if "None" in texts:
        refuse(
            f"--class {topic}: a message has no data to use as a label; name another topic, or give --labels"
        )
    marks = pd.DataFrame({"start": starts, "class": texts})
    marks = marks.sort_values("start", kind="stable")
    marks["end"] = marks["start"].shift(-1, fill_value=np.iinfo(np.int64).max)
    return marks[(marks["class"] != "") & (marks["end"] > marks["start"])].reset_index(drop=True)


# ---------------------------------------------------------------------- a table of times
def _intervals(path: Path, times: np.ndarray) -> DataFrame:
    """The rows of a table of times in order: start, end (ns) and class, then its other columns. Seconds count
    from the first frame, or as the clock of ``times`` where they begin after its last."""
    table = read_text(path, Reading())
    names = [name.lower() for name in table.names]
    if missing := {"start", "end", "class"} - {*names}:
        table.refuse(f"has no column {min(missing)}; give start, end and class, one row per recording", 0)
    seconds = table.numbers([names.index("start"), names.index("end")])
    for row in np.flatnonzero(seconds[:, 1] <= seconds[:, 0]).tolist():
        table.refuse("ends before it starts; correct the line", row)
    order = np.argsort(seconds[:, 0], kind="stable")
    for before, row in pairwise(order.tolist()):
        if seconds[row, 0] < seconds[before, 1]:
            why = f"begins at {seconds[row, 0]:g} s, before line {table.lines[before]} ends at {seconds[before, 1]:g} s"
            table.refuse(f"{why}: rows overlap; a frame has one label, so correct one of them", row)
    begin = 0 if seconds.min() * 1e9 > times[-1] - times[0] else times[0]
    start, end = (np.rint(np.clip(seconds * 1e9, -4e18, 4e18)).astype(np.int64) + begin).T
    return table.frame.set_axis(names, axis=1).assign(start=start, end=end).iloc[order].reset_index(drop=True)


# ---------------------------------------------------------------------- what a log unpacks to
def _check_unpacked(path: Path, refuse: Refuse) -> None:
    """Raise InputError for an MCAP file whose chunks unpack to far more than its size, even if their headers
    claim less (the library unpacks them whole), and for a compressed bag."""
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        check_regular(file, refuse)
        packing = {".yaml": rb"compression_mode: *['\"]?\w", ".bag": b"compression=(bz2|lz4)"}.get(
            file.suffix.lower()
        )
        if packing and re.search(packing, file.read_bytes(), re.I):
            refuse("is packed; unpack it with ROS's own tools (rosbag decompress, ros2 bag convert)")
        if file.suffix.lower() == ".mcap":
            _check_chunks(file, refuse)


def _check_chunks(path: Path, refuse: Refuse) -> None:
    import lz4.frame
    import zstandard
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    total = 0
    with path.open("rb") as file, suppress(struct.error):  # the library says what cannot be read
        for record in StreamReader(file, emit_chunks=True, record_size_limit=MOST_BYTES // 8).records:
            packed: Any = BytesIO(record.data if isinstance(record, Chunk) else b"")
            if isinstance(record, Chunk) and record.compression == "zstd":
                packed = zstandard.ZstdDecompressor().stream_reader(packed, read_across_frames=True)
            elif isinstance(record, Chunk) and record.compression == "lz4":
                packed = lz4.frame.open(packed)
            while block := packed.read(1 << 20):
                total += len(block)
                check_unpacked(path, total, refuse)


# ---------------------------------------------------------------------- the libraries
def _mcap(path: Path, refuse: Refuse) -> _Log:
    """An MCAP file, whoever wrote it: ROS 2 messages and JSON."""
    from mcap.reader import SeekingReader

    def messages(topic: str | None = None) -> Iterator[Any]:
        with path.open("rb") as file:
            reader = SeekingReader(file, validate_crcs=True, record_size_limit=MOST_BYTES // 8)
            yield from reader.iter_messages(topic and [topic])

    def read(topic: str) -> Iterator[tuple[int, Any]]:
        store: Any = None
        for schema, channel, message in messages(topic):
            if channel.message_encoding == "json":
                yield (
                    message.log_time,
                    json.loads(message.data, object_hook=lambda values: SimpleNamespace(**values)),
                )
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


def _bag(path: Path, refuse: Refuse) -> _Log:
    """A ROS bag: a folder or file of ROS 2, a .bag of ROS 1."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.is_dir() and path.suffix == ".bag":  # rosbags goes by the name
        refuse("is the folder of a ROS 2 bag, but .bag means ROS 1; rename it without .bag")

    def opened() -> AnyReader:
        return AnyReader([path], default_typestore=get_typestore(Stores.LATEST))

    def read(topic: str) -> Iterator[tuple[int, Any]]:
        with opened() as reader:
            of_topic = [connection for connection in reader.connections if connection.topic == topic]
            for connection, when, raw in reader.messages(of_topic):
                yield when, reader.deserialize(raw, connection.msgtype)

    with opened() as reader:
        return _Log({connection.topic: connection.msgtype for connection in reader.connections}, read)
