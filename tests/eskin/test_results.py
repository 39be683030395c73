"""Result files keep the keys that they have had: every file of version 0.3.0 (a chip's: of later) is read by its model,
and written the same."""

from eskin.cosim.results import Played
from eskin.pages.result import Run
from eskin.study.stability.core import Stability
from eskin.training.evaluate import Evaluation
from eskin.training.record import Training
from eskin.verbs.asic import Chip, ChipEnergy
from eskin.verbs.build import Build
from eskin.verbs.energy import Energies
from tests.support.result_case import FROZEN
from tests.support.table import each_row

MODELS = {
    "cosim": Played,
    "cosim_declared": Played,
    "cosim_netlist": Played,
    "cosim_converter": Played,
    "evaluate": Evaluation,
    "energy": Energies,
    "stability": Stability,
    "training": Training,
    "run": Run,
    "build": Build,
    "asic": Chip,
    "chip_energy": ChipEnergy,
}


@each_row("name", MODELS)
def test_a_result_of_before_is_read_and_written_the_same(name):
    assert MODELS[name].model_validate(FROZEN[name]).plain() == FROZEN[name]
