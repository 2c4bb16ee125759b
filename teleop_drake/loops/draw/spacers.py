"""Room beside the boxes of a block diagram for wires that turn there."""

from collections.abc import Iterable, Sequence


def Spacers(wires: Sequence[tuple[str, str]], is_ahead: Sequence[bool]) -> list[str]:
    """Returns invisible nodes beside the first and the last boxes of loops, as DOT.

    Without them, the wires that turn beside these boxes leave the diagram's frame.

    Args:
        wires: The ports at the begin and at the end of each wire, as `s1:y0`.
        is_ahead: Whether each wire leads in the direction of the layout.
    """
    text: list[str] = []
    for name, end in (("after", 0), ("before", 1)):
        ahead = {_Box(x[end]) for x, goes in zip(wires, is_ahead, strict=True) if goes}
        back = {_Box(x[end]) for x, goes in zip(wires, is_ahead, strict=True)} - ahead
        text += _Spacer(name, sorted(back))
    return text


def _Spacer(name: str, boxes: Sequence[str]) -> Iterable[str]:
    """Returns the node "before" or "after" some boxes of one diagram."""
    if not boxes:
        return
    # A box is in one diagram only, so that the name of the node is unique.
    node = f"{name}_{boxes[0]}"
    yield f'{node} [style=invis, label="", fixedsize=true, width=0, height=0]'
    for box in boxes:
        ends = (node, box) if name == "before" else (box, node)
        yield f"{' -> '.join(ends)} [style=invis]"


def _Box(port: str) -> str:
    """Returns the box of a port."""
    return port.partition(":")[0]
