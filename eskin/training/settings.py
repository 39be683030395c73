"""Settings of a training."""

from dataclasses import dataclass
from pathlib import Path


class GroupSettings:
    """A class with group arrays ``A[,B..]``."""

    group: str | None

    @property
    def groups(self) -> list[str] | None:
        """The names in ``group``; None where it is not given."""
        return None if self.group is None else parse_names(self.group)


@dataclass(frozen=True, kw_only=True)
class TrainingSettings(GroupSettings):
    """Settings of a training; None: the default, or the training chooses.

    Attributes
    ----------
    out:
        The model folder.
    group:
        Group arrays ``A[,B..]`` that stay on one side of every split; `groups`: their names.
    cell:
        A cell, a network for images, or ``auto``; with `hidden` units and, of a GRU, its `reset` gate ``before`` or
        ``after`` the recurrent product.
    folds, seeds:
        Of the cross-validation: folds, 0 for none, and networks of each; by default 3, of images, which take minutes each,
        1. `seed` is the first, of the model which is written.
    protocol:
        Recipe: ``default`` or ``robust``.
    prefer, fits:
        Cost to minimise, and the board that must hold the design.
    """

    out: Path
    group: str | None = None
    cell: str | None = None
    hidden: int | None = None
    reset: str | None = None
    folds: int = 5
    seed: int = 0
    seeds: int | None = None
    protocol: str = "default"
    prefer: str = "energy"
    fits: str | None = None


def parse_names(text: str) -> list[str]:
    """The names in ``A,B``."""
    return [name.strip() for name in text.split(",") if name.strip()]
