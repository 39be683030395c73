"""Public names of golden.core: formats, configuration, errors, files, shared types."""

from eskin.golden.core.activation import sigmoid_table, tanh_table
from eskin.golden.core.config import PRESETS, AcceleratorConfig
from eskin.golden.core.content import APART, content_key, model_hash
from eskin.golden.core.converters import ConverterFault, SpiPlan, converter_plan
from eskin.golden.core.errors import InputError, SimulationError, array_of
from eskin.golden.core.files import (
    PREFIX,
    ArchiveError,
    Check,
    Result,
    check_folder,
    check_prefix,
    check_target,
    prefixed,
    read_arrays,
    replacing,
    replacing_folder,
    template,
    write_json,
)
from eskin.golden.core.formats import QFormat, clamp, narrow, signed_bits
from eskin.golden.core.groups import EXTREMES, FEATURE_KINDS, SUMMED
from eskin.golden.core.images import NETWORKS, Conv, Dense, Pool
from eskin.golden.core.types import Arrays, Progress, Record
