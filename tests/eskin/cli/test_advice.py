"""Each advice of a doubt is something that the command line takes."""

from eskin.cli.common import spelled
from eskin.cli.main import command_of
from eskin.golden.core import PRESETS
from eskin.training.formats import with_network
from eskin.training.record import NetworkRow
from tests.eskin.choose.test_doubts import BASELINE, VECTORS, below
from tests.support.result_case import some
from tests.support.table import each_row


@each_row("verb", ["run", "train"])
@each_row("rival", [BASELINE, VECTORS])
@each_row("cell, hidden", [("linear", 0), ("gru", 8), ("gru", 32)])
def test_every_advice_is_something_that_the_verbs_take(verb, rival, cell, hidden):
    """The options of the sentence are options of both verbs, and the network is one that there is."""
    options = {opt for parameter in command_of(verb).params for opt in parameter.opts}
    for candidates in ([some(NetworkRow, cell=cell, hidden=hidden, accuracy=0.9)], None):
        (one,) = below(candidates, (rival, 0.95))
        words = spelled(one.text).replace(";", " ").split()
        assert {word for word in words if word.startswith("--")} <= options
        if "--hidden" in words:
            advised = int(words[words.index("--hidden") + 1])
            assert cell != "linear" and advised > hidden
            with_network(PRESETS["thesis"], cell=words[words.index("--cell") + 1], hidden=advised)
