"""eskin: from recorded tactile streams to a small network in bit-exact hardware.

In Python::

    import eskin

    model = eskin.Model.load("model")               # a folder that `eskin train` and `eskin quantise` wrote
    # frames: (frames, taxels) codes, a list of such, or Recordings
    classes = model.predict(frames)

The names of this module are public (docs/python.md). Each is loaded on first use, so ``import eskin`` is
quick and does not need torch. ``eskin.golden`` (models), ``eskin.rtl`` (hardware) and ``eskin.cosim``
(benches) stand at the top of a checkout, where `Beside` finds them. Links in this folder lead editors and mypy
there; nothing else needs them.
"""

import os
import pkgutil
import sys
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eskin.api import Model
    from eskin.data import load_recordings as load
    from eskin.golden.core import AcceleratorConfig as Config
    from eskin.golden.core import InputError
    from eskin.golden.data import Recordings
    from eskin.golden.model import Stream, Trace
    from eskin.golden.model.stream import Decision

PARTS = ("eskin.golden", "eskin.rtl", "eskin.cosim")
"""Parts of the package that a checkout has beside this folder, and an installation in it."""


class Beside:
    """Finds the `PARTS` of a checkout."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """A part, by the name under which it is imported."""
        return PathFinder.find_spec(name, [os.path.dirname(__path__[0])]) if name in PARTS else None


_inside = f"{__path__[0]}/golden"
if os.path.islink(_inside) or not os.path.isdir(_inside):
    sys.meta_path.insert(0, Beside)  # before the links: a module has one file, which git knows

__version__ = version("eskin")

__all__ = [
    "Config",
    "Decision",
    "InputError",
    "Model",
    "Recordings",
    "Stream",
    "Trace",
    "__version__",
    "load",
]

_PLACES = {
    "Config": "golden.core.config:AcceleratorConfig",
    "Decision": "golden.model.stream:Decision",
    "InputError": "golden.core.errors:InputError",
    "Model": "api:Model",
    "Recordings": "golden.data.recordings:Recordings",
    "Stream": "golden.model.stream:Stream",
    "Trace": "golden.model.pipeline:Trace",
    "load": "data.load:load_recordings",
}
"""Module and name of each public name."""


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'eskin' has no attribute '{name}'")
    globals()[name] = value = pkgutil.resolve_name(f"eskin.{_PLACES[name]}")
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
