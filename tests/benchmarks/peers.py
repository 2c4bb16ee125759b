"""Other simulators on the same model, as far as they are installed.

A peer is a module of this folder with NAME, SWEEPS (whether it is fast enough for
benchmarks.delays), Prepare(task, controller, delay, duration) -> seconds spent on
compiling, or None, and Simulate(task, controller, delay, duration) -> Solution.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from benchmarks.options import Options

# Module by the package that it needs.
MODULES = {
    "jitcdde": "benchmarks.jitcdde_peer",
    "jaxonomy": "benchmarks.jaxonomy_peer",
    "bdsim": "benchmarks.bdsim_peer",
}


@dataclass(frozen=True)
class Peer:
    """One simulator; `missing` says why it cannot be run, else it is empty."""

    name: str
    module: Any = None
    missing: str = ""

    @property
    def sweeps(self) -> bool:
        return not self.missing and self.module.SWEEPS


def Peers(options: Options) -> list[Peer]:
    """Returns all peers, or none if they are not asked for."""
    return [_Load(package) for package in MODULES] if options.peers else []


def Find(name: str) -> Callable:
    """Returns the Simulate of the peer with that name.

    Raises:
        LookupError: If there is none, or what it needs is not installed.
    """
    for package in MODULES:
        peer = _Load(package)
        if peer.name == name and not peer.missing:
            return peer.module.Simulate
    raise LookupError(f"{name!r} is neither a contender nor an installed peer")


def _Load(package: str) -> Peer:
    try:
        importlib.import_module(package)
    except ImportError as error:
        return Peer(package, missing=f"not run: {error}")
    module = importlib.import_module(MODULES[package])
    return Peer(module.NAME, module)
