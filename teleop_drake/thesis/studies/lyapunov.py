"""The stability study: the Lyapunov function and the residual set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from teleop_drake.figures.style import (
    COLORS,
    FONT_SIZE,
    SMALL_FONT_SIZE,
    WIDTH,
    FormatAxes,
)
from teleop_drake.recording import Recording
from teleop_drake.scenario import GainMatrix
from teleop_drake.thesis.claims.measures import BasisFunctions
from teleop_drake.thesis.claims.requests import ADAPTIVE
from teleop_drake.thesis.runs import ThesisRuns
from teleop_drake.thesis.studies.study import Study
from teleop_drake.thesis.studies.synthetic_plant import (
    SimulateSyntheticPlant,
    SyntheticRun,
)

_TASKS = (
    "one_dof",
    "two_dof_puncture",
    "two_dof_collision",
    "two_dof_combined",
)


_HEADERS = [
    "task",
    "lambda_min(G)",
    "delta_max",
    "median of |delta|",
    "radius",
    "largest |mu|",
    "last |mu|",
    "largest |W1|",
    "largest |W3|",
    "largest |Psi - Psi0|",
]

# Steps shorter than this say nothing about rates, s.
_SHORTEST_STEP = 1e-4


@dataclass(frozen=True, kw_only=True)
class Residual:
    """The residual set of a run, estimated from it.

    Attributes:
        eigenvalue: lambda_min(G).
        delta: delta_max.
        typical: The median of |delta|.
        error: (T,) |mu| = |(s, z)| at the samples.
    """

    eigenvalue: float
    delta: float
    typical: float
    error: np.ndarray

    @property
    def radius(self) -> float:
        """The radius of (4.50), (5.49)."""
        return self.delta / self.eigenvalue


def EstimateResidual(recording: Recording) -> Residual:
    """Estimates delta of (4.46), (5.45) from a run.

    The ideal weights are those constant ones that fit the rates of s and F_e best over
    the run (least squares over its steps, longer ones counting more). delta_1 and d_3
    are what they leave, delta_2 = d_3 + Psi^-1 G1 delta_1 (4.40). Steps with a jump of
    s or F_e in them are left out.
    """
    config = recording.teleoperation.controller
    n = recording.scenario.num_axes
    G1, G2, P = (GainMatrix(gain, n) for gain in (config.G1, config.G2, config.P))
    h = np.diff(recording.time)
    layer = recording["environment_layer"][:, 0]
    kept = (h > _SHORTEST_STEP) & (np.diff(layer) == 0)

    def Middle(samples: np.ndarray) -> np.ndarray:
        middle: np.ndarray = ((samples[1:] + samples[:-1]) / 2)[kept]
        return middle

    def Rate(samples: np.ndarray) -> np.ndarray:
        return np.asarray(np.diff(samples, axis=0)[kept] / h[kept, np.newaxis])

    F_e, s, z = (
        recording[name]
        for name in ("environment_force", "auxiliary_error", "control_force_error")
    )
    Phi = Middle(BasisFunctions(recording))
    weight = np.sqrt(h[kept])[:, np.newaxis]

    def Rest(known: np.ndarray, rate: np.ndarray) -> np.ndarray:
        solution = np.linalg.lstsq(weight * known, weight * rate, rcond=None)[0]
        return np.asarray(rate - known @ solution)

    dF = Middle(recording["control_force"] - F_e)
    delta_1 = Rest(np.hstack([dF, Phi]), Rate(s))
    d_3 = Rest(Phi, Rate(F_e))
    Psi = Middle(recording["psi"]).reshape(-1, n, n)
    delta_2 = d_3 + np.linalg.solve(Psi, (delta_1 @ G1.T)[:, :, np.newaxis])[:, :, 0]
    delta = np.linalg.norm(np.hstack([delta_1 @ P.T, delta_2]), axis=1)
    PG1 = P @ G1
    return Residual(
        eigenvalue=min(
            float(np.linalg.eigvalsh((matrix + matrix.T) / 2)[0])
            for matrix in (PG1, G2)
        ),
        delta=float(delta.max()),
        typical=float(np.median(delta)),
        error=np.linalg.norm(np.hstack([s, z]), axis=1),
    )


def LyapunovTelemetry(runs: ThesisRuns) -> Study:
    """Follows V2 where it is exact, and the residual set where it is not."""
    runs.Prefetch((task, ADAPTIVE) for task in _TASKS)
    right = SimulateSyntheticPlant()
    printed = SimulateSyntheticPlant(has_printed_sign=True)
    recordings = {task: runs(task, **ADAPTIVE) for task in _TASKS}
    residuals = {task: EstimateResidual(x) for task, x in recordings.items()}
    norms = {task: _WeightNorms(x) for task, x in recordings.items()}
    ratios = [x.radius / float(x.error.max()) for x in residuals.values()]
    return Study(
        title="Lyapunov function, residual set and weights",
        text=_Text(right, printed, ratios),
        figures={
            "lyapunov_exact": _PlotSynthetic(right, printed),
            "lyapunov_runs": _PlotRuns(recordings, residuals, norms),
        },
        table=(
            _HEADERS,
            [_Row(task, residuals[task], norms[task]) for task in _TASKS],
        ),
    )


def _WeightNorms(recording: Recording) -> dict[str, np.ndarray]:
    """Returns the norms (T,) of what the law has learned, by their symbols."""
    norms = {
        name: np.linalg.norm(recording[signal], axis=1)
        for name, signal in (("$|W_1|$", "weights_1"), ("$|W_3|$", "weights_3"))
    }
    Psi = recording["psi"]
    norms[r"$|\Psi - \Psi_0|$"] = np.linalg.norm(Psi - Psi[0], axis=1)
    return norms


def _Row(task: str, residual: Residual, norms: Mapping[str, np.ndarray]) -> list[str]:
    """Returns a task's row of the table, below _HEADERS."""
    return [
        task,
        f"{residual.eigenvalue:g}",
        f"{residual.delta:.3g}",
        f"{residual.typical:.3g}",
        f"{residual.radius:.3g}",
        f"{float(residual.error.max()):.3g}",
        f"{residual.error[-1]:.2g}",
        *(f"{norm.max():.3g}" for norm in norms.values()),
    ]


def _PlotRuns(
    recordings: Mapping[str, Recording],
    residuals: Mapping[str, Residual],
    norms: Mapping[str, Mapping[str, np.ndarray]],
) -> Figure:
    """Plots |mu| with the radius of the residual set, and what the law has learned."""
    figure = Figure(figsize=(WIDTH, 1.6 * len(recordings) + 0.4), layout="constrained")
    axes = figure.subplots(len(recordings), 2, sharex="row")
    for (left, right), (task, recording) in zip(axes, recordings.items(), strict=True):
        time, residual = recording.time, residuals[task]
        left.semilogy(
            time, residual.error, color=COLORS[0], linewidth=0.8, label=r"$|\mu|$"
        )
        left.axhline(
            residual.radius,
            color=COLORS[1],
            linestyle="--",
            label=r"$\delta_{max}/\lambda_{min}(G)$",
        )
        for i, (name, norm) in enumerate(norms[task].items(), start=2):
            shown = np.maximum(norm, 1e-12)
            right.semilogy(time, shown, color=COLORS[i], linewidth=0.8, label=name)
        left.set_ylim(bottom=residual.radius * 1e-6)
        right.set_ylim(bottom=1e-7)
        left.set_ylabel(f"$|\\mu|$ [SI]\n{task}", fontsize=FONT_SIZE)
        right.set_ylabel("norm [SI]", fontsize=FONT_SIZE)
        for ax in (left, right):
            ax.tick_params(labelsize=SMALL_FONT_SIZE, width=0.6, length=2.5)
            ax.spines[["top", "right"]].set_visible(False)
            ax.set_xlabel("time [s]", fontsize=FONT_SIZE)
    legends = [ax.get_legend_handles_labels() for ax in axes[0]]
    figure.legend(
        [handle for handles, _ in legends for handle in handles],
        [label for _, labels in legends for label in labels],
        loc="outside upper center",
        ncols=5,
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


def _PlotSynthetic(right: SyntheticRun, printed: SyntheticRun) -> Figure:
    """Plots V2, what the identity predicts and the bound, with either sign."""
    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    for ax, run, name in zip(
        figure.subplots(1, 2, sharey=True),
        (right, printed),
        ("sign of the derivation", "sign as printed"),
        strict=True,
    ):
        FormatAxes(ax)
        ax.plot(run.time, run.V2, color=COLORS[0], linewidth=2, label="$V_2$")
        ax.plot(
            run.time,
            run.predicted,
            color=COLORS[1],
            linestyle="--",
            label=r"$V_2(0) - \int (s^T P G_1 s + z^T G_2 z)\,dt$",
        )
        ax.plot(
            run.time,
            run.bound,
            color=COLORS[2],
            linestyle=":",
            label=r"bound $V_2(0) - \int \lambda_{min}(G) |\mu|^2\,dt$",
        )
        ax.set_xlabel(f"time [s], {name}", fontsize=FONT_SIZE)
        ax.set_ylabel("$V_2$ [-]", fontsize=FONT_SIZE)
    figure.legend(
        *ax.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=3,
        fontsize=FONT_SIZE,
        frameon=False,
    )
    return figure


def _Text(right: SyntheticRun, printed: SyntheticRun, ratios: Sequence[float]) -> str:
    """Returns what the study says; ratios are those of radius to largest |mu|."""
    mismatch = float(np.abs(right.V2 - right.predicted).max() / right.V2[0])
    wrong = float(np.abs(printed.V2 - printed.predicted).max() / printed.V2[0])
    return (
        "Where the networks are exact. A synthetic plant of two axes, ds/dt = "
        "Psi* (F_c - F_e) + W1* Phi and dF_e/dt = W3* Phi, without leakage and "
        "supervision, makes dV2/dt = -s^T P G1 s - z^T G2 z an identity (4.44, 5.43). "
        f"Along the simulated loop V2 and what the identity predicts differ by at most "
        f"{mismatch:.1e} of V2(0), the error of the integration. With the sign that "
        "(4.43), (4.52), (5.42) and (5.51) print for the third network they differ by "
        f"{wrong:.0%} of V2(0): "
        + (
            "V2 grows."
            if printed.V2[-1] > printed.V2[0]
            else "V2 does not decrease as the proof says."
        )
        + "\n\n"
        "Where they are not. For the real tasks delta is what the best constant "
        "weights leave of the rates of s and F_e, and |mu| = |(s, z)|, in SI numbers "
        "although their units differ, as in (4.45). V2 decreases outside of the radius "
        "delta_max/lambda_min(G) (4.50), (5.49), if nothing jumps: punctures and the "
        "surgeon's switches make s jump and are not covered. The radius is "
        + ", ".join(f"{ratio:.2g}" for ratio in ratios)
        + " times the largest |mu| that occurs in the four runs: "
        + (
            "the runs never leave the residual set, so that the proof says nothing "
            "about their motion."
            if min(ratios) >= 1
            else "where that is above 1 the run never leaves the residual set, so that "
            "the proof says nothing about its motion."
        )
        + " The bone decides: k v is a rate of F_e that networks of the position, at "
        "the given adaptation rate, do not learn."
    )


REQUESTS: list[tuple[str, dict[str, Any]]] = [(task, dict(ADAPTIVE)) for task in _TASKS]
"""The runs that the study looks at, as ThesisRuns.Prefetch takes them."""
