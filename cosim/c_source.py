"""Declarations of a C++ program, its functions and structures, for ctypes."""

import ctypes
import re
from pathlib import Path
from typing import Any

TYPES: dict[str, Any] = {
    "void": None,
    "int": ctypes.c_int,
    "i32": ctypes.c_int32,
    "int32_t": ctypes.c_int32,
    "uint32_t": ctypes.c_uint32,
    "i64": ctypes.c_int64,
    "long": ctypes.c_longlong,  # long long
    "u64": ctypes.c_uint64,
    "double": ctypes.c_double,
}
FUNCTION = re.compile(r"^([\w *]+[ *])(\w+)\(([^)]*)\) \{", re.MULTILINE)
FIELDS = re.compile(r"^ +(?:const )?(\w+) ([\w*, ]+);", re.MULTILINE)


def _type(declared: str) -> Any:
    """The ctypes type of ``int32_t``, ``const i32 *nets``, ``Device* d``: any pointer is an address, text
    is bytes."""
    if "*" in declared:
        return ctypes.c_char_p if "char" in declared else ctypes.c_void_p
    return TYPES[declared.split()[0]]


def library(path: Path, *sources: Path, defined: str = "") -> ctypes.CDLL:
    """The library with the types of the functions that ``sources`` have behind ``extern "C"``.

    Parameters
    ----------
    defined:
        The one macro that the program was compiled with; empty: none. It selects the text before or after an
        ``#else``.
    """
    loaded = ctypes.CDLL(str(path))
    for source in sources:
        text = source.read_text().partition('extern "C"')[2]
        either = r"\1" if defined else r"\2"
        text = re.sub(r"#ifdef \w+\n(.*?)#else\n(.*?)#endif", either, text, flags=re.DOTALL)
        for result, name, arguments in FUNCTION.findall(text):
            function = getattr(loaded, name)
            function.restype = _type(result)
            function.argtypes = [_type(argument) for argument in arguments.split(",") if argument]
    return loaded


def structure(source: Path, name: str) -> type[ctypes.Structure]:
    """The structure ``name`` of plain numbers and addresses."""
    body = source.read_text().partition(f"struct {name} {{")[2].partition("\n}")[0]
    fields = [
        (field.strip(" *"), _type(f"{kind} {field}"))
        for kind, names in FIELDS.findall(body)
        for field in names.split(",")
    ]
    return type(name, (ctypes.Structure,), {"_fields_": fields})
