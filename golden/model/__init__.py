"""Public names of golden.model: models, their runs, and the traces of a run."""

from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.conversion import codes_of, samples_of, through_converter
from eskin.golden.model.image_network import (
    ImageTrace,
    float_images,
    images_of,
    layer_formats,
    random_images,
    run_images,
)
from eskin.golden.model.model import (
    FloatModel,
    IntegerModel,
    check_model_target,
    constants_shape,
    describe_formats,
    load_config,
    load_training,
    model_files,
    network_formats,
    network_shapes,
    normaliser_constants,
    random_integer_model,
    real_by_input,
    with_network,
)
from eskin.golden.model.pipeline import Trace, decide_touches, float_features, run, step_times
from eskin.golden.model.preprocess import Touches, find_onsets, find_touches, normalise, real_features
from eskin.golden.model.stream import Stream
from eskin.golden.model.vectors import (
    completing_frames,
    random_recordings,
    write_image_vectors,
    write_vectors,
)
