"""`eskin run` on images, from an archive to a page, on the real simulator."""

import json

import pytest

from eskin.golden.core import AcceleratorConfig, InputError
from eskin.golden.data import save_archive
from eskin.pages.report import write_report
from eskin.pages.views import count
from eskin.verbs.main_job import run
from tests.support.image_scenes import SHAPES, shapes


def archive(tmp_path, **changes):
    save_archive(shapes(40, 0, (8, 10)), tmp_path / "shapes.npz")
    config = AcceleratorConfig.of_image(8, 10, ("conv 3 4", "pool", "dense 3"), SHAPES, name="tiny")
    (tmp_path / "c.json").write_text(config.replace(**changes).to_json())
    return str(tmp_path / "shapes.npz"), str(tmp_path / "c.json")


@pytest.mark.slow
def test_images_go_through_the_whole_job(tmp_path):
    data, config = archive(tmp_path)
    record = run(data, config, 6, tmp_path / "out", name="Shapes by hand")
    assert record["passed"] and record["images"] and len(record["cosimulated"]) == 6
    cosim = json.loads((tmp_path / "out/cosim.json").read_text())
    assert cosim["bit_exact"] and cosim["recordings"] == 6 and cosim["compared_values"] > 6 * 80
    page = (tmp_path / "out/report.html").read_text()
    assert "<h1>Shapes by hand: " in page and "bit-exact" in page and "conv 3 4" in page and "dot" in page
    cycles = json.loads((tmp_path / "out/run.json").read_text())["layer_cycles"]
    # to the engine and from it 5 cycles; of its 4 lanes one has no class
    assert sorted(cycles) == ["0", "2"]
    assert sum(cycles.values()) == cosim["cycles"]["decision_latency_max"] - 4
    assert all(f">{count(value)}<" in page for value in cycles.values()) and "by chance 33.3" in page
    write_report(tmp_path / "out")
    assert (tmp_path / "out/report.html").read_text() == page
    (tmp_path / "out/evaluate.json").write_text("{}")
    with pytest.raises(InputError, match="evaluate.json: has no field 'chance'"):
        write_report(tmp_path / "out")
    assert (tmp_path / "out/report.html").read_text() == page
