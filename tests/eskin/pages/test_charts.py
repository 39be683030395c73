"""What the charts have in common."""

import base64

from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from eskin.pages.charts import share_bars, svg

SHARES = st.lists(st.tuples(st.floats(0, 1), st.none() | st.floats(0, 1)), min_size=1, max_size=5)


@given(SHARES)
def test_no_bar_leaves_the_range_of_a_share(pairs):
    shares, spreads = zip(*pairs, strict=True)
    down, up = share_bars(shares, spreads)
    assert (down >= 0).all()
    assert (up >= 0).all()
    assert (shares - down >= 0).all()
    assert (shares + up <= 1 + 1e-12).all()


def test_letters_that_the_font_lacks_stay_text():
    """Names of classes may be in any script: a browser has the letters, the plots' font has not."""

    def drawn(name: str) -> str:
        figure = Figure()
        figure.subplots().set_title(name)
        return base64.b64decode(svg(figure).partition(",")[2]).decode()

    assert ">ㅂ</text>" in drawn("ㅂ") and "<text" not in drawn("press")
