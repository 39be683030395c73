"""Which networks are tried on which front ends, with how many seeds, and what the command line fixes."""

import dataclasses
from types import SimpleNamespace

import numpy as np

from eskin.choose.candidate import ScoredCandidate
from eskin.choose.choice_table import network_name
from eskin.choose.front_ends import Listed
from eskin.choose.networks import (
    AS_REQUESTED,
    AVERAGED,
    FITS,
    INSIDE,
    MOVES,
    RIDGES,
    STURDY,
    Effort,
    NetworkSearch,
    SearchOptions,
    choose_networks,
)
from eskin.choose.search import Request, search
from eskin.training.judge import Decided, Decisions, folds_of
from eskin.training.recipe import AS_RECORDED
from tests.eskin.choose.test_candidate import CONFIG
from tests.support.gripped_scene import by_person, gripped_recordings
from tests.support.prices import priced
from tests.support.table import each_row, refused

DEAR = CONFIG.replace(steps=8)
TOUCHED = CONFIG.replace(
    onset="baseline",
    rest="tracked",
    rest_frames=13,
    onset_mean_frames=8,
    onset_check_frames=2,
    rearm_frames=32,
)


OPEN, WHOLE = SearchOptions(open=True), Effort(seeds=3)


def played(front_ends, right, options=OPEN, effort=WHOLE, of=400, for_trees=(), **prices):
    """What a search asks for, (cell or units, steps, recipe, share, other seeds), where a candidate is right
    on ``right(candidate)`` of 400 recordings; and the candidate taken."""
    requested = []

    def judged(requests):
        for request in requests.values():
            for one in request.candidates:
                units = one.network.hidden or one.network.cell
                steps, recipe = one.config.windows.steps, one.recipe.name
                requested.append((units, steps, recipe, request.share, request.other_seeds))
        return {
            number: [decided(one, np.arange(of) >= right(one), request) for one in request.candidates]
            for number, request in requests.items()
        }

    state = started(front_ends[0], front_ends, options, effort, np.arange(of), [], **prices)
    state.front_ends = dataclasses.replace(state.front_ends, for_trees=for_trees)
    search([state], MOVES if options.open else AS_REQUESTED, judged)
    return requested, state.taken, state.tried


def decided(candidate, wrong, request):
    """A candidate whose networks, one or two further ones, are wrong on some recordings of class 0."""
    everything = np.arange(len(wrong))
    integer = SimpleNamespace(config=candidate.config)
    decider = SimpleNamespace(
        integer=integer, decide=lambda rows: Decided.at_once(wrong[rows] + 0, wrong[rows] + 0)
    )
    seeds = [1, 2] if request.other_seeds else [0]
    fitted = [(fold, decider) for fold in folds_of([everything], seeds, everything)]
    decisions = Decisions.of(fitted, np.zeros(len(wrong), dtype=int))
    return ScoredCandidate.of(candidate, decisions, everything, None)


def started(on, front_ends, options, effort, rows, tests, **prices):
    """A search of networks before its first move."""
    return NetworkSearch(
        prices=priced(**prices),
        front_ends=Listed(on, tuple(front_ends)),
        options=options,
        effort=effort,
        rows=rows,
        tests=tests,
    )


def by_units(**right: int):
    """Of a candidate the recordings that networks of its units (``linear``: 0) have right."""
    return lambda one: right[f"u{one.network.hidden}"]


@each_row(
    "right, first, others",
    [
        # settled: no other is better, and what is dearer gets no further seeds
        (dict(u0=400, u4=399, u8=400, u12=400), [4, 8, 12], {"linear"}),
        (dict(u0=380, u4=200, u8=370, u12=388, u16=388), [4, 8, 12, 16], {"linear", 12, 16}),
        (dict(u0=380, u4=200, u8=250, u12=300, u16=320), [4, 8, 12, 16], {"linear"}),
        # 12 is level with 8
        (dict(u0=320, u4=340, u8=380, u12=381), [4, 8, 12], {8, 12}),
    ],
)
def test_what_cannot_be_taken_is_judged_with_one_seed(right, first, others):
    asked, _, tried = played([CONFIG], by_units(**right))
    assert [units for units, *_, further in asked if units != "linear" and not further] == first
    assert {units for units, *_, further in asked if further} == others
    units = {one: one.candidate.network.hidden for one in tried}
    assert all(len(one.seeds) == 1 + 2 * (count in others) for one, count in units.items() if count)


def test_fits_are_tried_on_the_first_front_end_and_the_best_on_the_others():
    squares = lambda one: 390 if one.recipe.squares else 300
    asked, taken, _ = played([CONFIG, DEAR], squares)
    linear = [(steps, name) for units, steps, name, _, further in asked if units == "linear" and not further]
    ridges = [f"ridge {share}" for share in RIDGES]
    of_first = [AVERAGED, "linear", "weak penalty", "least squares", *ridges]
    assert linear == [*((6, name) for name in of_first), (8, "least squares")]
    assert taken.config.network.cell == "linear" and taken.front_end == CONFIG
    asked, *_ = played([CONFIG, DEAR], lambda one: 400)
    assert {steps for _, steps, *_ in asked} == {6}  # none is dearer than one that is settled
    asked, _, tried = played([TOUCHED], squares)
    recipes = [one.candidate.recipe for one in tried[:9]]
    assert [recipe.name for recipe in recipes] == [name for name in FITS if name not in STURDY]
    assert [recipe.augments for recipe in recipes] == [False, True, False, False, True, *[False] * 4]
    assert [recipe.penalty for recipe in recipes] == [1.0, 1.0, 1.0, 10.0, *[1.0] * 5]
    assert [recipe.ridge for recipe in recipes] == [0.01, *[0.0] * 5, *RIDGES]
    assert set(AS_RECORDED) < {field.name for field in dataclasses.fields(recipes[0])}


def test_recurrent_networks_stand_on_the_front_end_that_a_part_of_the_updates_chose():
    better = lambda one: 300 + one.config.recurrent * (50 + (one.config.windows.steps == 8))  # and level
    asked, taken, _ = played([CONFIG, DEAR], better)
    assert [(units, steps) for units, steps, _, share, _ in asked if share == 2] == [(12, 6), (12, 8)]
    units = [(units, steps) for units, steps, _, share, more in asked if share == 1 and not more]
    assert units[-3:] == [(4, 8), (8, 8), (12, 8)] and taken.front_end == DEAR
    fixed, taken, tried = played([CONFIG, DEAR], better, SearchOptions(cell="gru", hidden=5))
    assert [(units, steps, share) for units, steps, _, share, _ in fixed] == [(5, 6, 2), (5, 8, 2)]
    assert taken.front_end == DEAR and not tried
    assert played([CONFIG, DEAR], better, SearchOptions(cell="linear"))[0] == []


def test_trees_find_their_front_end_with_the_most_and_are_not_tried_if_a_cell_is_settled(monkeypatch):
    divided = dict(window_mode="whole", store_per_window=8, touch_frames=65535, decision="last")
    single, double = (
        TOUCHED.replace(hop=4, window=8, steps=steps, feature_kinds=("mean",), **divided) for steps in (1, 2)
    )

    def tried(right, effort=WHOLE):
        requests, choice, _ = played([CONFIG], right, effort=effort, for_trees=(single, double))
        found = [(steps, share) for units, steps, _, share, _ in requests if units == "trees"]
        return found, choice

    forests = lambda made: made.config.network.cell == "trees"
    found, choice = tried(lambda made: 300 + 40 * made.config.windows.steps if forests(made) else 200)
    assert found[:4] == [(1, 1), (2, 1), (2, 1), (2, 1)]  # and two other sizes on the best
    assert choice.front_end == double and network_name(choice.network) == "64 trees of depth 12"
    assert tried(lambda made: 300, INSIDE)[0] == [(1, 4), (2, 4)]
    assert tried(lambda made: 400)[0] == []
    short_of = lambda points: (
        lambda made: 380 - points if forests(made) else 200 if made.config.recurrent else 380
    )
    for few_groups, points, cell in (
        (False, 40, "linear"),
        (True, 40, "trees"),
        (True, 41, "linear"),  # more than a tenth of 400 behind
    ):
        effort = dataclasses.replace(INSIDE, few_groups=few_groups)
        assert tried(short_of(points), effort)[1].config.network.cell == cell
    tied = [
        decided(candidate, np.zeros(4, dtype=bool), Request())
        for candidate in (OPEN.candidate(CONFIG, "linear"), OPEN.forest(single, 16, 8))
    ]
    state = dataclasses.replace(started(CONFIG, [CONFIG], OPEN, effort, np.arange(4), []), tried=tied)
    assert "linear cells are left out" in state.remarks[0]
    assert not dataclasses.replace(state, effort=INSIDE).remarks
    monkeypatch.setattr("eskin.choose.networks.MOST_FOREST_VALUES", 400 * single.inputs)
    assert tried(lambda made: 300, INSIDE)[0] == [(1, 4)]  # two windows are too many values


def test_inside_folds_a_choice_is_short():
    asked, *_ = played([CONFIG, DEAR], by_units(u0=300, u8=330), effort=INSIDE)
    assert [(units, steps, share) for units, steps, _, share, _ in asked] == [
        *[("linear", 6, 4)] * 4,
        *[("linear", 8, 4)] * 3,
        (8, 6, 4),
        (8, 8, 4),  # and not again as a candidate
    ]
    asked, taken, _ = played([CONFIG, DEAR], by_units(u0=400), effort=INSIDE)
    assert {units for units, *_ in asked} == {"linear"} and taken.config.network.cell == "linear"


def test_of_two_parts_no_kind_of_fit_is_chosen():
    """Each network would learn from one group alone."""
    recordings = gripped_recordings()
    first, second, third, last = (np.flatnonzero(recordings.groups["person"] == k) for k in range(4))
    for effort in (INSIDE, WHOLE):
        for parts in ([first, second, third], [np.r_[first, second], np.r_[third, last]], [first, first]):
            assert effort.by(recordings, parts) == effort
        two = effort.by(recordings, [first, second])
        assert two.fits == (AVERAGED,) and two.units == INSIDE.units and not two.sturdy
        assert two.few_groups
    asked, taken, _ = played([CONFIG, DEAR], lambda one: 390 if one.recipe.squares else 300, effort=two)
    assert {recipe for units, _, recipe, *_ in asked if units == "linear"} == {AVERAGED}
    assert taken.recipe.averaged


def test_what_does_not_fit_a_named_board_is_not_judged():
    asked, *_ = played([CONFIG], lambda one: 360, named=True, fits=lambda config: not config.recurrent)
    assert {units for units, *_ in asked} == {"linear"}
    nothing = {"named": True, "fits": lambda config: False}
    with refused("no candidate network fits it and the board icebreaker"):
        played([CONFIG], lambda one: 360, **nothing)
    with refused("`fits` icebreaker: does not hold gru"):
        played([CONFIG], lambda one: 360, SearchOptions(cell="gru"), **nothing)


def test_a_fit_whose_matrices_would_fill_the_memory_is_not_tried(monkeypatch):
    inputs = CONFIG.windows.steps * CONFIG.inputs
    for most, tried in ((inputs, True), (inputs - 1, False)):
        monkeypatch.setattr("eskin.choose.networks.MOST_STURDY_INPUTS", most)
        assert (SearchOptions().possible(CONFIG, "linear", None, "sturdy 1") is not None) == tried
        assert SearchOptions().possible(CONFIG, "linear", None, "ridge 0.01")
        assert SearchOptions().possible(CONFIG, "gru", 8, "robust")


def test_choices_made_side_by_side_are_those_made_alone(quick):
    recordings = gripped_recordings()
    persons = recordings.groups["person"]
    parts = [np.flatnonzero(persons != value) for value in (0, 1)]
    folds = [[part[persons[part] == value] for value in np.unique(persons[part])] for part in parts]
    settings = by_person(recordings, [0])

    def start(number):
        return started(DEAR, [CONFIG, DEAR], OPEN, INSIDE, parts[number], folds[number])

    both = [start(0), start(1)]
    together = choose_networks(both, settings)
    for number, state in enumerate(both):
        alone = start(number)
        assert choose_networks([alone], settings) == [together[number]]
        assert [one.candidate for one in state.tried] == [one.candidate for one in alone.tried]
        for one, other in zip(state.tried, alone.tried, strict=True):
            assert len(one.correct) == len(parts[number])
            assert one.candidate.config.recurrent or (one.correct == other.correct).all()
            assert one.seeds == [0] and set(one.decisions.table["recording"]) == set(parts[number])
