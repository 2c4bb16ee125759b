"""Chapter 3: a network that learns a disturbance."""

import math

import numpy as np

from teleop_drake.tasks.metrics import RunMetrics
from teleop_drake.thesis.claims.claim import Number, Row, Truth
from teleop_drake.thesis.claims.measures import Late, Rms
from teleop_drake.thesis.claims.requests import NETWORKS, NO_ADAPTATION
from teleop_drake.thesis.claims.wording import Shares
from teleop_drake.thesis.runs import ThesisRuns


def Chapter3(runs: ThesisRuns) -> list[Row]:
    """Returns the rows of chapter 3.

    Args:
        runs: Where the recordings come from.
    """
    printed = {
        "I": {"max_error": (0.0578, 0.0894), "rms_error": (0.0145, 0.025)},
        "II": {"max_error": (0.13, 0.0902), "rms_error": (0.033, 0.027)},
    }
    recordings = {
        case: runs(name) for case, name in zip(printed, NETWORKS, strict=True)
    }
    metrics = {case: RunMetrics(x) for case, x in recordings.items()}
    silent = RunMetrics(runs(NETWORKS[0], **NO_ADAPTATION))
    rows = []
    for case, numbers in printed.items():
        for name, values in numbers.items():
            kind = "largest" if name == "max_error" else "rms"
            for i, axis in enumerate("xz"):
                ours = metrics[case][name][i]
                rows.append(
                    Number(
                        f"3-{case}-{name.split('_')[0]}-{axis}",
                        f"section 3.4, case {case}",
                        f"The {kind} tracking error along {axis}.",
                        values[i],
                        ours,
                        0.25,
                        (1e3, "mm"),
                        (
                            values[i] / 2 <= ours <= 2 * values[i],
                            "within a factor of two",
                        ),
                        "The printed trajectory leaves the workspace; amplitude, start "
                        "and lattice are identified, one set for both cases.",
                    )
                )
    for case, fig_error, fig_force in (("I", 2, 3), ("II", 4, 5)):
        recording = recordings[case]
        error = recording["tool_position"] - recording["desired_position"]
        F_e = recording["environment_force"]
        unlearned = F_e - recording["disturbance_estimate"]
        late = Late(recording, error) / np.abs(error).max(axis=0)
        rows.append(
            Truth(
                f"3-{case}-error-vanishes",
                f"section 3.4, case {case}, Fig. 3.{fig_error}",
                "The tracking error goes to zero with time."
                if case == "I"
                else "The tracking error stays close to zero with time.",
                "its rms over the last quarter is below 10 % of its largest value, on "
                "both axes",
                bool((late < 0.1).all()),
                Shares(late, "xz"),
                "",
            )
        )
        rest = float(
            np.linalg.norm(Late(recording, unlearned))
            / np.linalg.norm(Late(recording, F_e))
        )
        rows.append(
            Truth(
                f"3-{case}-network-adapts",
                f"section 3.4, case {case}, Fig. 3.{fig_force}",
                "The network adapts quickly to the unknown disturbance.",
                "the rms of |W Phi - F_e| over the last quarter is below a tenth of "
                "that of |F_e|",
                rest < 0.1,
                f"{rest:.1%}",
                "",
            )
        )
    one, two = metrics["I"], metrics["II"]
    ratios = [
        b / a
        for name in ("max_error", "rms_error")
        for a, b in zip(one[name], two[name], strict=True)
    ]
    gains = [a / b for a, b in zip(silent["rms_error"], one["rms_error"], strict=True)]
    force = np.linalg.norm(recordings["I"]["environment_force"], axis=1)
    off = math.hypot(*one["disturbance_rms_error"]) / Rms(recordings["I"], force)
    rows.append(
        Truth(
            "3-coarse-estimate",
            "section 3.5",
            "A coarse estimate of the disturbance is enough for good tracking.",
            "in case I the network is off by 10 % (rms over the run) or more, and yet "
            "without it the rms tracking error is twice as large or more on both axes",
            off >= 0.1 and min(gains) >= 2,
            f"off by {off:.0%}; without it "
            + ", ".join(
                f"{axis} {ratio:.2f} times"
                for axis, ratio in zip("xz", gains, strict=True)
            )
            + " the error",
            "",
        )
    )
    rows.append(
        Truth(
            "3-slightly-more",
            "section 3.5",
            "The errors of case II are only slightly larger than those of case I.",
            "each of the four errors grows by less than one half",
            max(ratios) < 1.5,
            "growth by the factors " + ", ".join(f"{ratio:.2f}" for ratio in ratios),
            "The thesis's own numbers grow by the factors 2.25 and 2.28 along x.",
        )
    )
    rows.append(
        Truth(
            "3-less-accurate",
            "section 3.4, case II, Fig. 3.5",
            "The coupled disturbance is learned less accurately than the linear one.",
            "larger rms error of the estimated disturbance on both axes",
            all(
                b > a
                for a, b in zip(
                    one["disturbance_rms_error"],
                    two["disturbance_rms_error"],
                    strict=True,
                )
            ),
            "; ".join(
                f"{case}: x {x['disturbance_rms_error'][0]:.3g}, "
                f"z {x['disturbance_rms_error'][1]:.3g} N"
                for case, x in metrics.items()
            ),
            "",
        )
    )
    return rows
