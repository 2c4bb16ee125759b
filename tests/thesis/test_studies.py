"""The studies: solver, sensitivity and stability."""

import math

import numpy as np
import pytest
from grids import Slow

from teleop_drake.scenario import LoadScenario
from teleop_drake.thesis.studies import sensitivity as sensitivity_module
from teleop_drake.thesis.studies import solver as solver_module
from teleop_drake.thesis.studies.lyapunov import EstimateResidual, LyapunovTelemetry
from teleop_drake.thesis.studies.plain_solver import SolvePlainly
from teleop_drake.thesis.studies.sensitivity import SensitivityStudy
from teleop_drake.thesis.studies.solver import CollisionNumbers, SolverStudy
from teleop_drake.thesis.studies.synthetic_plant import SimulateSyntheticPlant

pytestmark = pytest.mark.xdist_group("thesis")

ADAPTIVE = {"controller.kind": "adaptive_backstepping"}


@pytest.fixture(scope="module", params=Slow(["a few tolerances", "every tolerance"]))
def solver(request, thesis_runs):
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "a few tolerances":
            few = {"_LOOSE_TOLERANCES": [1e-2], "_TIGHT_TOLERANCES": [1e-8, 1e-9]}
            few |= {"_TOLERANCES": [1e-2, 1e-8, 1e-9]}
            requests = [solver_module.REQUESTS[i] for i in (0, -2, -1)]
            for name, values in (few | {"REQUESTS": requests}).items():
                patch.setattr(solver_module, name, values)
        yield SolverStudy(thesis_runs)


@pytest.fixture(scope="module", params=Slow(["a few values", "every value"]))
def sensitivity(request, thesis_runs):
    """The short run of the tests tries a few values, most of which the ledger has."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "a few values":
            few = {
                (x.parameter, x.task): x
                for x in sensitivity_module._Changes()
                if x.parameter in ("Psi0", "lattice count", "adaptation rate")
                and x.task != "two_dof_collision"
            }
            patch.setattr(sensitivity_module, "_Changes", lambda: [*few.values()])
        yield SensitivityStudy(thesis_runs)


@pytest.fixture(scope="module")
def lyapunov(thesis_runs):
    return LyapunovTelemetry(thesis_runs)


def AssertComplete(study):
    headers, rows = study.table
    assert study.title and study.text and rows and study.figures
    assert all(len(row) == len(headers) for row in rows)
    assert all(isinstance(cell, str) for row in rows for cell in row)
    assert "nan" not in study.text
    for figure in study.figures.values():
        figure.draw_without_rendering()
        for ax in figure.axes:
            assert "[" in ax.get_xlabel() and ax.get_ylabel()
            assert any(len(line.get_xdata()) > 2 for line in ax.lines)


def test_the_solver_study_is_complete(solver):
    AssertComplete(solver)


def test_the_sensitivity_study_is_complete(sensitivity):
    AssertComplete(sensitivity)


def test_the_lyapunov_study_is_complete(lyapunov):
    AssertComplete(lyapunov)


def test_located_borders_converge(solver):
    headers, rows = solver.table
    column = headers.index("largest force, located, mN")
    located = [float(row[column]) for row in rows if row[column]]
    # Between those of the package the plain solver has tolerances of its own.
    assert len(located) == sum(math.log10(float(row[0])) % 1 == 0 for row in rows) > 1
    assert located[-1] == pytest.approx(15.74, rel=1e-3)
    assert located[-2:] == pytest.approx([located[-1]] * 2, rel=2e-3)


def test_loose_tolerances_scatter_and_tight_ones_do_not(solver):
    headers, rows = solver.table
    column = headers.index("first impact, plain, mN")
    widths = []
    for row in rows:
        low, high = (float(x) for x in row[column].split(" to "))
        widths.append(high - low)
    assert widths[0] > 2.0
    assert widths[-1] < 0.01


def test_plain_solver_agrees_where_it_is_accurate():
    scenario = LoadScenario("one_dof", {"controller.kind": "direct_force"})
    _, x, v = SolvePlainly(scenario, tolerance=1e-9, max_step=0.05, end=18.0)
    first, largest, rebound = CollisionNumbers(scenario, x, v)
    assert first == pytest.approx(8.657e-3, rel=1e-3)
    # The switch comes at the next step, and the bounces remember it.
    assert largest == pytest.approx(15.74e-3, rel=1e-2)
    assert rebound == pytest.approx(-1.229e-3, rel=1e-2)


def test_only_psi0_moves_the_numbers_of_the_collision(sensitivity):
    headers, rows = sensitivity.table
    column = headers.index("first impact")
    assert rows[-1][0] == "stop time"
    for parameter, _, _, task, *_ in rows[:-1]:
        assert parameter and task in (
            "one_dof",
            "two_dof_collision",
            "two_dof_combined",
        )
    for row in rows[:-1]:
        change = abs(float(row[column].removesuffix(" %")))
        if row[0] not in ("Psi0", "adaptation rate"):
            assert change < 0.5, row
    psi = [row for row in rows if row[0] == "Psi0"]
    assert max(abs(float(row[column].removesuffix(" %"))) for row in psi) > 5.0


def test_what_does_not_depend_on_the_choice(sensitivity):
    firm = next(x for x in sensitivity.text.split("\n\n") if x.startswith("What holds"))
    assert "it overshoots at the start" in firm
    assert "first impact is harder" in firm
    assert "largest force is lower" in firm


def test_V2_is_what_the_identity_says():
    coarse, fine = (
        SimulateSyntheticPlant(duration=1.0, step=step) for step in (0.01, 0.005)
    )
    errors = [np.abs(run.V2 - run.predicted).max() for run in (coarse, fine)]
    assert errors[0] < 1e-4
    # Fourth order: the identity is exact, the integration is not.
    assert errors[1] < errors[0] / 10
    assert (coarse.V2 - coarse.bound).max() <= 1e-6


def test_runs_stay_inside_the_residual_set(lyapunov):
    headers, rows = lyapunov.table
    radius, largest = (headers.index(name) for name in ("radius", "largest |mu|"))
    assert len(rows) == 4
    assert all(float(row[radius]) > float(row[largest]) for row in rows)


def test_residual_of_a_run(thesis_runs):
    residual = EstimateResidual(thesis_runs("one_dof", **ADAPTIVE))
    assert residual.eigenvalue == pytest.approx(2.0)
    assert residual.radius == residual.delta / 2.0
    assert 0 < residual.typical < residual.delta
    # |s, z| at the start: s = -v_d once the command has arrived.
    assert math.isclose(residual.error[0], 0.0, abs_tol=1e-12)
