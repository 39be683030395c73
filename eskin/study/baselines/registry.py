"""Every baseline by its name, and which of them run when none is named."""

from collections.abc import Sequence

from eskin.golden.core import InputError
from eskin.study.baselines.method import Method
from eskin.study.baselines.recurrent import OURS, THESIS, NetworkMethod
from eskin.study.baselines.simple import SIMPLE
from eskin.study.baselines.tensor import TENSOR
from eskin.study.baselines.tiles import TILED
from eskin.study.baselines.transfer import TRANSFER

_FAMILIES: tuple[Sequence[Method | NetworkMethod], ...] = (OURS, THESIS, SIMPLE, TENSOR, TILED, TRANSFER)
METHODS = {method.name: method for family in _FAMILIES for method in family}
"""Every method by its name, families one after the other."""
FAMILIES = tuple(dict.fromkeys(method.family for method in METHODS.values()))
ONLY_FULL = frozenset(method.name for method in THESIS if method.steps != 20)
"""Methods that only ``--full`` runs when none is named."""


def choose_methods(names: Sequence[str] | None, full: bool) -> list[str]:
    """Names of the methods asked for, by method or family; None: every one that is not only for ``full``.

    Raises
    ------
    InputError
        An unknown name, or none.
    """
    if names is None:
        return [name for name in METHODS if full or name not in ONLY_FULL]
    chosen: list[str] = []
    for name in names:
        members = (
            [name]
            if name in METHODS
            else [member for member, method in METHODS.items() if method.family == name]
        )
        if not members:
            raise InputError(
                f"--methods {name}: is no method; use {', '.join(METHODS)}, or a family: "
                f"{', '.join(FAMILIES)}"
            )
        chosen += [
            member
            for member in members
            if member not in chosen and (name in METHODS or full or member not in ONLY_FULL)
        ]
    if not chosen:
        raise InputError(
            f"--methods: names none; use {', '.join(METHODS)}, or a family: {', '.join(FAMILIES)}"
        )
    return chosen
