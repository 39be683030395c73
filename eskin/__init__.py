"""eskin: from recorded tactile streams to a small network in bit-exact hardware.

The parts lie side by side in the checkout and are ``eskin.golden`` (models), ``eskin.rtl`` (hardware), ``eskin.cosim`` (benches)
and ``eskin.scripts`` (the command line) once installed.
"""

from importlib.metadata import version

__version__ = version("eskin")
