"""The budget: its counts, and that a cap below today's figure fails."""

from scripts import house

BUDGET = """# kept as it is
[tokens]  # a line a folder
part = 1234

[counts]
options = 900
fields = 900
"""


def test_comments_and_docstrings_are_not_counted():
    text = f'"""{"d" * 300}"""\nx = 1  # one\ntext = "{"s" * 250}"\n'
    assert house.tokens(text) == 7 and house.long_strings(text) == 250


def test_names_and_phrases_that_say_too_little_are_counted():
    """Four names are bound; a name that is read, a key, and a string that is no docstring do not count."""
    text = (
        'def told(one, *, seed=1):\n    """The sums of touches and those\n    of rest."""\n'
        '    for held in one:  # That of whom?\n        self.kept, text = held, "what is"\n'
    )
    assert house.unclear(text) == (4, 2)


def test_what_has_no_cap_may_not_be_there_and_a_cap_below_todays_figure_fails():
    assert house.over_budget({"a": 1, "b": 0}, {}) == ["a is 1, above its cap of 0"]
    assert house.over_budget({"part": 7}, {"part": 7}) == []
    assert house.over_budget({"part": 7}, {"part": 6}) == ["part is 7, above its cap of 6"]


def test_caps_are_lowered_and_never_raised():
    wanted = BUDGET.replace("part = 1234", "part = 1200").replace("options = 900", "options = 17")
    assert house.lowered(BUDGET, {"part": 1101, "options": 17, "fields": 901}) == wanted
