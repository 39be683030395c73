"""The installed command, called in this process."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from eskin.cli import main as command_line


@pytest.fixture
def call(monkeypatch, capsys) -> Callable[..., tuple[int, str, str]]:
    """``call("inspect", "data.npz")`` -> (status, standard output, standard error), as the installed command
    would end."""
    monkeypatch.setenv("COLUMNS", "200")

    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eskin", *map(str, words)])
        status = 0
        try:
            command_line.main()
        except SystemExit as end:
            status = int(end.code or 0)
        return status, *capsys.readouterr()

    return run
