"""Analyses of a loop: linear models, stability, transparency and energy.

`loop` makes linear models of a teleoperator's loop at an `operating_point`, which
`stability`, `point_stability` and `transparency` evaluate. `ports` makes linear models
of any Diagram between two ports. `energy` evaluates recordings.
"""
