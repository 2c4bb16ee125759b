"""What to do about a function that cannot be followed."""

_STATE = "; declare a state instead"
_PRINT = "; print in an event of another block"

_ADVICE = {
    "it assigns to ": _STATE,
    "it changes ": _STATE,
    "read-only": _STATE,
    ".append()": _STATE,
    ".pop": _STATE,
    ".appendleft()": _STATE,
    "random": "; connect a RandomSource instead",
    "a call of time.": "; take context.get_time() instead",
    "a call of print()": _PRINT,
    "it makes text": _PRINT,
    "inside": "; connect it as a block instead",
}


def Advised(reason: str) -> str:
    """Returns why a function cannot be followed, with advice."""
    for part, advice in _ADVICE.items():
        if part in reason:
            return reason + advice
    return reason
