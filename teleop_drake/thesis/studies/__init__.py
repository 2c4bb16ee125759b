"""Studies that the thesis lacks: its solver, its open parameters, its stability proof.

Each is a function of the runs and returns a Study. The text of a study is made from
its numbers.
"""

from typing import Any

from teleop_drake.thesis.studies import lyapunov, sensitivity, solver
from teleop_drake.thesis.studies.lyapunov import LyapunovTelemetry
from teleop_drake.thesis.studies.sensitivity import SensitivityStudy
from teleop_drake.thesis.studies.solver import SolverStudy

STUDIES = (SolverStudy, SensitivityStudy, LyapunovTelemetry)
"""The studies, in the order of the report."""

REQUESTS: list[tuple[str, dict[str, Any]]] = [
    *solver.REQUESTS,
    *sensitivity.REQUESTS,
    *lyapunov.REQUESTS,
]
"""The runs that the studies look at, as ThesisRuns.Prefetch takes them."""
