"""Recordings written as other people's tools write them, each with the format's own library."""

import json
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
from mcap.writer import Writer as McapWriter
from pyarrow import parquet
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from eskin.data import Reading
from eskin.golden.data import Recordings

STORE, STORE1 = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
"""Types of messages of ROS 2 and 1."""
for store in (STORE, STORE1):
    store.register(
        get_types_from_msg(
            "std_msgs/Header header\nsensor_msgs/ChannelFloat32[] sensors\n", "tactile_msgs/msg/TactileState"
        )
    )
PAUSE_S = 1.0
"""Between two recordings of a log."""


def lvm(segments: list[np.ndarray], clocks: str = "One", step: str | None = None, comma: bool = False,
        runs_on: bool = False, hz: int = 100) -> str:  # fmt: skip
    """A file of LabVIEW with a head a segment, of ``hz``. clocks: its ``X_Columns``; step: ``Delta_X``.
    runs_on: the clock of a segment goes on from the segment before."""
    count, begin, step = segments[0].shape[1], 0, f"{1 / hz:g}" if step is None else step
    lines = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", f"Decimal_Separator\t{',' if comma else '.'}",
             f"Multi_Headings\t{'Yes' if len(segments) > 1 else 'No'}", f"X_Columns\t{clocks}", "***End_of_Header***\t", ""]  # fmt: skip
    for segment in segments:
        each = lambda text: "\t".join([text] * count)
        lines += [f"Channels\t{count}", f"Samples\t{each(str(len(segment)))}", f"Y_Unit_Label\t{each('Volts')}",
                  f"X0\t{each(f'{begin / hz:.4f}')}", *([f"Delta_X\t{each(step)}"] if step else []),
                  f"***End_of_Header***\t{each('')}"]  # fmt: skip
        names = each("X_Value\tVoltage") if clocks == "Multi" else f"X_Value\t{each('Voltage')}"
        lines.append(f"{names}\tComment")
        for k, row in enumerate(segment.tolist(), begin):
            time = "" if clocks == "No" else f"{k / hz:.4f}"
            cells = [
                cell
                for value in row
                for cell in ([time, f"{value:.4f}"] if clocks == "Multi" else [f"{value:.4f}"])
            ]
            lines.append("\t".join(cells if clocks == "Multi" else [time, *cells]))
        lines.append("")
        begin += len(segment) if runs_on else 0
    text = "\r\n".join(lines)
    return re.sub(r"(?<=\d)\.(?=\d)", ",", text) if comma else text


def write_trials(signals: list[np.ndarray], labels: list[str], path: Path, inside: str = "trial{n}",
                 clock: bool = True, rate: float | None = None, **more: Any) -> Path:  # fmt: skip
    """HDF5 with a group a recording, at ``inside``, of a table and a clock at 100 Hz. rate: of the file. more: what else stands in
    the group, as a dataset, or as an attribute where its name begins with on__; functions get the number."""
    with h5py.File(path, "w") as file:
        for n, (signal, label) in enumerate(zip(signals, labels, strict=True)):
            trial = file.create_group(inside.format(n=n, label=label))
            file.attrs.update({} if rate is None else {"fs": rate})
            trial["skin"] = signal
            if clock:
                trial["time"] = np.arange(len(signal)) / 100
            for name, value in more.items():
                holder = trial.attrs if name.startswith("on__") else trial
                holder[name.removeprefix("on__")] = value(n) if callable(value) else value
    return path


def write_touches(signals: list[np.ndarray], labels: list[str], path: Path, off: float = 0.0, zero: int = 0,
                  stamp: tuple[str, str] = ("sec", "nanosec"), stamped_labels: bool = False) -> Path:  # fmt: skip
    """MCAP of JSON at 100 Hz without pauses, labels by the topic /touched. off: of the header's clock, s; of the
    first ``zero`` messages its stamp is 0."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("TactileState", "jsonschema", b"{}")
        skin, touched = (writer.register_channel(name, "json", schema) for name in ("/skin", "/touched"))
        frame = 0
        for signal, label in zip(signals, labels, strict=True):
            for k, row in enumerate(signal.tolist()):
                at = 10**18 + frame * 10**7
                when = 0 if frame < zero else at + int(off * 1e9)
                header = {"header": {"stamp": dict(zip(stamp, divmod(when, 10**9), strict=True))}}
                if k == 0:
                    message = {"data": label} | (header if stamped_labels else {})
                    writer.add_message(touched, at, json.dumps(message).encode(), at)
                writer.add_message(skin, at, json.dumps(header | {"sensors": [{"values": row}]}).encode(), at)
                frame += 1
        writer.finish()
    return path


def drawn_form(
    signals: list[np.ndarray], labels: list[str], folder: Path, rng: random.Random
) -> tuple[Path, Reading]:
    """Recordings (frames, taxels) at 100 Hz in a form that a recorder may write, .lvm, nested HDF5, a log with
    two clocks or LeRobot's folder, and what a user says of it."""
    form = rng.choice(("lvm", "hdf5", "log", "lerobot"))
    if form == "lerobot":
        given = {"files": rng.choice((1, 3)), "fixed": rng.random() < 0.5}
        reading = Reading(samples="observation.touch", label=rng.choice((None, "task")))
        return write_lerobot(signals, labels, folder / "set", **given), reading
    if form == "lvm":
        of_file = dict(
            clocks=rng.choice(("One", "No", "Multi")), comma=rng.random() < 0.5, runs_on=rng.random() < 0.5
        )
        for n, (signal, label) in enumerate(zip(signals, labels, strict=True)):
            path = folder / "lvm" / label / f"r{n}.lvm"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(lvm(np.array_split(signal, rng.choice((1, 1, 2, 3))), **of_file))
        last = signals[0].shape[1] + 1
        columns = (f"2-{last}",) if rng.random() < 0.5 and of_file["clocks"] != "Multi" else ()
        return folder / "lvm", Reading(columns=columns, scale=rng.choice((None, 1e-3)))
    if form == "hdf5":
        inside = rng.choice(("{label}/trial{n}", "trial{n}", "{label}/day{n}/a"))
        topics = {rng.choice(("label", "on__label")): lambda n: labels[n]} if rng.random() < 0.5 else {}
        topics |= {"imu": lambda n: np.zeros((len(signals[n]), 6))} if rng.random() < 0.3 else {}
        rate, clock = rng.choice((None, 100.0)), rng.random() < 0.5
        topics |= {} if clock or rate else {"on__fs": 100.0}
        path = write_trials(signals, labels, folder / "a.h5", inside, clock, rate, **topics)
        return path, Reading(samples=rng.choice((None, "skin")))
    off, zero, stamped = rng.choice((0.0, -0.4, 0.03, 5.0)), rng.choice((0, 0, 3)), rng.random() < 0.5
    path = write_touches(signals, labels, folder / "a.mcap", off, zero, rng.choice((("sec", "nanosec"), ("secs", "nsecs"))),
                         stamped)  # fmt: skip
    return path, Reading(label="/touched", samples="/skin", clock=rng.choice(("log", "header")))


def write_lerobot(
    signals: list[np.ndarray],
    labels: list[str],
    folder: Path,
    *,
    files: int = 1,
    fixed: bool = False,
    **info: Any,
) -> Path:
    """Recordings (frames, taxels) or (frames, rows, columns) at 100 Hz as lerobot 0.4 writes them, version 3: lists
    in Parquet, texts of tasks in an index. fixed: lists of a stated size. info: changes of info.json."""
    tasks = sorted({*labels})
    rows = [
        pd.DataFrame(
            {
                "observation.touch": [row.tolist() for row in signal.astype(np.float32)],
                "action": [[0.0, 0.0]] * len(signal),
                "timestamp": np.arange(len(signal), dtype=np.float32) / 100,
                "frame_index": np.arange(len(signal)),
                "episode_index": episode,
                "task_index": tasks.index(label),
            }
        )
        for episode, (signal, label) in enumerate(zip(signals, labels, strict=True))
    ]
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    for number, part in enumerate(np.array_split(np.arange(len(rows)), files)):
        table = pa.Table.from_pandas(
            pd.concat([rows[n] for n in part], ignore_index=True), preserve_index=False
        )
        if fixed:
            touch = table["observation.touch"].cast(pa.list_(pa.float32(), signals[0].shape[1]))
            table = table.set_column(0, "observation.touch", touch)
        parquet.write_table(table, folder / f"data/chunk-000/file-{number:03d}.parquet")
    pd.DataFrame({"task_index": range(len(tasks))}, index=tasks).to_parquet(folder / "meta/tasks.parquet")
    touch = {"dtype": "float32", "shape": signals[0].shape[1:], "names": None}
    features = {"observation.touch": touch, "action": {"dtype": "float32", "shape": [2], "names": ["x", "y"]}}
    features |= {
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "view": {"dtype": "video", "shape": [9, 9, 3]},
    }
    made = {
        "codebase_version": "v3.0",
        "total_frames": sum(map(len, signals)),
        "fps": 100,
        "features": features,
    }
    (folder / "meta/info.json").write_text(json.dumps(made | info))
    return folder


def write_hdf5(recordings: Recordings, path: Path) -> None:
    """The arrays of an archive as datasets, rate and unit as attributes."""
    with h5py.File(path, "w") as file:
        file["samples"], file["offsets"], file["labels"] = (
            recordings.samples.astype(np.uint16),
            recordings.offsets,
            recordings.labels,
        )
        file["class_names"] = list(recordings.class_names)
        for name, values in recordings.groups.items():
            file[name] = values
        file.attrs["sample_rate_hz"] = recordings.sample_rate_hz
        file["samples"].attrs["units"] = "mV"


def write_hdf5_by_dataset(recordings: Recordings, path: Path) -> None:
    """A dataset a recording in a group a class, groups and unit as attributes."""
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = recordings.sample_rate_hz
        for index, label in enumerate(recordings.labels.tolist()):
            table = file.create_dataset(
                f"{recordings.class_names[label]}/r{index}", data=recordings.recording(index)
            )
            table.attrs["unit"] = "mV"
            for name, values in recordings.groups.items():
                table.attrs[name] = values[index]


def long_table(recordings: Recordings) -> pd.DataFrame:
    """A row a frame."""
    index = np.repeat(np.arange(len(recordings)), recordings.lengths)
    columns: dict[str, Any] = {
        "recording": index,
        "class": np.array(recordings.class_names)[recordings.labels[index]],
    }
    columns |= {name: values[index] for name, values in recordings.groups.items()}
    columns["time"] = np.concatenate([np.arange(n) for n in recordings.lengths]) / recordings.sample_rate_hz
    frame = pd.DataFrame(
        columns | {f"t{taxel}": recordings.samples[:, taxel] for taxel in range(recordings.taxels)}
    )
    frame.attrs["units"] = "mV"
    return frame


def frames_in_time(recordings: Recordings) -> Iterator[tuple[int, int, np.ndarray]]:
    """Number of the recording, time (ns) and codes of every frame, a pause between recordings."""
    begin = 10**18
    for index in range(len(recordings)):
        for k, codes in enumerate(recordings.recording(index)):
            yield index, begin + round(1e9 * k / recordings.sample_rate_hz), codes
        begin += round(1e9 * (len(recordings.recording(index)) / recordings.sample_rate_hz + PAUSE_S))


def times_table(recordings: Recordings) -> str:
    """Start, end and class of every recording, seconds from the first frame."""
    rows, begin = ["start,end,class,person"], 0.0
    for index, n in enumerate(recordings.lengths / recordings.sample_rate_hz):
        name, person = recordings.class_names[recordings.labels[index]], recordings.groups["person"][index]
        rows.append(f"{begin - 0.001:.4f},{begin + n:.4f},{name},{person}")
        begin += n + PAUSE_S
    return "\n".join(rows) + "\n"


def message(kind: str, codes: np.ndarray, when: int, store: Typestore) -> Any:
    """A ROS message of a frame."""
    types = store.types
    if kind.endswith("MultiArray"):
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        return types[kind](layout=layout, data=codes.astype(kind.split("/")[-1][:-10].lower()))
    stamp = types["builtin_interfaces/msg/Time"](sec=when // 10**9, nanosec=when % 10**9)
    half = len(codes) // 2
    sensors = [types["sensor_msgs/msg/ChannelFloat32"](name=name, values=part.astype(np.float32))
               for name, part in (("tip", codes[:half]), ("pad", codes[half:]))]  # fmt: skip
    counted = {"seq": 0} if store is STORE1 else {}
    return types[kind](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="skin", **counted), sensors=sensors
    )


def write_bag(recordings: Recordings, path: Path, kind: str = "std_msgs/msg/UInt16MultiArray",
              plugin: StoragePlugin | None = StoragePlugin.MCAP, packed: tuple = ()) -> None:  # fmt: skip
    """A ROS 2 bag, or a ROS 1 bag without ``plugin``, with the topics /skin and /touched: the class, and an empty
    text after each recording. packed: how."""
    store, word_kind = STORE if plugin else STORE1, "std_msgs/msg/String"
    serialize = store.serialize_cdr if plugin else store.serialize_ros1
    writer = Writer(path, version=9, storage_plugin=plugin) if plugin else Writer1(path)
    if packed:
        writer.set_compression(*packed)
    with writer as bag:
        skin = bag.add_connection("/skin", kind, typestore=store)
        touched = bag.add_connection("/touched", word_kind, typestore=store)
        before, last = -1, 0

        def say(word: str, when: int) -> None:
            bag.write(touched, when, serialize(store.types[word_kind](data=word), word_kind))

        for index, when, codes in frames_in_time(recordings):
            if index != before:
                if before >= 0:
                    say("", last + 1000)
                say(recordings.class_names[recordings.labels[index]], when - 1000)
            bag.write(skin, when, serialize(message(kind, codes, when, store), kind))
            before, last = index, when


def write_json_mcap(recordings: Recordings, path: Path) -> None:
    """An MCAP file of JSON messages, of the first recording."""
    with path.open("wb") as file:
        log = McapWriter(file)
        log.start()
        schema = log.register_schema("MultiArray", "jsonschema", b"{}")
        channel = log.register_channel("/skin", "json", schema)
        for _, when, codes in frames_in_time(recordings.subset([0])):
            log.add_message(channel, when, json.dumps({"data": codes.tolist()}).encode(), when)
        log.finish()
