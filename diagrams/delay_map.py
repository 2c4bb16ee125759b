"""The delay map: how much later each signal of a loop may come until it is unstable.

The loop is that of the thesis's arm with the adaptive controller, at rest on the bone.
DelayMargins() linearises it once, with all of its states and exact delays. Each margin
is that of one connection alone, in addition to the delays that are there.

Run `python diagrams/delay_map.py`: it draws the map beside this file (or into the file
given as an argument) and prints the connections that may be late the least.
"""

import sys
from pathlib import Path

from teleop_drake import DelayMargins, LoadScenario, WriteDiagram
from teleop_drake.study.analysis.loop import Linearizer
from teleop_drake.study.analysis.operating_point import OperatingPoints

NUM_SHOWN = 3


def main(picture: Path) -> None:
    scenario = LoadScenario("two_dof_collision")
    # The last operating point is on the bone. Its Context is trimmed: the arm does not
    # accelerate. The operator's device still moves, hence `is_moving`.
    on_bone = OperatingPoints(scenario)[-1]
    linearizer = Linearizer(scenario)
    context = linearizer.ContextAt(on_bone)
    margins = DelayMargins(linearizer.diagram, context, is_moving=True)
    WriteDiagram(linearizer.diagram, picture, max_depth=1, delay_margins=margins)
    outermost = {name: x for name, x in margins.items() if "/" not in name}
    for name in sorted(outermost, key=outermost.__getitem__)[:NUM_SHOWN]:
        print(f"{name} may come {1e3 * margins[name]:.2f} ms later")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).with_suffix(".svg"))
