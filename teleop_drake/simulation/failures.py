"""Tells a run that blows up from a block that is wrong."""

import contextlib
import weakref
from collections.abc import Iterator

import numpy as np
from pydrake.systems.framework import Context, System

# How Drake's own complaints begin, in 1.51 to 1.58: of the integrator, which finds no
# step that is short enough, and of MultibodyPlant.
_GIVING_UP = (
    "Error control wants to select step smaller",
    "Integrator has been directed to a near zero-length step",
)
_NOT_FINITE = "Detected NaN in"

# How the SystemExit begins that pydrake makes of a violated contract.
_VIOLATED_CONTRACT = "Failure at "


def FirstLine(error: BaseException) -> str:
    """Returns the first line of what an error says, and in which block it is.

    Args:
        error: One that went through NamingBlocks().
    """
    text = " ".join([*str(error).splitlines()[:1], *getattr(error, "__notes__", [])])
    return text or type(error).__name__


def ReasonOfDivergence(error: BaseException, *, has_error_control: bool) -> str:
    """Returns why a run ended that blew up.

    Args:
        error: For which IsDivergence().
        has_error_control: Whether shorter steps have been tried.
    """
    reason = FirstLine(error)
    if IsGivingUp(error):
        return reason
    if has_error_control:
        return f"numbers leave the finite, however short the step is: {reason}"
    return (
        f"numbers left the finite within a step: {reason}; a shorter "
        "simulator.max_step_size may tell whether the step was to blame"
    )


def IsDivergence(error: BaseException, root_context: Context) -> bool:
    """Returns whether an error means that the run blew up.

    So it is if the integrator gives up, or if numbers leave the finite: the state that
    it tries, or what is computed of it (a singular matrix, an overflow). Anything else
    is an error of a block.

    Args:
        error: What came out of the Simulator's AdvanceTo().
        root_context: Of the Simulator, as the error left it.
    """
    if IsArithmetic(error) or IsGivingUp(error) or _IsOfDrake(error, _NOT_FINITE):
        return True
    state = root_context.get_continuous_state_vector().CopyToVector()
    return not np.isfinite(state).all()


def IsArithmetic(error: BaseException) -> bool:
    """Returns whether an error is of numbers: a singular matrix, an overflow."""
    return isinstance(error, ArithmeticError | np.linalg.LinAlgError)


def IsGivingUp(error: BaseException) -> bool:
    """Returns whether the integrator has found no step that is short enough.

    Args:
        error: What came out of the Simulator's AdvanceTo().
    """
    return _IsOfDrake(error, _GIVING_UP)


def _IsOfDrake(error: BaseException, beginning: str | tuple[str, ...]) -> bool:
    return isinstance(error, RuntimeError) and str(error).startswith(beginning)


@contextlib.contextmanager
def NamingBlocks() -> Iterator[None]:
    """Adds to an error a note of the block in which it was raised.

    A SystemExit that pydrake makes of a violated contract becomes a RuntimeError: it
    would end the interpreter.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        block = _BlockOf(error)
        note = [f"(in the block {block})"] if block else []
        if isinstance(error, SystemExit) and str(error).startswith(_VIOLATED_CONTRACT):
            # Behind the file and the line in Drake.
            contract = str(error).partition(" in ")[2]
            raise RuntimeError(" ".join(["Drake:", contract, *note])) from error
        if not hasattr(error, "__notes__"):
            for text in note:
                error.add_note(text)
        raise


def _BlockOf(error: BaseException) -> str:
    """Returns the path of the block whose Python raised an error; empty: none's."""
    path = ""
    traceback = error.__traceback__
    while traceback is not None:
        for name in ("self", "block"):  # A method's, and a KernelBlock's callback's.
            block = traceback.tb_frame.f_locals.get(name)
            block = block() if isinstance(block, weakref.ref) else block
            if isinstance(block, System):
                path = block.GetSystemPathname().removeprefix("::")
        traceback = traceback.tb_next
    return path
