"""What the charts have in common."""

from hypothesis import given
from hypothesis import strategies as st

from eskin.pages.charts import share_bars

SHARES = st.lists(st.tuples(st.floats(0, 1), st.none() | st.floats(0, 1)), min_size=1, max_size=5)


@given(SHARES)
def test_no_bar_leaves_the_range_of_a_share(pairs):
    shares, spreads = zip(*pairs, strict=True)
    down, up = share_bars(shares, spreads)
    assert (down >= 0).all()
    assert (up >= 0).all()
    assert (shares - down >= 0).all()
    assert (shares + up <= 1 + 1e-12).all()
