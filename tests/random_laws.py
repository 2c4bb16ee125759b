"""Laws at random: Python's text, of what has fooled the tracer before.

A law takes six numbers and returns some. Helpers of it write into what they get, under
conditions, and return what they got, parts of it or something new. Names share arrays.
"""

import linecache
import math
from types import SimpleNamespace

import numpy as np

# The forms of each kind: s, v, b are a number, a vector of three, a yes or no; s0, v0,
# b0 the same without depth; do is a statement, which may hold more of them. i is an
# index, k a number that is known, f a helper, S and V are names.
_GRAMMAR = """
=i 0|1|2
=k 0.0|1.0|2|-1|0.3|-0.6|0.5|3.0
=S first|second|third
=V u|v|w
=s0 {k}|{S}|{S}
=v0 {V}
=b0 first > 0.2
=one u|u[::-1]|v|1 * u|w|kept[1]
=other u|w|np.zeros(3)|v - limit|kept[0]
=s {k}|x[{i}]|x[{i} + 3]|{v}[{i}]|{v}[-1]|({s} + {s})|({s} - {s})|{s} * {s}|-{s}
abs({s})|{s} / (1.5 + abs({s}))|{s} / (0.3 + {s} ** 2)
min({s}, {s})|max({s}, {s}, {k})|np.minimum({s}, {s})|np.clip({s}, -0.4, {s})
math.sin({s})|np.tanh({s})|math.atan2({s}, 0.1 + abs({s}))|np.cos({s})|np.floor({s})
int({s}) * 1.0|np.where({b}, {s}, {s})|int({s}) / 2|np.arctan({s})
({s} if {b} else {s})|float({b})|{v}.sum()|{v}.max()|{v} @ {v}
np.dot({v}, {v})|np.linalg.norm({v})
sum({v})|max({v})|TABLE[int(min(abs({s}), 3.0))]|sum(items)|items[-1]
pair[{i} % 2]|np.sum({v} > {s})|any(y > {k} for y in {v})|len(items)
sum(y * {k} for y in {v} if y > {s})|abs({s}) ** 0.5|{s} ** 2|abs({s}) ** 1.5|note.last
notes["a"]|notes.get("b", {k})|TABLE[np.searchsorted(STARTS, {s})]
bool({s}) * {k}|({b}) * {s}|math.exp(-abs({s}))
(lambda y, scale={k}: y * scale)({s})|{s} or {k}
np.float64({s}) - {k}
=v x[:3]|x[3:]|x[::2]|x[::-2]|np.array([{s}, {s}, {s}])|({v} + {v})|({v} - {s})
{s} * {v}|{v} * {v}|-{v}|{v}[::-1]|np.where({v} > {s}, {v}, {v})|np.where({b}, {v}, {s})
np.clip({v}, -0.5, {s})|np.cross({v}, {v})|abs({v})
{v}.copy()|np.concatenate(({v}[:1], {v}[1:]))
np.maximum({v}, {s})|np.minimum({v}, {v})|np.diag({v}) @ {v}|np.outer({v}, {v})[{i}]
np.linalg.solve(np.outer({v}, {v}) + 3 * EYE, {v})|np.stack(({v}, {v}), axis=1)[:, 0]
np.stack([{v}, {v}]).T[:, 1]|np.stack([{v}, {v}]).sum(axis=0)|{f}({v}, {s})|np.sin({v})
np.array([y + {s} for y in {v}])|np.array([*{v}[:2], {s}])|({v} if {b} else {v})
np.zeros_like({v})|np.array(items[:3]) * {s}|np.hstack(({v}[1:], {s}))
({v} > {s}) * {v}|np.append({v}[:2], {s})
np.asarray({v})|{v}.reshape(3, 1)[:, 0]|np.array(sorted({v}))|np.ravel({v})
np.abs({v}) ** {k}|np.linalg.inv(np.outer({v}, {v}) + EYE)[{i}]|EYE[{i}]
TABLE[1:]
=b {s} > {s}|{s} <= {k}|{k} < {s} < 0.8|not {b}|({b} and {b})|({b} or {b})|{v}.any()
np.all({v} > {s})|np.any({v} < {k})|({s} > {k}) & ({s} > {k})
np.logical_or({b}, {s} > 0)|bool({s} > {k})|all(y > {k} for y in {v})
{k} >= {s} or {b}|len(items) > 4|{v}[0] == {v}[-1]|{s} != 0.0
=do {S} = {s}|{V} = {v}|{V} = {V}|{V} = {V}[::-1]|{S} += {s}|{V} += {v}|{V} *= {s}
{V}[{i}] = {s}|{V}[:2] -= {s}|{V}[{V} > {s}] = {s}|{V}[{i}], {V}[0] = {s}, {s}
{S}, {V} = {s}, {v}|{V}[1:] = {V}[:2]|items.append({s})|items[{i}] = {s}|items = [*{v}]
{S}, pair = pair[0], ({s}, {s})|note.last = {s}|notes["a"] = {s}|notes["b"] = {s}
pair = ({S}, {s})|{f}({V}, {s})|{S}, {S} = {S}, {S}|np.multiply({V}, {s}, out={V})
if {b}:{do}|if {b}:{do}else:{do}|if {b}:{do}elif {b}:{do}else:{do}|kept = [{V}, {V}]
for {S} in {v}:{do}|for i in range({i} + 1):{do}|for {S} in items[:3]:{do}
for j, {S} in enumerate({v}):{do}{V}[j] = {S}|for {S}, last in zip({v}, {V}):{do}
kept[{i} % 2][{i}] = {s}|kept[0], kept[1] = kept[1], kept[0]|{V} = kept[{i} % 2]
{V}.fill({s})|{V}[:] = {v}|items.sort()|items.reverse()|del items[3:]
{V}[np.array([2, 0])] = {v}[:2]|{V} = np.asarray({V})|{V}[{V} < {k}] *= {k}
"""
_HELPER = """
def {name}(u, limit):
    first, second, third, v, w = limit, 0.5, u[0], u, 2.0 * u
    items, pair, kept = [0.5, limit, *u], (limit, 1.0), [u, w]
    note, notes, x = SimpleNamespace(last=limit), {{"a": limit}}, np.hstack((u, w))
{body}    if {condition}:
        return {one}
{more}    return {other}
"""
_LAW = """
def law(x):
    u, v, w = x[:3], 1.0 * x[3:], np.zeros(3)
    first, second, third, items = x[0], 0.0, x[1] * x[2], [0.5, x[1], -1.0, x[4]]
    pair, kept = (x[0], x[1]), [v, w]
    note, notes = SimpleNamespace(last=0.1), {{"a": 2}}
{body}    return np.array([first, second, third, *u, *v, *w, sum(items), len(items),
        *pair, note.last, notes["a"], len(notes), *kept[0], *x])
"""
_FORMS = {
    kind: forms.strip().replace("\n", "|").split("|")
    for kind, forms in (x.split(" ", 1) for x in _GRAMMAR[2:].split("\n="))
}
_NAMES = {
    "np": np,
    "math": math,
    "SimpleNamespace": SimpleNamespace,
    "EYE": np.eye(3),
    "TABLE": np.array([1.0, 4.0, -2.0, 0.5]),
    "STARTS": np.array([-0.5, 0.1, 0.7]),
}


class _Writer:
    """Writes expressions and statements of a depth at most."""

    def __init__(self, seed: int):
        self._rng = np.random.default_rng(seed)
        self._helpers = []

    def Write(self, kind: str, depth: int = 0, indent: int = 1) -> str:
        """Returns the text of one expression, or lines of statements."""
        if kind == "f":
            return self._Pick(self._helpers or ["np.multiply"])
        if kind == "do":
            lines = [self._Fill("do", depth, indent) for _ in range(max(depth, 1))]
            return "".join("    " * indent + line.rstrip() + "\n" for line in lines)
        is_leaf = depth <= 0 and kind in ("s", "v", "b")
        return self._Fill(f"{kind}0" if is_leaf else kind, depth, indent)

    def Text(self) -> str:
        """Returns a law with two helpers."""
        texts = []
        for name in ("helper", "other"):
            text = _HELPER.format(
                name=name,
                body=self.Write("do", 1),
                more=self.Write("do", 1),
                condition=self.Write("b", 2),
                one=self.Write("one"),
                other=self.Write("other"),
            )
            texts.append(text)
            self._helpers.append(name)
        return "".join(texts) + _LAW.format(body=self.Write("do", 4))

    def _Pick(self, items):
        return items[self._rng.integers(len(items))]

    def _Fill(self, kind: str, depth: int, indent: int) -> str:
        text = self._Pick(_FORMS[kind])
        while depth < 2 and "{do}" in text:
            text = self._Pick(_FORMS[kind])
        while (begin := text.find("{")) >= 0:
            end = text.index("}", begin)
            part = text[begin + 1 : end]
            if part == "do":
                inner = self.Write("do", depth - 2, indent + 1)
                rest = indent if text.startswith("el", end + 1) else indent + 1
                more = f"\n{inner}{'    ' * rest}"
            else:
                more = self.Write(part, min(depth, 3) - 1)
                if part in "svb" and not more.isidentifier():
                    more = f"({more})"
            text = text[:begin] + more + text[end + 1 :]
        return text


def RandomLaw(seed: int):
    """Returns a law, and its text."""
    text = _Writer(seed).Text()
    name = f"<law {seed}>"
    names = dict(_NAMES)
    linecache.cache[name] = len(text), None, text.splitlines(True), name
    exec(compile(text, name, "exec"), names)
    return names["law"], text
