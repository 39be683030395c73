"""The search loop of front ends and of networks: moves, one after another, each of which names the candidates to
judge next.

The moves of a search are a table. A *move* is a row of it: a function of the search's state that returns a
`Request`. `search` makes each move in all searches of a list before the next move, so that networks of one
candidate train together in the folds of a nested choice. To try something new, add a row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from eskin.choose.candidate import Candidate, ScoredCandidate
from eskin.choose.cost import CostModel


@dataclass(frozen=True)
class Request:
    """Candidates to judge: with 1/``share`` of a recurrent network's updates, on the first seed or on all others.
    probe: they do not become candidates of the choice."""

    candidates: Sequence[Candidate] = ()
    share: int = 1
    other_seeds: bool = False
    probe: bool = False


@dataclass(eq=False, kw_only=True)
class Search:
    """The state of a search. tried: the candidates of the choice, judged, in the order of judging. known: these and
    the probes, by candidate and share."""

    prices: CostModel
    tried: list[ScoredCandidate] = field(default_factory=list)
    known: dict[tuple[Candidate, int], ScoredCandidate] = field(default_factory=dict)

    def open_part(self, request: Request) -> Request | None:
        """The part of a request that was not judged before; None if there is none."""
        if request.other_seeds:
            return request if request.candidates else None
        unique = dict.fromkeys(request.candidates)
        fresh = [one for one in unique if (one, request.share) not in self.known]
        return Request(fresh, request.share) if fresh else None

    def add(self, request: Request, judged: Iterable[ScoredCandidate]) -> int:
        """Take over the answers to the open part of a request; the number of new candidates of the choice. An
        answer may lack a candidate: its formats do not fit."""
        answers = {one.candidate: one for one in judged}
        if request.other_seeds:
            self.tried = [
                one.joined(answers[one.candidate]) if one.candidate in answers else one for one in self.tried
            ]
        else:
            self.known |= {(candidate, request.share): one for candidate, one in answers.items()}
        before = {one.candidate for one in self.tried}
        fresh = [one for one in dict.fromkeys(request.candidates) if one not in before]
        scored = self.scored(fresh, request.share)
        if not request.probe:
            self.tried += scored
        return len(scored)

    def scored(self, candidates: Iterable[Candidate], share: int = 1) -> list[ScoredCandidate]:
        """Those of ``candidates`` that were judged."""
        return [self.known[one, share] for one in candidates if (one, share) in self.known]


State = TypeVar("State", bound=Search)
Judge = Callable[[Mapping[int, Request]], Mapping[int, Sequence[ScoredCandidate]]]
"""From requests of searches, by number, to the judged candidates of each."""


@dataclass(frozen=True)
class Move(Generic[State]):
    """A row of a table of moves. repeats: how often it is made at most; it ends when it names no new candidate."""

    name: str
    request: Callable[[State], Request]
    repeats: int = 1


def search(searches: Sequence[State], moves: Iterable[Move[State]], judge: Judge) -> None:
    """Make the moves in their order, each in all ``searches`` before the next."""
    for move in moves:
        going = dict(enumerate(searches))
        for _ in range(move.repeats):
            requests = {number: move.request(state) for number, state in going.items()}
            parts = {number: going[number].open_part(request) for number, request in requests.items()}
            answers = judge({number: part for number, part in parts.items() if part})
            added = {
                number: going[number].add(request, answers.get(number, ()))
                for number, request in requests.items()
            }
            going = {number: state for number, state in going.items() if added[number]}
            if not going:
                break
