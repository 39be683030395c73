"""eskin: from recorded tactile streams to a small network in bit-exact hardware.

In Python::

    import eskin

    model = eskin.Model.load("model")               # a folder that `eskin train` and `eskin quantise` wrote
    # frames: (frames, taxels) codes, a list of such, or Recordings
    classes = model.predict(frames)

The names of this module are public (docs/python.md). Each is loaded on first use, so ``import eskin`` is
quick and does not need torch. ``eskin.golden`` (models), ``eskin.rtl`` (hardware) and ``eskin.cosim``
(benches) stand at the top of the checkout; links in this folder make them parts of the package.
"""

import pkgutil
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
