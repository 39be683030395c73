"""Folders of recordings by class, as people keep them."""

from collections.abc import Callable, Sequence
from pathlib import Path

from eskin.data import Reading, load_recordings
from eskin.golden.data import Recordings


def by_class(
    root: Path,
    write: Callable[[Path, int], object],
    name: str = "r{}.csv",
    *,
    classes: Sequence[str] = "ab",
    count: int = 4,
    between: str = "",
) -> Path:
    """``root`` with ``count`` files, dealt to the classes in turn; ``write`` gets the path and the number of
    each. name of the files, between: folders between class and file; {} is the file's number in its class."""
    for number in range(count):
        own = number // len(classes)
        path = root / classes[number % len(classes)] / between.format(own) / name.format(own)
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, number)
    return root


def texts(root: Path, text_of: Callable[[int], str], reading: Reading | None = None, **options) -> Recordings:
    """Recordings read of the files ``by_class``, of the text that ``text_of`` gives to a number."""
    write = lambda path, number: path.write_text(text_of(number))
    return load_recordings(by_class(root, write, **options), reading=reading or Reading())
