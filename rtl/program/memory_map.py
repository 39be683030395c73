"""The host's view: the register map of the bus, and the memory images of an integer model.

Plain Python (no Amaranth), so that command line, C header and benches can share it.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum, IntFlag
from types import MappingProxyType
from typing import Self

import numpy as np

from eskin.golden.core import AcceleratorConfig, Arrays
from eskin.golden.core.config import VOTE_BITS
from eskin.rtl.program.cells import CellProgram
from eskin.rtl.program.image_passes import ImagePlan, plan_of
from eskin.rtl.program.image_signature import BIAS_WORD_BITS, checked_program
from eskin.rtl.program.microcode import Layout, Microcode
from eskin.rtl.program.schedule import schedule
from eskin.rtl.program.scheduler import RowGroup
from eskin.rtl.program.signature import check_words, with_parity

ID_VALUE = 0xE5C1
VERSION_VALUE = 5
READABLE_VERSIONS = (4, 5)
"""Versions of the map with which a host of this version works: from version 4 on addresses up to 0x3B
stay."""


class Bits(IntFlag):
    """Bits of a register, each with its ``text``."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        bit = int.__new__(cls, value)
        bit._value_, bit.text = value, text
        return bit


class Control(Bits):
    """Commands."""

    ARM = (
        1,
        "Start a recording: ring, rest levels, sums and state are cleared a cycle after the write; frames count from then on",
    )
    FINISH = 2, "End the recording: an open touch is decided as partial"
    CLEAR_FAULTS = 4, "Clear FAULTS and LONGEST"
    EVERY = 8, "With ARM: every frame of the source arrives, and the chain drops those that it does not take"


class Measure(IntEnum):
    """Quantities whose largest value LONGEST holds since the quantity was chosen or cleared."""

    FRAME = 0  # from a frame's first beat offered to its last beat taken
    STEP = 1  # cycles of a step, up to its last logit
    WINDOWS = 2  # without a break, from a window's last taxel taken by the engine until no window waits and the last one's logits are out


class Status(Bits):
    """Status bits."""

    ARMED = 1, "Waiting for an onset"
    TOUCH = 2, "A touch is open (onset found, its last decision not yet given)"
    BUSY = 4, "A frame, sum, step, decision or command is in flight"
    NO_TOUCH = 8, "No onset since arm"
    FAULT = 16, "CHECKSUM or WATCHDOG is set in FAULTS"


class Fault(Bits):
    """Sticky faults."""

    WRITE_REFUSED = (
        1,
        "A memory write was dropped: during a touch, or (checksum) after the memory's last word",
    )
    INPUT_STALLED = (
        2,
        "Frame offered while the input was not ready: an overrun at the sensor's rate (not set if a CPU feeds)",
    )
    FRAMING = 4, "The marks first and last did not match the number of taxels"
    OVERRUN = 8, "A window was complete while both feature slots were occupied"
    CHECKSUM = 16, "A word of a memory or a configuration register is wrong (checksum)"
    WATCHDOG = 32, "The chain hung and was reset to idle (watchdog)"
    TAXEL = 64, "The fault detector raised a taxel's flag: TAXEL_FAULTS"
    ADDRESS = (128, "Access to a register that this design does not have: it read 0, nothing was written")


class Event(Bits):
    """Events for which a CPU behind a bus waits."""

    DECISION = 1, "A decision waits"
    GLOBAL = 2, "A global decision waits"
    SPACE = 4, "A sample would be taken at once (never set if a converter or a stream feeds)"
    FAULT = 8, "A bit of FAULTS is set"


Fields = Mapping[str, tuple[int, int]]
"""Names of fields, each with its lowest and highest bit."""
WHOLE: Fields = MappingProxyType({})
"""One value in all bits."""
DECISION_FIELDS: Fields = {
    "CLASS": (0, 6),
    "STEP": (7, 14),
    "MARGIN": (15, 28),
    "GLOBAL": (29, 29),
    "PARTIAL": (30, 30),
    "UNSURE": (31, 31),
}
"""The decision word behind a bus (docs/specification_interfaces.md, section 17)."""
NO_DECISION = 0xFFFF_FFFF
"""The word that DECISION reads while no decision waits."""


class Described(IntEnum):
    """A register: its address, and its description in the files of a design (`eskin.rtl.program.register_files`).

    access: ``ro``, ``wo``, ``rw``. text: its content. fields: bits, or names with places; without them it is
    one value. reset: None where it depends on the design. effect: of a read or a write, beside the value's.
    """

    access: str
    text: str
    fields: type[Bits] | Fields
    reset: int | None
    effect: str

    def __new__(
        cls,
        address: int,
        access: str = "ro",
        text: str = "",
        fields: type[Bits] | Fields = WHOLE,
        reset: int | None = 0,
        effect: str = "",
    ) -> Self:
        register = int.__new__(cls, address)
        register._value_, register.access, register.text = address, access, text
        register.fields, register.reset, register.effect = fields, reset, effect
        return register


class Register(Described):
    """Registers of 16 bits. Another address reads 0, writes nothing and sets Fault.ADDRESS (`mapped`)."""

    ID = 0x00, "ro", "Always 0xE5C1", WHOLE, ID_VALUE
    VERSION = 0x01, "ro", "Version of this map", WHOLE, VERSION_VALUE
    CONTROL = 0x02, "wo", "Each bit written as 1 is a command", Control
    STATUS = 0x03, "ro", "State of the chain", Status, None
    FAULTS = 0x04, "ro", "Sticky until CLEAR_FAULTS", Fault
    LONGEST = 0x05, "ro", "Largest number of cycles of the quantity in MEASURE, saturating"
    MEASURE = (
        0x06,
        "wo",
        "Quantity: 0 a frame, 1 a step, 2 consecutive windows",
        {"KIND": (0, 1)},
        0,
        "LONGEST restarts",
    )
    TOUCHES = 0x07, "ro", "Touches begun since ARM, modulo 256", {"COUNT": (0, 7)}
    MEMORY_SELECT = 0x08, "wo", "Memory to load", WHOLE, None, "Loading starts at its first word"
    MEMORY_DATA = 0x09, "wo", "A word of the memory", WHOLE, None, "The next word goes to the next place"
    MASK = 0x10, "wo", "16 taxels per register from here on; a set bit masks the taxel", WHOLE, None
    TAXEL_FAULTS = (
        0x20,
        "ro",
        "16 taxels per register from here on; a set bit is a fault flag; read between frames",
    )


class InterfaceRegister(Described):
    """Registers of position, converter and stimulator, only in designs that have these (`interface_registers`)."""

    POSITION = (
        0x30,
        "ro",
        "Centre of the latest position, in sixteenths of a cell",
        {"X": (0, 7), "Y": (8, 15)},
    )
    POSITION_PEAK = (
        0x31,
        "ro",
        "Largest cell of the latest position; direction 0 none, 1 right, 2 left, 3 down, 4 up",
        {"CELL": (0, 7), "DIRECTION": (8, 10), "ENDED": (11, 11)},
    )
    # the same before and after: the two above belong together
    POSITIONS = 0x32, "ro", "Positions reported since ARM, modulo 65536"
    CONVERTER_FAULTS = 0x33, "ro", "Flags of the converter's faults, sticky until CLEAR_FAULTS"
    FRAMES = 0x34, "rw", "Frames are sent over the serial link", {"ON": (0, 0)}
    # limits of the bitstream hold whatever is written
    STIM_AMPLITUDE = 0x38, "rw", "The stimulator's amplitude; above 255: 255", WHOLE, None
    STIM_DELAY = 0x39, "rw", "The stimulator's delay", WHOLE, None
    STIM_FREQUENCY = 0x3A, "rw", "The stimulator's frequency", WHOLE, None
    STIM_WIDTH = 0x3B, "rw", "The stimulator's pulse width", WHOLE, None


class TeachRegister(Described):
    """Registers of a taught readout, only in designs that have one (`teach_registers`)."""

    TEACH = (
        0x48,
        "wo",
        "Teach CLASS with the touch that ended last, or (NEXT) with the next one, or (LOADED) with the codes "
        "that the host wrote",
        {"CLASS": (0, 6), "NEXT": (7, 7), "LOADED": (8, 8)},
    )
    FORGET = (
        0x49,
        "wo",
        "Remove the taught touches of CLASS, or (ALL) of every class",
        {"CLASS": (0, 6), "ALL": (7, 7)},
    )
    TAUGHT = (
        0x4A,
        "ro",
        "Slots in use; REFUSED: since CLEAR_FAULTS a request to teach or forget was refused; ODD: toggles with "
        "every touch taught",
        {"IN_USE": (0, 7), "REFUSED": (8, 8), "ODD": (9, 9)},
        None,
    )
    PLACES = (
        0x4B,
        "rw",
        "The next word of the memory PROTOTYPES, with its number; all ones: none, because a touch is open or none was "
        "chosen",
        {"WORD": (0, 8), "NUMBER": (9, 15)},
        None,
        "Read: the following word is next; write: sets the number of the next word",
    )


class ShellRegister(Described):
    """Registers of 32 bits that only a CPU behind a bus sees (`eskin.rtl.host.bus_shell`)."""

    SAMPLE = (
        0x40,
        "wo",
        "The next taxel; taxel 0 after ARM",
        {"TAXEL": (0, 15)},
        None,
        "NEXT_TAXEL advances by 1",
    )
    SAMPLE_PAIR = (
        0x41,
        "wo",
        "The next two taxels; after the last taxel the high half is ignored",
        {"FIRST": (0, 15), "SECOND": (16, 31)},
        None,
        "NEXT_TAXEL advances by 2",
    )
    NEXT_TAXEL = (
        0x42,
        "ro",
        "The taxel expected next; REFUSED: samples were refused, so neither that taxel nor a later one has arrived",
        {"TAXEL": (0, 15), "REFUSED": (31, 31)},
        0,
        "Samples are accepted again",
    )
    DECISION = (
        0x44,
        "ro",
        "The oldest waiting decision; all ones: none",
        DECISION_FIELDS,
        NO_DECISION,
        "Removes it",
    )
    EVENTS = 0x45, "ro", "Pending events", Event, None
    ENABLE = (
        0x46,
        "rw",
        "Events that raise the interrupt; GLOBAL_ONLY drops local decisions",
        {bit.name or "": (bit.bit_length() - 1,) * 2 for bit in Event} | {"GLOBAL_ONLY": (8, 8)},
    )


class Memory(IntEnum):
    """Values of MEMORY_SELECT; lanes' weights are 0..lanes-1."""

    ADDENDS = 0x40  # words of 2 x 16 bits (3 x 16 where the accumulator has more than 32), low word first
    CONSTANTS = 0x41
    MEANS = 0x42  # words of as many 16-bit words as a window sum needs, low word first: mean_places
    NODES = 0x44  # of trees, each in as many words as `words_per_entry`, low word first: `node_fields`
    PROTOTYPES = (
        0x43  # codes of prototypes, and how many touches each class was taught; only where they decide
    )


Images = dict[int, list[int]]
"""Contents of memories by MEMORY_SELECT value."""


def memories(config: AcceleratorConfig) -> list[Memory]:
    """Memories that the host loads beside the lanes' weights."""
    if config.is_forest:
        return [Memory.CONSTANTS, Memory.MEANS, Memory.NODES]
    left_out = {Memory.NODES} if config.has_prototypes else {Memory.NODES, Memory.PROTOTYPES}
    return [memory for memory in Memory if memory not in left_out]


class ImageMemory(IntEnum):
    """Values of MEMORY_SELECT in a design for images; 16-bit columns of the convolutions' weights are 0, 1,
    ..."""

    BIASES = 0x40  # with the rounding half of their layer, words of 2 x 16 bits, low word first
    PASSES = 0x41  # the program: eskin/rtl/program/image_passes.py
    DENSE_LOW = 0x42  # halves of the words of the dense layers' weights
    DENSE_HIGH = 0x43


def memory_images(config: AcceleratorConfig, arrays: Arrays, program: CellProgram | None = None) -> Images:
    """Integer contents of every memory by MEMORY_SELECT value.

    Lanes: weight codes in the order the schedule reads them (0 for a lane without a row), set by set where a
    linear cell has one a window. ADDENDS: biases at product scale plus the rounding half of their narrowing,
    room for partial and carried sums, the half of element-wise operations where they share a lane, and a 0
    where the cell has T values. CONSTANTS: the scales, one, zero, with ``checksum`` the check words; on a
    shared lane the dense layer's weights too, each row from a power of two on. MEANS: one a window length, or
    one a kind or input of each (`mean_places`).

    Of trees CONSTANTS are the scales (`scale_places`) and NODES the nodes (`node_fields`), with ``checksum`` the parity above
    each; there are no lanes and no ADDENDS.

    A network for images has the memories of `ImageMemory` and the columns of its convolutions' weights.
    ``program`` is another cell's program, with its arrays; by default the configured cell's.
    """
    if config.is_image:
        return image_memories(plan_of(config), arrays)
    means = [0] * mean_count(config)
    for entry, mean in zip(mean_places(config), np.ravel(arrays["mean"]), strict=True):
        means[entry] = int(mean)
    if config.is_forest:
        return forest_images(config, arrays, means)
    plan = schedule(config, program)

    def weight(number: int, lane: int, group: RowGroup, matrix: str, column: int) -> int:
        # of a linear cell a matrix for each set of weights
        rows = arrays[matrix].reshape(-1, *arrays[matrix].shape[-2:])[number]
        return int(rows[group.first_row + lane, column]) if lane < group.rows else 0

    images: Images = {
        lane: [weight(number, lane, *word) for number in range(config.sets) for word in plan.weight_words]
        for lane in range(config.hardware.lanes)
    }
    shifts = {
        "sigmoid": config.sigmoid_shift,
        "tanh": config.tanh_shift,
        "value": config.value_shift,
        "logit": config.logit_shift,
    }
    addends = []
    for block, row in plan.bias_rows:
        scale = config.dense_bias_shift if block.narrowing == "logit" else config.bias_shift
        addends.append((int(arrays[block.bias][row]) << scale) + (1 << shifts[block.narrowing] - 1))
    half = [1 << config.formats.gate_frac - 1] if plan.shared else []
    zero = [0] if plan.program.t_regions else []
    images[Memory.ADDENDS] = addends + [0] * plan.partial_rows + half + zero
    layout = Layout(config, plan.program)
    images[Memory.CONSTANTS] = constants = [0] * layout.scale_words + [config.gate_one, 0]
    scales = np.reshape(arrays["scale"], (len(config.window_lengths), -1))
    for q, constant in np.ndindex(scales.shape):
        constants[layout.scale_place(constant) + q] = int(scales[q, constant])
    for op in (*plan.mac_before, *plan.mac_after):
        if plan.beside(op):
            group = plan.groups[op.group]
            constants += [0] * (layout.dense_offset(group.first_row) + op.index - len(constants))
            constants.append(weight(0, 0, group, group.block.terms[op.term][0], op.index))
    images[Memory.MEANS] = means
    images |= prototype_image(config, arrays)
    if config.hardware.checksum:
        code = Microcode(plan)
        constants += [0] * (code.layout.constant_words - len(constants))
        checks = check_words(code, {**images, "addend": images[Memory.ADDENDS], "gate": constants})
        constants[layout.check_base : layout.check_base + len(checks)] = checks
        images[Memory.MEANS] = [with_parity(mean, 16 * config.mean_words - 1) for mean in means]
    return images


def scale_places(config: AcceleratorConfig) -> list[int]:
    """Each scale's place in the memory CONSTANTS of trees, in the order of the array, (lengths, constants)."""
    lengths = len(config.window_lengths)
    bits = (lengths - 1).bit_length()
    return [constant << bits | q for q in range(lengths) for constant in range(config.constants)]


def node_fields(config: AcceleratorConfig) -> dict[str, int]:
    """Bits of a node's fields, the lowest first. A subtrahend that is the input itself counts as 0. A child is a node's
    number, or with its highest bit set a vote, the class above it."""
    classes, nodes, inputs, steps = (
        (count - 1).bit_length()
        for count in (config.classes, config.forest.nodes, config.inputs, config.windows.steps)
    )
    child = 1 + max(nodes, VOTE_BITS + classes)
    fields = {"input": inputs, "subtrahend": inputs, "window": steps, "left": child, "right": child}
    return {"threshold": config.threshold_format.width} | fields


def node_words(config: AcceleratorConfig) -> int:
    """16-bit words of a node, its parity included."""
    return -(-(sum(node_fields(config).values()) + config.hardware.checksum) // 16)


def forest_images(config: AcceleratorConfig, arrays: Arrays, means: list[int]) -> Images:
    """Contents of the memories of trees."""
    scales = [0] * (max(scale_places(config)) + 1)
    for place, scale in zip(scale_places(config), np.ravel(arrays["scale"]).tolist(), strict=True):
        scales[place] = scale
    fields, vote = node_fields(config), (1 << VOTE_BITS) - 1
    window, column = np.divmod(arrays["tree_input"], config.inputs)
    leaf = (-1 - arrays["child"]) << VOTE_BITS | arrays["vote"] & vote | 1 << fields["left"] - 1
    left, right = np.where(arrays["child"] < 0, leaf, arrays["child"]).T.tolist()
    threshold = arrays["threshold"] & (1 << fields["threshold"]) - 1
    of_node = threshold, column, arrays["subtrahend"] % config.inputs, window
    parts = [part.tolist() for part in of_node]
    nodes, place = [0] * config.forest.nodes, 0
    for values, bits in zip((*parts, left, right), fields.values(), strict=True):
        nodes = [node | value << place for node, value in zip(nodes, values, strict=True)]
        place += bits
    if config.hardware.checksum:
        means = [with_parity(mean, 16 * config.mean_words - 1) for mean in means]
        scales = [with_parity(scale, 15) for scale in scales]
        nodes = [with_parity(node, place) for node in nodes]
    return {Memory.CONSTANTS: scales, Memory.MEANS: means, Memory.NODES: nodes}


def prototype_words(config: AcceleratorConfig) -> int:
    """Codes of the memory PROTOTYPES: step by step, place by place (with taught places first the place of the
    touch under way; of each class the prototypes, then the taught places), value by value; with ``checksum``
    the parity above each."""
    rule = config.readout_rule
    places = config.classes * (rule.prototypes + rule.taught) + (rule.taught > 0)
    return config.windows.steps * places * config.trajectory_width


def taught_arrays(
    config: AcceleratorConfig, read: Callable[[int, int], Sequence[int]]
) -> dict[str, np.ndarray]:
    """``taught`` and ``taught_count`` out of the memory PROTOTYPES, the opposite of `prototype_image`; places
    not in use are 0. ``read(first, count)`` returns ``count`` words of it."""
    rule, width, steps = config.readout_rule, config.trajectory_width, config.windows.steps
    places, words = rule.prototypes + rule.taught, prototype_words(config)
    counts = np.array(read(words, config.classes), dtype=np.int64)
    taught = np.zeros((config.classes, rule.taught, steps, width), dtype=np.int64)
    sign = 1 << rule.state_code_bits - 1
    for label, count in enumerate(np.minimum(counts, rule.taught).tolist()):
        for k in range(steps if count else 0):
            first = k * (1 + config.classes * places) + 1 + label * places + rule.prototypes
            codes = np.array(read(first * width, count * width)).reshape(count, width)
            taught[label, :count, k] = (codes % (2 * sign) ^ sign) - sign  # parity left out
    return {"taught": taught, "taught_count": counts}


def prototype_image(config: AcceleratorConfig, arrays: Arrays) -> Images:
    """The memory PROTOTYPES, where there is one: the codes of `prototype_words`, then ``taught_count``."""
    if not config.has_prototypes:
        return {}
    stored, counts = arrays["prototypes"], []
    if config.readout_rule.taught:
        stored = np.concatenate([stored, arrays["taught"]], axis=1)
        counts = arrays["taught_count"].tolist()
    codes = np.moveaxis(stored.reshape(-1, *stored.shape[2:]), 1, 0)  # (K, places, values)
    own = codes[:, : int(bool(counts))] * 0
    codes = np.concatenate([own, codes], axis=1) & (1 << config.readout_rule.state_code_bits) - 1
    words = codes.ravel().tolist()
    if config.hardware.checksum:
        words = [word | (word.bit_count() & 1) << config.readout_rule.state_code_bits for word in words]
    return {Memory.PROTOTYPES: words + counts}


def image_memories(plan: ImagePlan, arrays: Arrays) -> Images:
    """Contents of every memory of a design for images, by MEMORY_SELECT value."""
    conv = [word for pass_ in plan.passes if not pass_.dense for word in plan.packed(pass_, arrays)]
    dense, biases = plan.dense_weights(arrays), plan.addends(arrays)
    return {
        **{column: [word >> 16 * column & 0xFFFF for word in conv] for column in range(plan.columns)},
        ImageMemory.BIASES: [with_parity(word, BIAS_WORD_BITS) for word in biases]
        if plan.checksum
        else biases,
        ImageMemory.PASSES: checked_program(plan, arrays) if plan.checksum else plan.program(),
        ImageMemory.DENSE_LOW: [word & 0xFFFF for word in dense],
        ImageMemory.DENSE_HIGH: [word >> 16 for word in dense],
    }


def memory_name(config: AcceleratorConfig, select: int) -> str:
    """Base name of the files of a memory."""
    if config.is_image:
        return f"weights{select}" if select < plan_of(config).columns else ImageMemory(select).name.lower()
    return f"lane{select}" if select < Memory.ADDENDS else Memory(select).name.lower()


def mean_places(config: AcceleratorConfig) -> list[int]:
    """Each mean's place in the memory MEANS, in the order of the array: (lengths) or (lengths, constants).

    Length, kind and taxel have bits of their own in it, in this order from the lowest on.
    """
    lengths = len(config.window_lengths)
    length_bits, kind_bits = (lengths - 1).bit_length(), (config.kinds - 1).bit_length()

    def of(constant: int) -> int:
        taxel, kind = divmod(constant, config.kinds)
        return kind << length_bits | taxel << length_bits + kind_bits

    return [q | of(constant) for q in range(lengths) for constant in range(config.constants)]


def mean_count(config: AcceleratorConfig) -> int:
    """Words of the memory MEANS."""
    return max(mean_places(config)) + 1


def memory_words(config: AcceleratorConfig) -> dict[int, int]:
    """Words of every memory that the host loads, by MEMORY_SELECT value."""
    if config.is_image:
        images = plan_of(config)
        return dict.fromkeys(range(images.columns), images.conv_words) | {
            ImageMemory.BIASES: images.addend_words,
            ImageMemory.PASSES: images.program_words,
            ImageMemory.DENSE_LOW: images.dense_words,
            ImageMemory.DENSE_HIGH: images.dense_words,
        }
    if config.is_forest:
        scales = max(scale_places(config)) + 1
        return {Memory.CONSTANTS: scales, Memory.MEANS: mean_count(config), Memory.NODES: config.forest.nodes}
    plan = schedule(config)
    words: dict[int, int] = dict.fromkeys(range(config.hardware.lanes), plan.weight_depth) | {
        Memory.ADDENDS: plan.addend_words,
        Memory.CONSTANTS: Layout(config, plan.program).constant_words,
        Memory.MEANS: mean_count(config),
    }
    if config.has_prototypes:
        counts = config.classes if config.readout_rule.taught else 0
        words[Memory.PROTOTYPES] = prototype_words(config) + counts
    return words


def words_per_entry(config: AcceleratorConfig, select: int) -> int:
    """16-bit words of one entry of a memory, low word first."""
    if config.is_image:
        return 2 if select == ImageMemory.BIASES else 1
    words: dict[int, int] = {Memory.MEANS: config.mean_words}
    if config.is_forest:  # a power of two, so that the host's address needs no division
        words[Memory.NODES] = 1 << (node_words(config) - 1).bit_length()
    else:
        words[Memory.ADDENDS] = config.addend_parts
    return words.get(select, 1)


def load_words(config: AcceleratorConfig) -> int:
    """16-bit words of the largest memory that the host loads."""
    return max(count * words_per_entry(config, select) for select, count in memory_words(config).items())


def load_writes(config: AcceleratorConfig, arrays: Arrays) -> list[tuple[int, int]]:
    """The (register, 16-bit word) writes that load an integer model over the bus, masked taxels included."""
    writes: list[tuple[int, int]] = []
    for select, words in memory_images(config, arrays).items():
        halves = words_per_entry(config, select)
        writes.append((Register.MEMORY_SELECT, int(select)))
        writes += [
            (Register.MEMORY_DATA, word >> 16 * half & 0xFFFF) for word in words for half in range(halves)
        ]
    writes += [(Register.MASK + k, word) for k, word in enumerate(mask_words(config))]
    return writes


def mapped(config: AcceleratorConfig) -> list[int]:
    """Addresses that the design has a register at."""
    several = [Register.MASK, *[Register.TAXEL_FAULTS] * bool(config.faults.fault_frames)]
    single = [int(register) for register in Register if register < Register.MASK]
    words = [first + k for first in several for k in range(len(mask_words(config)))]
    return [*single, *words, *map(int, teach_registers(config))]


def teach_registers(config: AcceleratorConfig) -> list[TeachRegister]:
    """Registers of `mapped` that a taught readout has."""
    return list(TeachRegister) if config.readout_rule.taught else []


def interface_registers(config: AcceleratorConfig) -> list[InterfaceRegister]:
    """Registers that the design has beside `mapped`."""
    interface, register = config.interface, InterfaceRegister
    registers = [register.POSITION, register.POSITION_PEAK, register.POSITIONS] if interface.position else []
    if interface.converter.name != "none":
        registers += [register.CONVERTER_FAULTS, *[register.FRAMES] * interface.send_frames]
    if interface.converter.name != "none" and interface.stimulator != "none":
        registers += [row for row in register if row >= register.STIM_AMPLITUDE]
    return registers


def mask_words(config: AcceleratorConfig) -> list[int]:
    """The registers from MASK on as the configuration has them: 16 taxels a word, bit set = taxel out of
    use."""
    words = [0] * -(-config.sensor.taxels // 16)
    for taxel in config.sensor.masked_taxels:
        words[taxel // 16] |= 1 << taxel % 16
    return words
