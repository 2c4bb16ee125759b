"""Derivatives of a block by AutoDiffXd beside those by differences."""

import numpy as np
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.systems.framework import PortDataType, System

from teleop_drake.loops.numerics.differences import differentiate

YES = "yes"


def Ports(system: System, way: str) -> list:
    """Returns the ports of vectors; of a plant those that its kernel knows."""
    count = getattr(system, f"num_{way}_ports")()
    ports = [getattr(system, f"get_{way}_port")(i) for i in range(count)]
    known = ("actuation", "applied_generalized_force", "state")
    return [
        port
        for port in ports
        if port.get_data_type() == PortDataType.kVectorValued
        and (not hasattr(system, "num_bodies") or port.get_name() in known)
    ]


def Slopes(system: System) -> str:
    """Returns "yes", or why derivatives by AutoDiffXd are not those of differences."""
    rng = np.random.default_rng(0)
    context = system.CreateDefaultContext()
    state = context.get_continuous_state_vector().CopyToVector()
    inputs = Ports(system, "input")
    x = np.concatenate([state, *(np.zeros(port.size()) for port in inputs)])
    x += rng.uniform(0.1, 0.2, len(x))
    ends = np.cumsum([len(state), *(port.size() for port in inputs)])[:-1]

    def Evaluate(system: System, x: np.ndarray) -> np.ndarray:
        context = system.CreateDefaultContext()
        (state, *values) = np.split(x, ends)
        for port, value in zip(Ports(system, "input"), values, strict=True):
            port.FixValue(context, value)
        if len(state):
            context.SetContinuousState(state)
        seen = [port.Eval(context) for port in Ports(system, "output")]
        if len(state):
            seen.append(system.EvalTimeDerivatives(context).CopyToVector())
        return np.concatenate([[], *seen])

    dual = system.ToAutoDiffXdMaybe()
    if dual is None:
        return "no: Drake does not convert it"
    try:
        found = Evaluate(dual, InitializeAutoDiff(x).ravel())
    except ValueError as error:
        if "LinearizePorts()" not in str(error):
            raise
        return "no: a delay, which `LinearizePorts()` cuts"
    slopes = ExtractGradient(found) if found.dtype == object else np.zeros(0)
    steps = np.full(len(x), 1e-3)
    expected = differentiate(lambda x: Evaluate(system, x), x, steps)
    slopes = slopes if slopes.size else np.zeros(expected.shape)
    scale = np.abs(expected).max(initial=1e-3)
    return YES if np.abs(slopes - expected).max(initial=0) < 1e-7 * scale else "wrong"
