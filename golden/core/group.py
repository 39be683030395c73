"""A group of a configuration's fields that checks itself.

The annotations hold types, ranges and permitted words; pydantic checks them.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Annotated, Any, ClassVar, Self, get_args, get_type_hints

from annotated_types import Ge, Gt, Interval
from pydantic import AllowInfNan, StrictFloat, StrictInt, TypeAdapter, ValidationError

from eskin.golden.core.errors import InputError
from eskin.golden.core.formats import QFormat

Real = Annotated[StrictFloat, AllowInfNan(False)]
Code = Annotated[StrictInt, Interval(ge=0, le=65535)]

Refusal = tuple[str, str]
"""(field, reason) of a mistake in a configuration."""


@dataclass(frozen=True)
class Only:
    """Mark of a field that some variants of its group have: those whose ``field`` is one of ``words``. In the other
    variants it is ``absent``; None: its default."""

    field: str
    words: tuple[str | bool, ...]
    absent: int | None = None


class Group:
    """Fields that belong together. On construction every field is checked against its annotation and against the
    group's variant (`Only`), then `refusals` checks the fields against each other."""

    prefix: ClassVar[str] = ""
    """Text before a field's name in an error."""

    def __post_init__(self) -> None:
        for field, why in self._misfits() or chain(self._strangers(), self.refusals()):
            raise InputError(f"configuration, field {self.prefix}{field}: {why}")

    def _misfits(self) -> list[Refusal]:
        """The first field whose value its annotation does not allow. Valid fields get the value as parsed by
        pydantic."""
        for name, adapter in _adapters(type(self)).items():  # type: ignore[arg-type]  # a class is hashable whatever its instances are
            value = getattr(self, name)
            try:
                # the dataclass is frozen; pydantic may have read a format's text, or a list as a tuple
                object.__setattr__(self, name, adapter.validate_python(value))
            except ValidationError as error:
                shown = str(value) if isinstance(value, QFormat) else repr(value)
                return [(name, f"is {shown}; {_in_words(error, type(self), name)}")]
        return []

    def _strangers(self) -> Iterator[Refusal]:
        """Fields that have a value and belong to another variant. The fields without a value become absent."""
        for name, mark in _marks(type(self)).items():  # type: ignore[arg-type]
            value, default, word = getattr(self, name), getattr(type(self), name), getattr(self, mark.field)
            absent = default if mark.absent is None else mark.absent
            if word in mark.words:
                continue
            if value not in (default, absent):
                words = " or ".join(map(repr, mark.words))
                why = f"is {value!r}; it belongs to {mark.field} {words}, and {mark.field} is {word!r}: leave it out"
                yield name, why
            object.__setattr__(self, name, absent)

    def refusals(self) -> Iterator[Refusal]:
        """Fields of this group that do not fit each other."""
        yield from ()

    def replace(self, **changes: Any) -> Self:
        """A copy with ``changes``, checked again. If they change the variant, fields that only the old or only the new one
        has get their defaults, unless ``changes`` has them."""
        fields = _of_variant(type(self), vars(self), vars(self))
        return type(self)(**_of_variant(type(self), fields, vars(self) | changes) | changes)

    @classmethod
    def of(cls, values: dict[str, Any]) -> Self:
        """The group with ``values``. Fields of other variants are dropped, because files name every field."""
        return cls(**_of_variant(cls, values, vars(cls) | values))


def _of_variant(group: type[Group], fields: dict[str, Any], variant: dict[str, Any]) -> dict[str, Any]:
    """The fields that the variant with the values ``variant`` has."""
    marks = _marks(group)  # type: ignore[arg-type]
    strange = {name for name, mark in marks.items() if variant[mark.field] not in mark.words}
    return {name: value for name, value in fields.items() if name not in strange}


@lru_cache
def _marks(group: type[Group]) -> dict[str, Only]:
    """Marks of the fields that not every variant has, by the fields' names."""
    hints = get_type_hints(group, include_extras=True)
    return {name: mark for name, hint in hints.items() for mark in get_args(hint) if isinstance(mark, Only)}


@lru_cache
def _adapters(group: type[Group]) -> dict[str, TypeAdapter]:
    hints = get_type_hints(group, include_extras=True)
    return {field.name: TypeAdapter(hints[field.name]) for field in dataclasses.fields(group)}  # type: ignore[arg-type]


_WORDS = {
    "float_type": "give a finite number",
    "finite_number": "give a finite number",
    "bool_type": "give true or false",
    "string_type": "give text",
    "is_instance_of": "give a format, for example SQ(3,5)",
    "tuple_type": "give a list",
}
"""Advice to the user for each kind of mistake, by pydantic's name for it."""


def _in_words(error: ValidationError, group: type[Group], field: str) -> str:
    """Text that tells the user how to correct the first mistake."""
    first = error.errors(include_url=False)[0]
    kind, context = first["type"], first.get("ctx", {})
    # pydantic's own words where they are plain; a location inside the field means that it is a list
    if kind in ("int_type", "int_from_float"):
        return "give whole numbers" if first["loc"] else "give a whole number"
    if kind == "literal_error":
        return f"give one of {context['expected'].replace(chr(39), '').replace(' or ', ', ')}"
    if kind == "value_error":
        return str(context["error"])
    parts = get_args(get_type_hints(group, include_extras=True)[field])
    for bounds in (
        *parts,
        *(inner for part in parts[:1] for inner in get_args(part)),
    ):  # or the bounds of a union's first type
        match bounds:
            case _ if not kind.startswith(("greater_than", "less_than")):
                break
            case Gt():
                return f"it must be above {bounds.gt}"
            case Ge():
                return f"it must be at least {bounds.ge}"
            case Interval():
                return f"it must lie in {bounds.ge}..{bounds.le}"
    plain = first["msg"][0].lower() + first["msg"][1:].replace("input should", "it must")
    return _WORDS.get(kind, plain)
