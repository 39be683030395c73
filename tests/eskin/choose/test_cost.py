"""eskin/choose/cost.py: the front of cost and accuracy."""

from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.choose.cost import pareto

places = st.lists(st.tuples(st.integers(1, 10), st.integers(0, 10)), min_size=1, max_size=12)


@settings(deadline=None, derandomize=True)
@given(places)
def test_the_front_is_what_nothing_beats(places):
    """Of costs and accuracies."""

    def beats(a, b):
        return a != b and a[1] >= b[1] and a[0] <= b[0]

    assert pareto(places) == sorted(p for p in places if not any(beats(other, p) for other in places))
