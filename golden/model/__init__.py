"""Public names of golden.model: models, their runs, and the traces of a run."""

from eskin.golden.model.cells import Fixed, Float, run_cell
from eskin.golden.model.conversion import codes_of, samples_of, through_converter
from eskin.golden.model.image_network import ImageTrace, float_images, images_of, layer_formats, run_images
from eskin.golden.model.model import (
    FloatModel,
    IntegerModel,
    check_model_target,
    constants_shape,
    load_config,
    network_formats,
    network_shapes,
    real_by_input,
)
from eskin.golden.model.pipeline import Trace, decide_touches, float_features, run
from eskin.golden.model.preprocess import Touches, find_touches, normalise, real_features
from eskin.golden.model.stream import Stream
from eskin.golden.model.vectors import completing_frames, write_image_vectors, write_vectors
