"""Readable Verilog from Yosys' text: an expression that is used once is written where it is used, and
remaining wires have names.

Yosys gives each operation of a design a wire, ``_012_``. One that is used once becomes the
expression that it stands for. In braces, or in parentheses where those mean the same, its width does not
depend on the text around it; where they could not give it the wire's own width it stays a wire.
"""

import re
from collections import Counter
from itertools import chain, count

NAME = r"(?:\\\S+ |[A-Za-z_]\w*\b)"
LONGEST = 110
"""Characters of an expression that goes into another line."""
_OPERAND = rf"(?:{NAME}(?: ?\[\d+(?::\d+)?\])?|\d+'[hbd][0-9a-f]+)"
_ASSIGN = re.compile(r"^  assign (_\d+_) = (.*);$", re.MULTILINE)
_DECLARED = re.compile(
    rf"^  (?:wire|reg|input|output) (signed )?(?:\[(\d+):(\d+)\] )?({NAME}) ?(?:= .*)?;$", re.MULTILINE
)
_WIRED = re.compile(r"(?m)^    connect (\\port\$\d+\$\d+) (\\\S+)(?: \[([\d:]+)\])?$")
_FORMS = (
    (re.compile(rf"({_OPERAND}) ?(?:[&|^]) ?({_OPERAND})"), "wide", "({})"),
    (re.compile(rf"({_OPERAND}) ?(?:[-+]|~\^) ?({_OPERAND})"), "wide", "{{{}}}"),
    (re.compile(rf"~ ?({_OPERAND})"), "wide", "{{{}}}"),
    (re.compile(rf"{_OPERAND} ?\? ({_OPERAND}) : ({_OPERAND})"), "wide", "({})"),
    (re.compile(rf"{_OPERAND} ?(?:===?|!==?|&&|\|\||<|>|<=|>=) ?{_OPERAND}"), "one", "({})"),
    (re.compile(rf"[&|^!] ?{_OPERAND}"), "one", "({})"),
)
"""Expressions that may go into others: how wide they are by themselves, and how they stand there."""


def readable(text: str) -> str:
    """``text`` of whole modules, with the same function."""
    modules = re.split(r"(?m)^(?=module )", text)
    return "".join(_wires_named(_wires_named(_inlined(module))) for module in modules)


def _inlined(text: str) -> str:
    declared = _DECLARED.findall(text)
    widths = {name.strip(): int(high or 0) - int(low or 0) + 1 for _, high, low, name in declared}
    signed = {name.strip() for sign, _, _, name in declared if sign}

    def width(operand: str) -> int:
        """Bits; 0 where it does not say."""
        if constant := re.match(r"(\d+)'", operand):
            return int(constant[1])
        ((name, high, low),) = re.findall(rf"^({NAME})(?: ?\[(\d+)(?::(\d+))?\])?$", operand)
        return int(high) - int(low or high) + 1 if high else widths.get(name.strip(), 0)

    made = dict(_ASSIGN.findall(text))
    uses = Counter(re.findall(r"\b_\d+_(?! ?\[)\b", text))
    picked = set(re.findall(r"\b(_\d+_) ?\[", text))
    inside: dict[str, str] = {}
    for name, value in made.items():
        if name in picked or name in signed or uses[name] != 3:  # its declaration, its value, its use
            continue
        for form, kind, around in _FORMS:
            if found := form.fullmatch(value):
                bits = [width(operand) for operand in found.groups()]
                whole = {operand.strip() for operand in re.findall(rf"{NAME}(?! ?\[)", value)}
                if kind == "wide" and whole & signed:
                    around = "{{{}}}"  # which is unsigned, as the wire is
                if widths.get(name) == (1 if kind == "one" else max(bits) if all(bits) else None):
                    inside[name] = around.format(value)
                break
    if not inside:
        return text

    def spelt(value: str, room: int) -> str:
        """``value`` with its operands in place; an operand that does not fit stays a wire."""

        def put(found: re.Match) -> str:
            name = found[0]
            if name not in inside:
                return name
            whole = spelt(inside[name], room)
            if len(whole) > room:
                return name
            gone.add(name)
            return whole

        return re.sub(r"\b_\d+_\b", put, value)

    gone: set[str] = set()
    out = []
    for line in text.split("\n"):
        assigned = _ASSIGN.match(line)
        begin = line.index("=") + 1 if assigned else 0
        declares = _DECLARED.match(line)
        out.append(line if declares else line[:begin] + spelt(line[begin:], LONGEST))
    lines = [
        line
        for line in out
        if not (
            (own := _ASSIGN.match(line) or re.match(r"  wire (?:\[\d+:0\] )?(_\d+_);$", line))
            and own[1] in gone
        )
    ]
    return "\n".join(lines)


_SIGNAL = r"([A-Za-z]\w*|[A-Za-z_]\w*[A-Za-z]\w*)(?: ?\[\d+(?::\d+)?\])?"
_CALLED = (
    (re.compile(rf"(?m)^ +{_SIGNAL} <= (_\d+_);$"), "{0}_next", 2),
    (re.compile(rf"(?m)^  assign (_\d+_) = {_SIGNAL} == \d+'h0*(\w+);$"), "{0}_is_{1}", 1),
    (re.compile(rf"(?m)^  assign (_\d+_) = {_SIGNAL} & {_SIGNAL};$"), "{0}_and_{1}", 1),
    (re.compile(rf"(?m)^  assign (_\d+_) = {_SIGNAL} \| {_SIGNAL};$"), "{0}_or_{1}", 1),
    (re.compile(rf"(?m)^  assign (_\d+_) = \{{?~ {_SIGNAL}\}}?;$"), "not_{0}", 1),
    (re.compile(rf"(?m)^  assign (_\d+_) = (?:\$signed\()?{_SIGNAL}\)? [-+] .*;$"), "{0}_sum", 1),
    (re.compile(rf"(?m)^  assign (_\d+_) = \| \{{ {_SIGNAL}\W.*;$"), "any_{0}", 1),
    (re.compile(rf"(?m)^  assign (_\d+_) = {_SIGNAL} \? .*;$"), "if_{0}", 1),
    (re.compile(r"(?m)^  assign (_\d+_) = \$signed\((\w+)\) \* \$signed\((\w+)\);$"), "{0}_times_{1}", 1),
    (re.compile(r"(?m)^  assign (_\d+_) = .*?(?<![\w'$])\\?([A-Za-z]\w*).*;$"), "of_{0}", 1),
)
"""Lines that declare a wire, the name that it gets, and the group of the line that is the wire."""


def _wires_named(text: str) -> str:
    """Remaining wires are named after the register that takes them or after their operands."""
    used, names = set(re.findall(NAME, text)), {}
    for line, name, place in _CALLED:
        for found in line.finditer(text):
            parts = [part for number, part in enumerate(found.groups(), 1) if number != place]
            called = name.format(*parts)
            if found[place] not in names:
                names[found[place]] = _free(called, used)
    return re.sub(r"\b_\d+_\b", lambda found: names.get(found[0], found[0]), text)


def _free(name: str, used: set[str]) -> str:
    """``name``, with a number where it is taken; it is taken then."""
    chosen = next(free for free in chain([name], (f"{name}_{n}" for n in count(2))) if free not in used)
    used.add(chosen)
    return chosen


def ports_named(rtlil: str) -> str:
    """``rtlil`` whose ports without a name in Amaranth take the name of the signal that is wired to them outside."""
    used, names = set(re.findall(r"\\\S+", rtlil)), {}
    for port, signal, place in _WIRED.findall(rtlil):
        if port not in names and not signal.startswith("\\port$"):
            plain = re.sub(r"\W+", "_", f"{signal[1:]} {place}".strip()).strip("_")
            names[port] = _free(f"\\{plain}", used)
    return re.sub(r"\\port\$\d+\$\d+", lambda found: names.get(found[0], found[0]), rtlil)
