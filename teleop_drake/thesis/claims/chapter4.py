"""Chapter 4: one degree of freedom."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from teleop_drake.model.channels.kinds import CHANNEL_KINDS
from teleop_drake.model.channels.network import NetworkChannelConfig
from teleop_drake.thesis.claims.claim import Claim, Found, NetworksLearn
from teleop_drake.thesis.claims.measures import FarShare, LargestJump
from teleop_drake.thesis.claims.relation import SETTLING, Pair, Relation
from teleop_drake.thesis.runs import ADAPTIVE, Delay, ThesisRuns

_V_D = 1e-3
"""The velocity that the surgeon commands, m/s."""

_START = "start_velocity_overshoot"
_FIRST = "collision.initial_impact_force"
_LARGEST = "collision.peak_force"


# The relations for which a printed number stands, as arguments of Relation.
_IN_KIND: dict[str, Sequence[dict[str, Any]]] = {
    "larger with direct force": [{}],
    "smaller with direct force": [{"relation": ">"}],
    "more negative with direct force": [{"relation": ">"}, {"factor": 0.0}],
    "the same in both": [{"relation": "=", "tolerance": 0.01}],
}


def _WithoutDelay(runs: ThesisRuns) -> str:
    overshoot = runs.Short("one_dof", ADAPTIVE, Delay(0.0))[_START]
    return (
        "The surgeon's loop overshoots, not the controller: the haptic device "
        "integrates the error for the 0.2 s until the tool's velocity is felt. Without "
        f"delay it is {overshoot / _V_D:.1%}."
    )


def _FewerContacts(runs: ThesisRuns) -> Found:
    direct, adaptive = (
        len(run.recording.EventTimes("contact")) for run in runs.OfBoth("one_dof")
    )
    return Found(adaptive < direct, Pair(direct, adaptive, "contacts"))


def _Smooth(runs: ThesisRuns) -> Found:
    both = runs.OfBoth("one_dof")
    direct, adaptive = (LargestJump(run) for run in both)
    moved = tuple(float(run["control_force_variation"][0]) for run in both)
    return Found(
        adaptive < 0.01 * direct,
        Pair(direct, adaptive, "mN"),
        f"It moves more, though: total variation {Pair(moved[0], moved[1], 'mN')}.",
    )


def _FarCentres(runs: ThesisRuns) -> Found:
    share = FarShare(runs.OfBoth("one_dof").adaptive.recording)
    return Found(share < 0.1, f"{share:.2%}")


def _NoSwitching(runs: ThesisRuns) -> Found:
    run = runs.OfBoth("one_dof").adaptive
    jump = LargestJump(run)
    first = max(np.abs(run.recording[f"weights_{i}"][0]).max() for i in (1, 3))
    text = f"largest jump {jump:.2g} N, largest first weight {first:.2g}"
    return Found(jump < 1e-12 and first == 0, text)


def _DelayOfChannels(runs: ThesisRuns) -> Found:
    trips = {
        kind.kind: 2 * kind().delay
        for kind in CHANNEL_KINDS.kinds
        if issubclass(kind, NetworkChannelConfig) and kind is not NetworkChannelConfig
    }
    text = ", ".join(f"{name} {trip:.3g} s" for name, trip in trips.items())
    return Found(None, text)


# Texts of several claims.
_FITTED = (
    "Psi0 is fitted to this number, and decides it: `teleop-drake sweep sensitivity`."
)
_CONVERGED = (
    "Ours is converged, `teleop-drake sweep tolerance`, and agrees with a "
    "second solver. A plain solver scatters widely here at loose tolerances."
)
_FOLLOWS = "Follows from the fit of Psi0 to the overshoot."
_LARGER = "With the converged value of direct force the reduction is larger."


class _Printed(NamedTuple):
    """A number that the thesis prints, with its tolerance and reason; see Claim."""

    number: float
    tolerance: str
    reason: str
    is_fitted: bool = False


def _NumbersOfBoth(
    key: str,
    claim: str,
    *,
    figure: str,
    metric: str,
    unit: str,
    in_kind: str,
    direct: _Printed,
    adaptive: _Printed,
) -> list[Claim]:
    """Returns the claims on a metric's values with direct force and with adaptive."""
    return [
        Claim(
            key=f"4-{which}-{key}",
            place=f"section 4.2, Fig. {figure}",
            claim=f"{claim}, {name}.",
            printed=printed.number,
            unit=unit,
            tolerance=printed.tolerance,
            in_kind=in_kind,
            fitted=printed.is_fitted,
            reason=printed.reason,
            task="one_dof",
            relations=[Relation(metric, unit, **x) for x in _IN_KIND[in_kind]],
            shown=which,
        )
        for which, name, printed in (
            ("direct", "direct force", direct),
            ("adaptive", "adaptive", adaptive),
        )
    ]


CLAIMS = [
    *_NumbersOfBoth(
        "overshoot",
        "Velocity overshoot after the puncture",
        figure="4.1",
        metric="puncture.velocity_overshoot",
        unit="mm/s",
        in_kind="larger with direct force",
        direct=_Printed(0.472, "1 %", "No free parameter."),
        adaptive=_Printed(0.26, "5 %", _FITTED, is_fitted=True),
    ),
    Claim(
        key="4-overshoot-reduction",
        place="section 4.2, Fig. 4.1; 1 - 0.26/0.472 is 44.9 %",
        claim="The adaptive controller reduces that overshoot by 44 %.",
        printed=44,
        unit="%",
        tolerance="5 points",
        in_kind="there is a reduction",
        fitted=True,
        reason=_FITTED,
        task="one_dof",
        relations=[Relation("puncture.velocity_overshoot")],
        shown="reduction",
    ),
    *_NumbersOfBoth(
        "puncture-force",
        "Sensed force at the puncture",
        figure="4.2",
        metric="puncture.force",
        unit="mN",
        in_kind="the same in both",
        direct=_Printed(0.572, "1 %", "No free parameter."),
        adaptive=_Printed(
            0.572, "1 %", "Both arrive with almost v_d, and k x + d v is then the same."
        ),
    ),
    Claim(
        key="4-same-at-puncture",
        place="section 4.2, Fig. 4.2",
        claim=(
            "Speed, and with it the sensed force, is the same in both at the puncture."
        ),
        criterion="both differ by less than 1 %",
        task="one_dof",
        relations=[
            Relation("puncture.velocity", "mm/s", relation="=", tolerance=0.01),
            Relation("puncture.force", "mN", relation="=", tolerance=0.01),
        ],
    ),
    *_NumbersOfBoth(
        "rebound",
        "Most negative velocity at the collision",
        figure="4.1",
        metric="collision.rebound_velocity",
        unit="mm/s",
        in_kind="more negative with direct force",
        direct=_Printed(-0.72, "5 %", _CONVERGED),
        adaptive=_Printed(-0.658, "5 %", _FOLLOWS),
    ),
    Claim(
        key="4-rebound-reduction",
        place="section 4.2, Fig. 4.1; 1 - 0.658/0.72 is 8.6 %",
        claim="The adaptive controller reduces the rebound by 9 %.",
        printed=9,
        unit="%",
        tolerance="5 points",
        in_kind="there is a reduction",
        reason=_LARGER,
        task="one_dof",
        relations=[
            Relation("collision.rebound_velocity", **x)
            for x in _IN_KIND["more negative with direct force"]
        ],
        shown="reduction",
    ),
    *_NumbersOfBoth(
        "first-impact",
        "Largest force of the first impact",
        figure="4.2",
        metric="collision.initial_impact_force",
        unit="mN",
        in_kind="smaller with direct force",
        direct=_Printed(
            7.78,
            "5 %",
            "Ours is converged, as with an undamped spring it must be: "
            "v_d sqrt(k m) is 8.66 mN. A plain solver scatters widely "
            "here at loose tolerances.",
        ),
        adaptive=_Printed(9.42, "5 %", _FOLLOWS),
    ),
    *_NumbersOfBoth(
        "largest-force",
        "Largest force of all",
        figure="4.2",
        metric="collision.peak_force",
        unit="mN",
        in_kind="larger with direct force",
        direct=_Printed(11.3, "5 %", _CONVERGED),
        adaptive=_Printed(9.42, "5 %", _FOLLOWS),
    ),
    Claim(
        key="4-force-reduction",
        place="section 4.2, Fig. 4.2; 1 - 9.42/11.3 is 16.6 %",
        claim="The adaptive controller reduces the largest force by 16 %.",
        printed=16,
        unit="%",
        tolerance="5 points",
        in_kind="there is a reduction",
        reason=_LARGER,
        task="one_dof",
        relations=[Relation("collision.peak_force")],
        shown="reduction",
    ),
    Claim(
        key="4-first-impact-order",
        place="section 4.2",
        claim=(
            "The adaptive controller's first impact is harder than that of "
            "direct force, but its largest force is that of the first impact, "
            "and lower."
        ),
        criterion="direct first < adaptive first = adaptive largest < direct largest",
        task="one_dof",
        relations=[
            Relation(_FIRST, "mN", relation=">"),
            Relation(_FIRST, "mN", of_metric=_LARGEST),
            Relation(
                _FIRST,
                "mN",
                relation="=",
                of="adaptive",
                of_metric=_LARGEST,
                tolerance=1e-9,
            ),
        ],
    ),
    Claim(
        key="4-direct-start-overshoot",
        place="section 4.2, Fig. 4.1",
        claim="Direct force overshoots the commanded velocity at the start.",
        criterion="by more than 5 % of v_d before the puncture",
        task="one_dof",
        relations=[
            Relation(_START, run="direct", relation=">", factor=0.05, of="speed")
        ],
    ),
    Claim(
        key="4-no-start-overshoot",
        place="section 4.2, 6.1",
        claim="The adaptive controller does not overshoot at the start.",
        criterion="less than 1 % of v_d before the puncture",
        task="one_dof",
        relations=[Relation(_START, factor=0.01, of="speed")],
        remark=_WithoutDelay,
    ),
    Claim(
        key="4-tracking",
        place="section 4.2, Fig. 4.1",
        claim="The adaptive controller tracks the velocity much better.",
        criterion="less than half the rms of v - v_d(t - T_f) over the run",
        task="one_dof",
        relations=[Relation("velocity_rms_error", "mm/s", factor=0.5)],
    ),
    Claim(
        key="4-settling",
        place="section 4.2, 6.1",
        claim="The adaptive controller settles much faster on the bone.",
        criterion=(
            "it comes to rest (5 % of v_d) in at most half the time of direct force"
        ),
        reason=(
            "Direct force pushes with a constant force on a spring without "
            "damping. Only the slider's friction brings it to rest, later."
        ),
        task="one_dof",
        relations=[Relation(SETTLING, "s", factor=0.5)],
    ),
    Claim(
        key="4-fewer-oscillations",
        place="section 4.2, Fig. 4.2",
        claim="The tool bounces less on the bone with the adaptive controller.",
        criterion="fewer contacts until the end of the run",
        measure=_FewerContacts,
    ),
    Claim(
        key="4-smooth",
        place="section 4.2, Fig. 4.3",
        claim="The adaptive controller's force is smooth.",
        criterion="its largest jump is below 1 % of that of direct force",
        reason="It is a state, so it cannot jump.",
        measure=_Smooth,
    ),
    Claim(
        key="4-far-centres",
        place="section 4.2, Fig. 4.4 and 4.6",
        claim="Basis functions far from the tool hardly influence the networks.",
        criterion=(
            "those more than two widths away say less than 10 % of the sum of "
            "|w_i phi_i|"
        ),
        reason="So by construction: there phi_i is below 2 %.",
        measure=_FarCentres,
    ),
    Claim(
        key="4-adapts-quickly",
        place="section 6.1",
        claim="The networks adapt quickly to the unknown environment.",
        criterion="the third network leaves less than half of dF_e/dt (rms) unlearned",
        reason=(
            "At an adaptation rate of 0.1 the networks stay almost silent; see "
            "6-adaptation-matters."
        ),
        measure=partial(NetworksLearn, task="one_dof"),
    ),
    Claim(
        key="4-no-switching",
        place="section 1.5",
        claim=(
            "The controller is not switched between layers, and nothing is "
            "trained beforehand."
        ),
        criterion="its force does not jump at any layer, and all weights start at 0",
        reason="By construction: the law does not know the layers.",
        measure=_NoSwitching,
    ),
    Claim(
        key="4-delay-of-channels",
        place="section 4.2",
        claim="0.2 s in all is a good estimate of the delay in communication channels.",
        criterion=(
            "none; neither a channel nor a measure of a good estimate is named, "
            "and the mean round trips of the networks that have a name here are "
            "given beside it"
        ),
        reason=(
            "No one number stands for all channels. Light takes as long in a "
            "fibre to the other side of the earth and back, 2 x 20 000 km at "
            "204 000 km/s."
        ),
        measure=_DelayOfChannels,
    ),
]
