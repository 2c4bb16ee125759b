"""A page's module run by wasmtime, as the page's own script runs it in a browser."""

import base64
import gzip
import json
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import wasmtime

from teleop_drake.loops.engine.advance import FULL
from teleop_drake.loops.engine.problem import ROWS
from teleop_drake.loops.numerics.instants import SAME
from teleop_drake.loops.numerics.step_polynomials import DEGREE
from teleop_drake.loops.page.model import Model

_ROOM = 30_000  # For rows, which all stay.


def _Imported(name: str) -> Callable[..., wasmtime.Val]:
    """Returns a function of math for a module; wasmtime converts a Val sooner."""
    compute = getattr(math, name)
    return lambda *numbers: wasmtime.Val.f64(compute(*numbers))


class Instance:
    """A module in memory, with the numbers of a model."""

    def __init__(self, model: Model):
        self._store = wasmtime.Store()
        module = wasmtime.Module(self._store.engine, model.Module())
        linker = wasmtime.Linker(self._store.engine)
        self._end = 0
        double = wasmtime.ValType.f64()
        for needed in module.imports:
            kind = needed.type
            if isinstance(kind, wasmtime.MemoryType):
                self._end = 65536 * kind.limits.min
                kind = wasmtime.MemoryType(wasmtime.Limits(1000, None))
                self._memory = wasmtime.Memory(self._store, kind)
                item = self._memory
            elif isinstance(kind, wasmtime.TableType):
                kind = wasmtime.TableType(kind.element, wasmtime.Limits(2, None))
                item = table = wasmtime.Table(self._store, kind, None)
            else:
                function = wasmtime.FuncType([double] * len(kind.params), [double])
                item = wasmtime.Func(self._store, function, _Imported(needed.name))
            linker.define(self._store, needed.module, needed.name, item)
        linker.instantiate(self._store, module)
        self._run = table.get(self._store, 1)
        self._places: dict[str, tuple[int, list[int], bool]] = {}
        self._headers = []
        self._draws = list(model.facts["draws"])
        for group, fields in model.Headers().items():
            header = []
            for name, shape, is_whole, grows in fields:
                sizes = [_ROOM, *shape[1:]] if grows else shape
                values = model.numbers.get(f"{group}.{name}")
                place = self._Allocate(8 * math.prod(sizes))
                self._places[name] = place, sizes, is_whole
                header += [place, *sizes]
                if values is not None:
                    kind = np.int64 if is_whole else np.float64
                    self._Write(place, values.astype(kind))
            self._headers.append(self._Allocate(8 * len(header)))
            self._Write(self._headers[-1], np.array(header, np.int64))

    def _Allocate(self, size: int) -> int:
        place = self._end
        self._end = self._end + size
        missing = self._end - self._memory.data_len(self._store)
        if missing > 0:
            self._memory.grow(self._store, -(-missing // 65536))
        return place

    def _Write(self, place: int, array: np.ndarray) -> None:
        self._memory.write(self._store, array.tobytes(), place)

    def Read(self, name: str) -> np.ndarray:
        """Returns an array as it is now."""
        place, shape, is_whole = self._places[name]
        data = self._memory.read(self._store, place, place + 8 * math.prod(shape))
        return np.frombuffer(data, np.int64 if is_whole else float).reshape(shape)

    def Rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the times, rows and steps."""
        num = self.Read("counts")[ROWS]
        ends = np.flatnonzero(self.Read("row_ends")[:num])
        steps = ends[:, np.newaxis] + np.arange(-DEGREE, 1)
        return self.Read("row_times")[:num], self.Read("rows")[:num], steps

    def Run(
        self, end: float, accuracy: float, max_step: float, enough: float = math.inf
    ) -> int:
        """Runs up to a time, with the draws before it; returns how it ended.

        It may end sooner, but not before the time `enough`.
        """
        self._TakeDraws()
        while self._draws and self._draws[0][0] < end - SAME:
            self._Integrate(enough, self._draws[0][0], accuracy, max_step)
            self._TakeDraws()
        return self._Integrate(enough, end, accuracy, max_step)

    def _TakeDraws(self) -> None:
        """Writes the outputs of random sources that change now."""
        while self._draws and self._draws[0][0] < self.Read("clock")[0] + SAME:
            _, first, *value = self._draws.pop(0)
            self._Set("y", first, value)

    def _Integrate(self, enough: float, *numbers: float) -> int:
        status = FULL
        while status == FULL and self.Read("clock")[0] < enough:
            status = self._run(self._store, *self._headers, *numbers)
        return status

    def _Set(self, name: str, first: int, values) -> None:
        """Writes values into an array, from its element `first` on."""
        place, _, is_whole = self._places[name]
        kind = np.int64 if is_whole else float
        self._Write(place + 8 * int(first), np.array(values, kind))


def RunModule(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the times, rows and steps of a whole run."""
    instance = Instance(model)
    assert instance.Run(*model.numbers["run"]) == 0
    return instance.Rows()


def DataOf(html: str) -> dict[str, Any]:
    """Returns what is in a page, as its script unpacks it."""
    (text,) = re.findall('<script id="model"[^>]*>(.*)</script>', html)
    data = gzip.decompress(base64.b64decode(text))
    base = 8 + int.from_bytes(data[:8], "little")

    def Unpack(value: dict[str, Any]) -> Any:
        if value.keys() == {"$f"}:
            place, count = value["$f"]
            return np.frombuffer(data, float, count, base + place)
        return value

    return json.loads(data[8:base], object_hook=Unpack)
