"""The programs of a sweep, which the calls of one worker share."""

import threading

from teleop_drake.study.sweep.any_plan import Programs


class _Kept(threading.local):
    """The programs of the latest sweep in a thread of a worker.

    Attributes:
        sweep: The identifier of the sweep.
        programs: Its programs.
    """

    sweep = ""
    programs: Programs


_kept = _Kept()


def ProgramsOf(sweep: str) -> Programs:
    """Returns the programs that this thread has made for a sweep; they may be added to.

    An executor calls a worker once for some of the runs. Its later calls continue with
    these programs. Another sweep begins with none.

    Args:
        sweep: An identifier that no other sweep has.
    """
    if _kept.sweep != sweep:
        _kept.sweep = sweep
        _kept.programs = {}
    return _kept.programs
