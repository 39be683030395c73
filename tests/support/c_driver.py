"""The C driver of a generated folder in this process, and recordings through it."""

import ctypes
import subprocess

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
FIELDS = ("cls", "step", "margin", "global_", "partial", "unsure")
READ = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p, ctypes.c_uint32)
WRITE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32)


class Handle(ctypes.Structure):
    _fields_ = [
        ("base", ctypes.c_void_p),
        ("read", READ),
        ("write", WRITE),
        ("context", ctypes.c_void_p),
        ("next", ctypes.c_uint32),
    ]


class Decision(ctypes.Structure):
    _fields_ = [(name, ctypes.c_uint16 if name == "margin" else ctypes.c_uint8) for name in FIELDS]


class Driver:
    """``driver("arm")`` calls eskin_hw_arm; ``read(offset)`` and ``write(offset, word)`` are where its accesses go."""

    def __init__(self, folder, read, write):
        library = folder / "eskin.so"
        subprocess.run(["gcc", *STRICT, "-shared", "-fPIC", "eskin.c", "-o", library], cwd=folder, check=True)
        self._library = ctypes.CDLL(str(library))
        self._handle = Handle(
            None,
            READ(lambda context, offset: read(offset)),
            WRITE(lambda context, offset, word: write(offset, word)),
            None,
            0,
        )
        words = [int(line, 16) for line in (folder / "load.hex").read_text().split()]
        self._load = (ctypes.c_uint32 * len(words))(*words)
        self.refused = 0

    def __call__(self, name, *arguments):
        return getattr(self._library, f"eskin_hw_{name}")(ctypes.byref(self._handle), *arguments)

    def load(self):
        return self("load", self._load, len(self._load))

    def decisions(self):
        """Those that wait, as words."""
        decision, words = Decision(), []
        while self("decision", ctypes.byref(decision)):
            place = zip((0, 7, 15, 29, 30, 31), FIELDS, strict=True)
            words.append(sum(getattr(decision, name) << low for low, name in place))
        return words

    def frame(self, frame, pairs=False):
        """Give a frame; decisions that had to be taken before it went in."""
        codes, words = [int(code) & 0xFFFF for code in frame] + [0xABCD] * (len(frame) % 2), []
        codes = (ctypes.c_uint16 * len(codes))(*codes)
        while not self("frame_pairs" if pairs else "frame", codes):
            self.refused += 1
            words += self.decisions()
        return words

    def play(self, frames, asks=lambda: True, pairs=False):
        """Decisions of a recording; taken where ``asks`` says so, and where the device takes no more frames.
        ``pairs``: a frame lies as SAMPLE_PAIR takes it."""
        words = []
        self("arm")
        for frame in frames:
            words += self.frame(frame, pairs)
            if asks():
                words += self.decisions()
        self("finish")
        while self("busy"):
            words += self.decisions()
        return words + self.decisions()
