"""eskin/choose/cost.py: the front of cost and accuracy."""

from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.choose.cost import pareto

records = st.lists(
    st.fixed_dictionaries({"accuracy": st.integers(0, 10), "latency_s": st.integers(1, 10)}),
    min_size=1,
    max_size=12,
)


@settings(deadline=None, derandomize=True)
@given(records)
def test_the_front_is_what_nothing_beats(records):
    def beats(a, b):
        as_good = a["accuracy"] >= b["accuracy"] and a["latency_s"] <= b["latency_s"]
        return as_good and (a["accuracy"], a["latency_s"]) != (b["accuracy"], b["latency_s"])

    expected = {i for i, record in enumerate(records) if not any(beats(other, record) for other in records)}
    assert set(pareto(records, "latency_s")) == expected
