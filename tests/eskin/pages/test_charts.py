"""What the charts have in common."""

from hypothesis import given
from hypothesis import strategies as st

from eskin.pages.charts import share_bar


@given(st.floats(0, 1), st.none() | st.floats(0, 1))
def test_no_bar_leaves_the_range_of_a_share(share, spread):
    (down,), (up,) = share_bar(share, spread)
    assert 0 <= down <= share and up >= 0 and share + up <= 1 + 1e-12
