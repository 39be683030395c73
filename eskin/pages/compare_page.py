"""The page of ``eskin compare``: float against integer, stage by stage; one self-contained HTML file."""

from eskin.golden.core import Record
from eskin.pages.views import page, parts, words

PAGE = "compare.html"


def render(result: Record) -> str:
    """The page of a result of ``eskin.training.evaluate.compare_stages``."""
    return page("compare.html.j2", result=result, findings=parts(words("findings", **result)))
