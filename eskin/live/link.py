"""The host's side of the serial link (docs/specification_interfaces.md, section 9): packets, numbering, sending again,
playing a recording.

Plain Python over anything that reads and writes bytes, so that a board and a simulation run the same code.
"""

import binascii
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from eskin.cosim.scoreboard import read_behind

FLIP = 0x20
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
ESCAPED = re.compile(rb"\x7d(.)", re.DOTALL)
READ, FRAME = 0x80, 0x40
"""Commands; a write has neither bit. The low 6 bits are the register's address."""
REACH, WINDOW = 0x40, 0x3C
"""Registers from REACH on teach, 0x48 to 0x4B: packets name them WINDOW to WINDOW + 3."""
NO_WORD, NUMBER_AT = 0xFFFF, 9
"""The value of register PLACES for no word, and the first bit of the word's number."""
NUMBERS = 128
"""Decisions are numbered modulo this; the bit above tells an unsure one."""
FRAME_NUMBERS = 1 << 16
"""Frames of a sensor are numbered modulo this."""
ANSWER_BYTES = 7
"""Bytes of a packet from the device, check sequence included."""
DECISION = 1 << 31
"""Bit of a device packet's payload; the others belong to the decision, or to an answer."""
CYCLES_A_BYTE_MIN = 40
"""Clocks of a byte at the fastest rate a device is built for."""
FRAMES = 4096
"""Frames of a board's sensor that wait for their reader."""
CHATTER = 4096
"""Bytes without the answer in them, after which it is asked for again."""
TRIES = 10
"""Of everything that can fail, before LinkError."""
BURST = 64
"""Packets sent before the device is asked what it took; below 128, so that half of the 256 numbers is never
under way."""


class LinkError(RuntimeError):
    """The device does not answer as it should; one sentence that says what to look at."""


class Transport(Protocol):
    """Bytes to and from a device."""

    def write(self, data: bytes) -> None:
        """Send all of ``data``."""

    def read(self, timeout_s: float) -> bytes:
        """Received bytes; waits for the first byte, at most ``timeout_s``. Empty if none came."""


# -------------------------------------------------------------------- packets
def seal(body: bytes) -> bytes:
    """``body`` and its CRC-16/IBM-SDLC (X-25): the frame check sequence of RFC 1662, bits of a byte lowest first."""
    upside_down = binascii.crc_hqx(body.translate(REVERSED), 0xFFFF)
    return body + (int(f"{upside_down:016b}"[::-1], 2) ^ 0xFFFF).to_bytes(2, "little")


def pack(body: bytes) -> bytes:
    """``body`` as it goes over the line: flag, stuffed body and check sequence, flag."""
    stuffed = seal(body).replace(b"\x7d", b"\x7d\x5d").replace(b"\x7e", b"\x7d\x5e")
    return b"\x7e" + stuffed + b"\x7e"


class Unpacker:
    """Bodies out of bytes, however they come in pieces.

    damaged: packets dropped so far because an escape or a check sequence was wrong.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._unfinished = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The bodies (check sequence taken off) of the packets that ``data`` completes; damaged ones are
        dropped and counted."""
        *ended, self._unfinished = (self._unfinished + data).split(b"\x7e")
        bodies = []
        for stuffed in filter(None, ended):
            sealed = ESCAPED.sub(lambda escaped: bytes([escaped[1][0] ^ FLIP]), stuffed)
            if stuffed.endswith(b"\x7d") or len(sealed) < 3 or seal(sealed[:-2]) != sealed:
                self.damaged += 1
            else:
                bodies.append(sealed[:-2])
        return bodies


Packet = tuple[int, Sequence[int] | np.ndarray]
"""Command and words of a write or a frame."""
Progress = Callable[[int], None]
"""Called with the frames taken so far."""


def ordered_packet(number: int, command: int, words: Sequence[int] | np.ndarray) -> bytes:
    """A write or a frame: ``words`` are 16-bit codes. Behind a long one, flags fill the line until the device
    is through with it."""
    body = bytes([number & 0xFF, command]) + np.asarray(words).astype("<u2").tobytes()
    fill = max(0, -(-(len(words) + 8) // CYCLES_A_BYTE_MIN) - 1)
    return pack(body) + b"\x7e" * fill


def link_address(address: int) -> int:
    """Address of the register at ``address`` in a packet."""
    return address if address < REACH else WINDOW | address & 3


def read_packet(address: int) -> bytes:
    """A read; its number and its word have no meaning."""
    return pack(bytes([0, READ | address, 0, 0]))


class Answer(NamedTuple):
    """Answer to a read: the register's value, the number of the write or frame for which the device waits,
    decisions sent so far (mod 128)."""

    address: int
    value: int
    expected: int
    decisions: int


class Decision(NamedTuple):
    """decisions: sent before it, mod 128, counted since the device's reset. payload: 32 bits as on the accelerator's
    output."""

    decisions: int
    payload: int


class SensorFrame(NamedTuple):
    """A frame of a board's own sensor. number: of those that were due, mod 65536. words: of its samples."""

    number: int
    words: np.ndarray


def parse(body: bytes) -> Answer | Decision | SensorFrame | None:
    """A packet from the device; None: not one of its lengths."""
    if len(body) % 2 == 0:
        number, *_ = words = np.frombuffer(body, dtype="<u2")
        return SensorFrame(int(number), words[1:])
    if len(body) != ANSWER_BYTES - 2:
        return None
    payload = int.from_bytes(body[1:], "little")
    if payload & DECISION:
        return Decision(body[0] % NUMBERS, payload ^ DECISION | body[0] // NUMBERS << 31)
    return Answer(payload >> 24, payload & 0xFFFF, payload >> 16 & 0xFF, body[0] % NUMBERS)


# -------------------------------------------------------------------- the conversation
class Played(NamedTuple):
    """A recording as the device decided it. decisions: 32-bit payloads in order. looks: STATUS on the way, as of
    `eskin.cosim.scoreboard.Scoreboard.look`. registers: those at the end."""

    decisions: list[int]
    looks: dict[str, int]
    registers: dict[str, int]


class Link:
    """One device behind a transport.

    Writes and frames are numbered and sent again until the device has taken each once, in order. A recording
    some of whose decisions got lost on the way back is played again.

    Parameters
    ----------
    register_map:
        ``registers`` (name -> address), ``bits`` (register -> name -> bit), ``behind``, ``id``, ``version``,
        ``versions`` that can be read: as in registers.json.
    timeout_s:
        To wait for an answer before the question is asked again.

    Attributes
    ----------
    decisions: payloads of the present recording's that have come so far. frames: the
    sensor's, the latest `FRAMES`. lost: one of them got lost on the way. repeated:
    packets sent again. replayed: recordings played again. unanswered: questions asked again. map: ``register_map``, of the
    device's version.
    """

    def __init__(self, transport: Transport, register_map: Mapping, *, timeout_s: float = 0.5) -> None:
        self._transport, self._timeout, self.map = transport, timeout_s, dict(register_map)
        self._registers, self._bits = register_map["registers"], register_map["bits"]
        self._unpacker, self._burst = Unpacker(), BURST
        # number of the next write or frame; decisions received, as the device numbers them
        self._next = self._seen = 0
        self.frames = deque[SensorFrame](maxlen=FRAMES)
        self.lost, self.decisions, self.looks = False, list[int](), dict[str, int]()
        self.repeated = self.replayed = self.unanswered = 0

    @property
    def damaged(self) -> int:
        """Packets from the device that arrived damaged."""
        return self._unpacker.damaged

    def connect(self) -> None:
        """Synchronise with the device and check its identity.

        Raises
        ------
        LinkError
            No answer; another ID or version than the register map's.
        """
        answer, known = self._ask("ID"), self.map
        if answer.value != known["id"]:
            raise LinkError(
                f"the device's ID register reads 0x{answer.value:04x}, not 0x{known['id']:04x}: load a bitstream of "
                "'eskin build' into it"
            )
        self._next = answer.expected
        version = self.read("VERSION")
        if version not in known["versions"]:
            raise LinkError(
                f"the device has register map version {version} and this program has {known['version']}: build its "
                "bitstream anew"
            )
        known["version"] = version

    def read(self, register: str, offset: int = 0) -> int:
        """The value of a register, or of the address ``offset`` behind it."""
        return self._ask(register, offset).value

    def write(self, writes: Sequence[tuple[int, int]]) -> None:
        """(address, word) writes, each carried out once and in order."""
        self._send([(link_address(address), (word,)) for address, word in writes])

    def places(self, first: int, count: int) -> list[int]:
        """Words of the memory of prototypes from ``first`` on, a question each, while no touch is open.

        A question that is asked again takes a word twice, so each word brings its number.

        Raises
        ------
        LinkError
            As of `read`; touches come all the time.
        """
        words: list[int] = []
        for _ in range(TRIES):
            self.write([(self._registers["PLACES"], first + len(words))])
            while len(words) < count:
                word = self.read("PLACES")
                if word == NO_WORD or word >> NUMBER_AT != (first + len(words)) % (1 << 16 - NUMBER_AT):
                    break
                words.append(word % (1 << NUMBER_AT))
            else:
                return words
        raise LinkError(
            "the device does not give its prototypes: wait until no touch is open, and see that its bitstream "
            "is this model's"
        )

    def load(self, writes: Sequence[tuple[int, int]]) -> None:
        """Abort the current operation of the device and load an integer model, given as (address, word)
        writes."""
        self._command("ARM", "CLEAR_FAULTS")
        self.write([*writes, (self._registers["MEASURE"], self.map["measures"]["STEP"])])

    def play(
        self, frames: np.ndarray, progress: Progress = lambda frames_done: None, look: int = 0
    ) -> Played:
        """Play one recording.

        Parameters
        ----------
        frames:
            (frames, taxels) A/D codes; two's complement where negative.
        progress:
            Called with the frames taken so far.
        look:
            Frames behind which STATUS is read, too; 0: none.

        Raises
        ------
        LinkError
            The device stops answering, takes no frames, or decisions get lost time and again.
        """
        for _ in range(TRIES):
            self.begin()
            if look:
                self.feed(frames[:look], progress)
                self.looks["TOUCH"] = self.settle().value
            self.feed(frames[look:], lambda done: progress(look + done))
            played = self.end()
            if not self.lost:
                return played
            self.replayed += 1
        raise LinkError(
            f"decisions of a recording got lost {TRIES} times in a row: use a better cable or a lower "
            "baud rate"
        )

    def begin(self) -> None:
        """Arm: frames that are fed from now on are a new recording."""
        self._command("CLEAR_FAULTS")  # before ARM, which may raise none
        self._command("ARM")
        answer = self.settle()
        # what came before this answer was offered before `arm` took hold: it belongs to the recording before
        self._seen, self.lost, self.decisions = answer.decisions, False, []
        self.looks = {"ARM": answer.value}

    def feed(self, frames: np.ndarray, progress: Progress = lambda done: None) -> None:
        """The recording's next frames (frames, taxels); returns when the device has accepted them."""
        self._send([(FRAME, frame) for frame in (np.asarray(frames) & 0xFFFF).astype(np.uint16)], progress)

    def end(self) -> Played:
        """Finish the recording; its decisions are whole unless ``lost``."""
        self._command("FINISH")
        self.settle()
        return Played(self.decisions, self.looks, read_behind(self.map, self.read))

    def listen(self, timeout_s: float) -> list[int]:
        """Decisions (32-bit payloads) that a device sends unasked; waits at most ``timeout_s`` for the first
        byte."""
        self.decisions = []
        self._noted(self._transport.read(timeout_s))
        return self.decisions

    def _command(self, *names: str) -> None:
        self.write([(self._registers["CONTROL"], sum(self._bits["CONTROL"][name] for name in names))])

    def settle(self) -> Answer:
        """The answer that the device is idle."""
        for _ in range(100 * TRIES):
            answer = self._ask("STATUS")
            if not answer.value & self._bits["STATUS"]["BUSY"]:
                return answer
        raise LinkError("the device stays busy and does not come to an end: reset it")

    def _send(self, packets: Sequence[Packet], progress: Progress = lambda done: None) -> None:
        sent = idle = 0
        while sent < len(packets):
            batch = packets[sent : sent + self._burst]
            self._transport.write(
                b"".join(ordered_packet(self._next + k, *packet) for k, packet in enumerate(batch))
            )
            accepted = self._taken(len(batch))
            sent, self._next = sent + accepted, self._next + accepted & 0xFF
            self.repeated += len(batch) - accepted
            idle = 0 if accepted else idle + 1
            if idle >= TRIES:
                raise LinkError(
                    "the device answers but takes no frames: its bitstream is for another number of taxels"
                    if batch[0][0] == FRAME
                    else "the device answers but takes no writes: the line towards it damages packets; "
                    "lower the baud rate"
                )
            if idle:
                # While a device still answers an earlier request, it drops every packet. A host that takes this
                # answer for the answer to its next request stays one request ahead, and each further packet
                # arrives during an answer: wait until the line is silent.
                deque(self._answers(), 0)
            # Where packets get lost, fewer go at a time: less is lost with one, and a device that is not
            # ready in time gets a rest.
            self._burst = max(1, self._burst // 2) if accepted < len(batch) else min(2 * self._burst, BURST)
            progress(sent)

    def _taken(self, sent: int) -> int:
        """Number of the ``sent`` packets from ``_next`` on that the device has taken."""
        for _ in range(TRIES):
            accepted = self._ask("STATUS").expected - self._next & 0xFF
            if accepted <= sent:
                return accepted
            # An answer to an earlier question, late, names fewer than were taken already; the next one is not
            # late.
        raise LinkError(
            "the device's packet count differs from the packets sent: it was reset, or another program uses its port"
        )

    def _ask(self, register: str, offset: int = 0) -> Answer:
        address = link_address(self._registers[register] + offset)
        for _ in range(TRIES):
            self._noted(self._transport.read(0))  # answers to earlier questions are too late now
            self._transport.write(read_packet(address))
            for answer in self._answers():
                if answer.address == address:
                    return answer
            self.unanswered += 1
        raise LinkError(
            "the device does not answer: check port, cable, baud rate, and that a bitstream of 'eskin "
            "build' is loaded"
        )

    def _answers(self) -> Iterator[Answer]:
        """Answers as they come, until the line is silent or does nothing but chatter."""
        heard = 0
        while heard < CHATTER and (data := self._transport.read(self._timeout)):
            heard += len(data)
            yield from self._noted(data)

    def _noted(self, data: bytes) -> list[Answer]:
        """Answers in what has come; decisions are noted on the way."""
        answers = []
        for message in map(parse, self._unpacker.feed(data)):
            if isinstance(message, SensorFrame):
                self.frames.append(message)
            if message is None or isinstance(message, SensorFrame):
                continue
            self.lost |= message.decisions != self._seen % NUMBERS
            self._seen = message.decisions
            if isinstance(message, Answer):
                answers.append(message)
            else:
                self._seen += 1
                self.decisions.append(message.payload)
        return answers
