"""Analyses of a loop: linear models, stability, transparency and energy.

`loop` and `ports` make exact linear models of a Diagram at an `operating_point`, which
`stability`, `point_stability` and `transparency` evaluate. `energy` reads recordings.
"""
