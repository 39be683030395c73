"""What the tests of a session have covered: a plugin of pytest that notes the bins of scripts/crosses.py.

Each process writes a file into build/coverage/parts at its end; `scripts.coverage` merges them.
"""

import functools
import json
import sys
from collections import Counter, defaultdict
from contextlib import ExitStack
from typing import Any
from unittest import mock

import numpy as np

from scripts.coverage import PARTS, merge
from scripts.crosses import CROSSES, HEADROOM, ROWS, Seen, text

HITS: dict[str, Counter[str]] = defaultdict(Counter)
"""Test -> "cross: bin" -> comparisons."""
_arithmetic: tuple[set[tuple[str, str]], set[str]] = set(), set()
_test = [""]


def note(cross: str, *case: Any) -> None:
    """The test that runs has compared this case."""
    if _test[0]:
        HITS[_test[0]][f"{cross}: {text(case)}"] += 1


def observe(run: Any, played: Any) -> None:
    """Note all bins of a co-simulation, if nothing in it differs."""
    narrowed, headroom = _arithmetic[0].copy(), _arithmetic[1].copy()
    for part in _arithmetic:
        part.clear()
    if not played.bit_exact:
        return
    seen = Seen(run.config, run.expected, played, narrowed, headroom)
    for cross in CROSSES:
        for case in {*cross.cases(seen)}:
            note(cross.name, *case)


def _joined(real: Any, config: Any, parts: Any) -> Any:
    """The result of a co-simulation, looked at with the run that its caller played."""
    observe(sys._getframe(1).f_locals["run"], played := real(config, parts))
    return played


def narrowed(name: str, value: Any, shift: int, fmt: Any) -> None:
    """How the values of a narrowing are rounded and saturated."""
    value, half = np.asarray(value, dtype=np.int64), 1 << shift >> 1
    rest, code = value & (1 << shift) - 1, value + half >> shift
    ways = {"tie": (rest == half) & (half > 0), "down": (rest > 0) & (rest < half), "up": rest > half}
    ways |= {"high": code > fmt.max_code, "low": code < fmt.min_code}
    _arithmetic[0].update((name, way) for way, found in ways.items() if found.any())


def _expected_of(real: Any, model: Any, *rest: Any) -> Any:
    """The golden trace, with every narrowing on its way looked at."""
    from eskin.golden.model import preprocess, prototypes, torch_model

    def rows(value, shift, fmt):
        frame = sys._getframe(1)
        while frame.f_code.co_name not in (*ROWS, "run_images_on_torch"):
            frame = frame.f_back
        name = frame.f_code.co_name if frame.f_code.co_name in ROWS else "map"
        narrowed(name, value, shift, fmt)
        if name not in ("state", "tanh_of_state") and value.numel():
            used = int(value.abs().max()).bit_length() + 1
            _arithmetic[1].add(HEADROOM[max(0, min(model.config.accumulator_bits - used, len(HEADROOM) - 1))])
        return plain["_narrow"](value, shift, fmt)

    def clamp(value, fmt):
        narrowed("centred", value, 0, fmt)
        return plain["clamp"](value, fmt)

    def narrow(value, shift, fmt):
        narrowed("feature", value, shift, fmt)
        return plain["narrow"](value, shift, fmt)

    def codes(config, values):
        narrowed("state code", values, config.readout_rule.state_code_shift, config.state_code_format)
        return plain["narrowed"](config, values)

    places = ((torch_model, "_narrow", rows), (preprocess, "clamp", clamp), (preprocess, "narrow", narrow))
    plain = {}
    with ExitStack() as stack:
        for module, name, looking in (*places, (prototypes, "narrowed", codes)):
            plain[name] = getattr(module, name)
            stack.enter_context(mock.patch.object(module, name, looking))
        return real(model, *rest)


def pytest_runtest_setup(item: Any) -> None:
    """The next test; the co-simulation is watched once it has been imported."""
    _test[0] = item.nodeid
    HITS[item.nodeid].update()
    flow, verb = (sys.modules.get(f"eskin.{name}") for name in ("cosim.flow", "verbs.cosim"))
    if flow and not hasattr(flow.joined, "func"):
        flow.joined = functools.partial(_joined, flow.joined)
    if verb and not hasattr(verb.expected_of, "func"):
        verb.expected_of = functools.partial(_expected_of, verb.expected_of)


def pytest_sessionfinish(session: Any) -> None:
    """Leave what this process has seen."""
    worker = getattr(session.config, "workerinput", {}).get("workerid", "main")
    if any(HITS.values()):
        PARTS.mkdir(parents=True, exist_ok=True)
        (PARTS / f"{worker}.json").write_text(json.dumps(HITS))
    if worker == "main":  # its workers have ended
        try:
            merge()
        except ValueError as error:  # raised here, it would take the place of the tests' own summary
            session.exitstatus = 1
            session.config.get_terminal_writer().line(f"\ncoverage: {error}", red=True)
