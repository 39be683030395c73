"""A table of cheap cases as one test, where collecting and naming every row apart tells no more than the row
itself; and what every refusal must be."""

import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any

import pytest

from eskin.golden.core import InputError


@contextmanager
def refused(*words: str) -> Iterator[pytest.ExceptionInfo]:
    """A bad input is refused, in one line in which each of the patterns is found."""
    with pytest.raises(InputError) as caught:
        yield caught
    sentence = str(caught.value)
    assert "\n" not in sentence and all(re.search(each, sentence) for each in words), sentence


def each_row(names: str | tuple[str, ...], table: Iterable[Any]) -> Callable[[Callable], Callable]:
    """As ``pytest.mark.parametrize``, but one test over all rows; a failure's note names the row.

    Each row has a separate ``tmp_path`` and ``monkeypatch``; other fixtures are shared.
    """
    columns = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    cells = [dict(zip(columns, row if len(columns) > 1 else [row], strict=True)) for row in table]

    def decorate(test: Callable) -> Callable:
        @wraps(test)
        def play(**fixtures: Any) -> None:
            for number, row in enumerate(cells):
                own = dict(fixtures)
                with ExitStack() as stack:
                    if "monkeypatch" in own:
                        own["monkeypatch"] = stack.enter_context(own["monkeypatch"].context())
                    if "tmp_path" in own:
                        own["tmp_path"] /= str(number)
                        own["tmp_path"].mkdir()
                    try:
                        test(**own, **row)
                    except pytest.skip.Exception:
                        raise
                    except BaseException as error:
                        error.add_note(f"row {number}: {row}")
                        raise

        parameters = inspect.signature(test).parameters
        play.__signature__ = inspect.Signature(
            [parameter for name, parameter in parameters.items() if name not in columns]
        )  # type: ignore[attr-defined]
        return play

    return decorate
