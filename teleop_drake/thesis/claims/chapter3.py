"""Chapter 3: a network that learns a disturbance."""

import math
from functools import partial

import numpy as np

from teleop_drake.thesis.claims.claim import Claim, Found, Shares
from teleop_drake.thesis.claims.measures import Late, Rms
from teleop_drake.thesis.runs import NETWORKS, NO_ADAPTATION, Run, ThesisRuns

_CASES = dict(zip(("I", "II"), NETWORKS, strict=True))


def _Error(runs: ThesisRuns, case: str, which: str, axis: str, printed: float) -> Found:
    ours = runs(_CASES[case])[f"{which}_error"]["xz".index(axis)]
    return Found(printed / 2 <= 1e3 * ours <= 2 * printed, ours)


def _ErrorVanishes(runs: ThesisRuns, case: str) -> Found:
    recording = runs(_CASES[case]).recording
    error = recording["tool_position"] - recording["desired_position"]
    late = Late(recording, error) / np.abs(error).max(axis=0)
    return Found((late < 0.1).all(), Shares(late, "xz"))


def _NetworkAdapts(runs: ThesisRuns, case: str) -> Found:
    recording = runs(_CASES[case]).recording
    F_e = recording["environment_force"]
    unlearned = Late(recording, F_e - recording["disturbance_estimate"])
    rest = float(np.linalg.norm(unlearned) / np.linalg.norm(Late(recording, F_e)))
    return Found(rest < 0.1, f"{rest:.1%}")


def _CoarseEstimate(runs: ThesisRuns) -> Found:
    run = runs(NETWORKS[0])
    silent = runs(NETWORKS[0], NO_ADAPTATION)
    force = np.linalg.norm(run.recording["environment_force"], axis=1)
    off = math.hypot(*run["disturbance_rms_error"]) / Rms(run.recording, force)
    x, z = _Ratios("rms_error", run, silent)
    text = f"off by {off:.0%}; without it x {x:.2f} times, z {z:.2f} times the error"
    return Found(off >= 0.1 and min(x, z) >= 2, text)


def _SlightlyMore(runs: ThesisRuns) -> Found:
    pair = [runs(name) for name in NETWORKS]
    growth = [x for name in ("max_error", "rms_error") for x in _Ratios(name, *pair)]
    factors = ", ".join(f"{x:.2f}" for x in growth)
    return Found(max(growth) < 1.5, f"growth by the factors {factors}")


def _LessAccurate(runs: ThesisRuns) -> Found:
    errors = {
        case: runs(name)["disturbance_rms_error"] for case, name in _CASES.items()
    }
    return Found(
        all(b > a for a, b in zip(*errors.values(), strict=True)),
        "; ".join(f"{case}: x {x:.3g}, z {z:.3g} N" for case, (x, z) in errors.items()),
    )


def _LargerGain(runs: ThesisRuns) -> Found:
    ratios = [
        x
        for name in NETWORKS
        for x in _Ratios("rms_error", runs(name), runs(name, {"controller.G1": 4.0}))
    ]
    factors = ", ".join(f"{x:.2f}" for x in ratios)
    return Found(max(ratios) < 1, f"by the factors {factors}")


def _Ratios(metric: str, one: Run, other: Run) -> list[float]:
    """Returns the other run's metric divided by the first one's, on each axis."""
    return [b / a for a, b in zip(one[metric], other[metric], strict=True)]


def _EffectsOfDelay(runs: ThesisRuns) -> Found:
    scenario = runs(NETWORKS[0]).recording.scenario
    channels = [x for x in vars(scenario) if x.endswith("_channel")]
    return Found(bool(channels), f"{len(channels)} channels")


CLAIMS = [
    *(
        Claim(
            key=f"3-{case}-{which}-{axis}",
            place=f"section 3.4, case {case}",
            claim=f"The {name} tracking error along {axis}.",
            printed=printed,
            unit="mm",
            tolerance="25 %",
            in_kind="within a factor of two",
            fitted=True,
            reason=(
                "The printed trajectory leaves the workspace. Eight fields, one"
                " set for both cases, are fitted to the eight errors."
            ),
            measure=partial(_Error, case=case, which=which, axis=axis, printed=printed),
        )
        for case, which, name, axis, printed in (
            ("I", "max", "largest", "x", 57.8),
            ("I", "max", "largest", "z", 89.4),
            ("I", "rms", "rms", "x", 14.5),
            ("I", "rms", "rms", "z", 25),
            ("II", "max", "largest", "x", 130),
            ("II", "max", "largest", "z", 90.2),
            ("II", "rms", "rms", "x", 33),
            ("II", "rms", "rms", "z", 27),
        )
    ),
    *(
        Claim(
            key=f"3-{case}-error-vanishes",
            place=f"section 3.4, case {case}, Fig. {figure}",
            claim=f"The tracking error {goes} to zero with time.",
            criterion=(
                "its rms over the last quarter is below 10 % of its largest "
                "value, on both axes"
            ),
            measure=partial(_ErrorVanishes, case=case),
        )
        for case, figure, goes in (
            ("I", "3.2", "goes"),
            ("II", "3.4", "stays close"),
        )
    ),
    *(
        Claim(
            key=f"3-{case}-network-adapts",
            place=f"section 3.4, case {case}, Fig. {figure}",
            claim="The network adapts quickly to the unknown disturbance.",
            criterion=(
                "the rms of |W Phi - F_e| over the last quarter is below a "
                "tenth of that of |F_e|"
            ),
            measure=partial(_NetworkAdapts, case=case),
        )
        for case, figure in (
            ("I", "3.3"),
            ("II", "3.5"),
        )
    ),
    Claim(
        key="3-coarse-estimate",
        place="section 3.5",
        claim="A coarse estimate of the disturbance is enough for good tracking.",
        criterion=(
            "in case I the network is off by 10 % (rms over the run) or more, "
            "and yet without it the rms tracking error is twice as large or "
            "more on both axes"
        ),
        measure=_CoarseEstimate,
    ),
    Claim(
        key="3-slightly-more",
        place="section 3.5",
        claim="The errors of case II are only slightly larger than those of case I.",
        criterion="each of the four errors grows by less than one half",
        reason="The thesis's own numbers grow by the factors 2.25 and 2.28 along x.",
        measure=_SlightlyMore,
    ),
    Claim(
        key="3-less-accurate",
        place="section 3.4, case II, Fig. 3.5",
        claim="The coupled disturbance is learned less accurately than the linear one.",
        criterion="larger rms error of the estimated disturbance on both axes",
        measure=_LessAccurate,
    ),
    Claim(
        key="3-larger-gain",
        place="(3.26)",
        claim="A larger G1 makes the tracking error smaller.",
        criterion="with four times the gain all four rms errors fall",
        reason="There is neither a delay nor a contact here; see 5-II-larger-gains.",
        measure=_LargerGain,
    ),
    Claim(
        key="3-effects-of-delay",
        place="section 1.5",
        claim="Chapter 3 shows how the networks capture the effects of time delays.",
        criterion="the task of chapter 3 has a delay",
        reason=(
            "The controller of chapter 3 stands at the arm. Where there is a "
            "delay the networks hardly matter; see 6-adaptation-matters."
        ),
        measure=_EffectsOfDelay,
    ),
]
