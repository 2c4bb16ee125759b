"""Distinguishes errors of a diverging run from errors of a block."""

import contextlib
import weakref
from collections.abc import Iterator

import numpy as np
from pydrake.systems.framework import Context, System

# How messages of Drake begin, in 1.51 to 1.58: if the integrator finds no step that is
# short enough, and if MultibodyPlant computes a NaN.
_GIVING_UP = (
    "Error control wants to select step smaller",
    "Integrator has been directed to a near zero-length step",
)
_NOT_FINITE = "Detected NaN in"

# How the SystemExit begins with which pydrake reports a violated contract.
_VIOLATED_CONTRACT = "Failure at "


def FirstLine(error: BaseException) -> str:
    """Returns the first line of an error's message, and its notes.

    Args:
        error: An error. A note that NamingBlocks() has added names its block.
    """
    text = " ".join([*str(error).splitlines()[:1], *getattr(error, "__notes__", [])])
    return text or type(error).__name__


def ReasonOfDivergence(error: BaseException, *, has_error_control: bool) -> str:
    """Returns the reason why a run diverged.

    Args:
        error: An error for which IsDivergence() is true.
        has_error_control: Whether the solver has tried shorter steps.
    """
    reason = FirstLine(error)
    if IsGivingUp(error):
        return reason
    if has_error_control:
        return f"numbers become infinite or nan, however short the step is: {reason}"
    return (
        f"numbers became infinite or nan within a step: {reason}; a shorter "
        "simulator.max_step_size may show whether the step was the cause"
    )


def IsDivergence(error: BaseException, root_context: Context) -> bool:
    """Returns whether an error means that the run diverged.

    A run has diverged if the integrator finds no step that is short enough, if the
    state that it tries is not finite, or if a computation with this state fails (a
    singular matrix, an overflow). Any other error is an error of a block.

    Args:
        error: An error raised by the Simulator's AdvanceTo().
        root_context: The Context of the Simulator after the error.
    """
    if IsArithmetic(error) or IsGivingUp(error) or _IsOfDrake(error, _NOT_FINITE):
        return True
    state = root_context.get_continuous_state_vector().CopyToVector()
    return not np.isfinite(state).all()


def IsArithmetic(error: BaseException) -> bool:
    """Returns whether an error is numerical: a singular matrix, an overflow."""
    return isinstance(error, ArithmeticError | np.linalg.LinAlgError)


def IsGivingUp(error: BaseException) -> bool:
    """Returns whether the integrator has found no step that is short enough.

    Args:
        error: An error raised by the Simulator's AdvanceTo().
    """
    return _IsOfDrake(error, _GIVING_UP)


def _IsOfDrake(error: BaseException, beginning: str | tuple[str, ...]) -> bool:
    return isinstance(error, RuntimeError) and str(error).startswith(beginning)


@contextlib.contextmanager
def NamingBlocks() -> Iterator[None]:
    """Adds a note to an error that names the block in which it was raised.

    The SystemExit with which pydrake reports a violated contract becomes a
    RuntimeError, because it would end the interpreter.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        block = _BlockOf(error)
        note = [f"(in the block {block})"] if block else []
        if isinstance(error, SystemExit) and str(error).startswith(_VIOLATED_CONTRACT):
            # The text after the file and line of Drake's source.
            contract = str(error).partition(" in ")[2]
            raise RuntimeError(" ".join(["Drake:", contract, *note])) from error
        if not hasattr(error, "__notes__"):
            for text in note:
                error.add_note(text)
        raise


def _BlockOf(error: BaseException) -> str:
    """Returns the path of the block whose Python code raised an error, or ""."""
    path = ""
    traceback = error.__traceback__
    while traceback is not None:
        for name in ("self", "block"):  # In methods, in callbacks of a KernelBlock.
            block = traceback.tb_frame.f_locals.get(name)
            block = block() if isinstance(block, weakref.ref) else block
            if isinstance(block, System):
                path = block.GetSystemPathname().removeprefix("::")
        traceback = traceback.tb_next
    return path
