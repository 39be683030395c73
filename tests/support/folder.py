"""What a folder holds."""

from pathlib import Path

from eskin.golden.core import files


def contents(folder: Path) -> dict[str, bytes]:
    """Everything below ``folder`` and its content; nothing in a folder."""
    paths = sorted(folder.rglob("*"))
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in paths}


def exchanges(monkeypatch) -> list[str]:
    """Names of the folders that are written from now on, in order."""
    real, names = files.exchange, []

    def noted(draft: Path, folder: Path, *others) -> None:
        names.append(folder.name)
        real(draft, folder, *others)

    monkeypatch.setattr(files, "exchange", noted)
    return names
