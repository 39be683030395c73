"""Choose a fixed-point format for each signal and write the integer model.

Example: eskin quantise model --weight-bits 6, or eskin quantise model --data recordings.npz --readout
prototypes
"""

from functools import partial
from pathlib import Path

from eskin.cli.common import Options, argument, option, progress_bars, recordings_for, show
from eskin.golden.core import InputError, Record
from eskin.golden.core.groups import Readout
from eskin.golden.model import load_config
from eskin.training.formats import describe_formats
from eskin.training.settings import GroupSettings, parse_names

FORMATS = ("feature_bits", "gate_bits", "table_entries")
"""Values that --formats sets."""


class QuantiseRequest(GroupSettings, Options):
    model: Path = argument("A model folder.")
    data: str | None = option("Measure value ranges on these recordings. Default: ranges from training.")
    weight_bits: int | None = option("Bits of a weight.")
    state_bits: int | None = option("Bits of the hidden state.")
    formats: str | None = option(
        "lean (fewest cells), or feature_bits=B,gate_bits=B,table_entries=N.", metavar="NAME=N,..|lean"
    )
    quantisation_aware: bool = option(
        "Train further in integers of these widths; needs --data.", False, "--quantisation-aware"
    )
    readout: Readout | None = option("Decide by the dense layer or by prototypes (needs --data).")
    group: str | None = option("Prototypes: group arrays A,B.. to leave out. Default: the training's.")
    prototypes: int | None = option("Prototypes: maximum per class. Default: 8.", min=1, max=16)
    taught: int | None = option("Prototypes: slots per class for taught touches. Default: 3.", min=0, max=16)
    spare_classes: int | None = option(
        "Prototypes: number of last classes without recordings, to be taught later.", min=0, max=30
    )

    @property
    def widths(self) -> Record:
        """The widths that were given, by the names of ``eskin.training.quantise.choose_formats``."""
        widths = self._given("weight_bits", "state_bits")
        if self.formats == "lean":
            return widths | {"lean": True}
        for word in parse_names(self.formats or ""):
            name, _, number = word.partition("=")
            if name not in FORMATS or not (number.isdecimal() and len(number) < 5):
                raise InputError(
                    f"--formats {word[:40]}: is not a format; give {', '.join(FORMATS)} with a number, such as "
                    "gate_bits=9, or the word lean"
                )
            widths[name] = int(number)
        return widths

    @property
    def readout_options(self) -> Record:
        """The user's options about prototypes."""
        return self._given("groups", "prototypes", "taught", "spare_classes")

    def _given(self, *names: str) -> Record:
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def command(request: QuantiseRequest) -> None:
    from eskin.training.integers import quantise as to_integers

    readout_options = request.readout_options
    if request.readout != "prototypes":
        for name in readout_options:
            raise InputError(
                f"--{name.removesuffix('s').replace('_', '-')}: needs --readout prototypes; give both"
            )
    elif request.data is None:
        raise InputError("--readout prototypes: needs the recordings of the training; give --data")
    widths = request.widths
    recordings = None if request.data is None else recordings_for(request.data, load_config(request.model))
    if request.quantisation_aware:
        if recordings is None or "lean" in widths or request.readout:
            raise InputError(
                "--quantisation-aware: needs the recordings of the training; give --data, and neither "
                "--formats lean nor --readout"
            )
        with progress_bars() as report:
            aware = partial(report, "training in integers")
            integer = to_integers(request.model, recordings, aware=aware, **widths)
    else:
        if request.readout and recordings is not None and recordings.image_shape:
            raise InputError("--readout: models for images have none; leave it out")
        decided_by = readout_options if request.readout == "prototypes" else request.readout
        integer = to_integers(request.model, recordings, readout=decided_by, **widths)
    show("quantise", formats=describe_formats(integer.config))
