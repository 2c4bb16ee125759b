"""The tableau of Dormand and Prince, order 5(4), with dense output.

Source: J. R. Dormand, P. J. Prince, "A family of embedded Runge-Kutta formulae", J.
Comput. Appl. Math. 6 (1980); dense output by L. F. Shampine, "Some practical
Runge-Kutta formulas", Math. Comput. 46 (1986).
"""

import numpy as np

# Row s has the weights of the rates in the state of stage s; only earlier stages have a
# weight. The last row also has the weights of the solution of order 5, so the last
# stage of a step is the first stage of the next one.
A = np.array(
    [
        [0, 0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84, 0],
    ]
)
# The time of each stage, as a share of the step.
C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
# The weights of the error estimate, the difference of the solutions of order 5 and 4.
E = np.array(
    [-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40]
)
# The weights of the stages in the dense output at the share theta of a step: row s has
# the coefficients of theta, theta^2, theta^3, theta^4 for stage s.
P = np.array(
    [
        [1, -8048581381, 8663915743, -12715105075],
        [0, 0, 0, 0],
        [0, 131558114200, -68118460800, 87487479700],
        [0, -1754552775, 14199869525, -10690763975],
        [0, 127303824393, -318862633887, 701980252875],
        [0, -282668133, 2019193451, -1453857185],
        [0, 40617522, -110615467, 69997945],
    ]
) / np.array(
    [
        [1, 2820520608, 2820520608, 11282082432],
        [1, 1, 1, 1],
        [1, 32700410799, 10900136933, 32700410799],
        [1, 470086768, 1410260304, 1880347072],
        [1, 49829197408, 49829197408, 199316789632],
        [1, 205662961, 616988883, 822651844],
        [1, 29380423, 29380423, 29380423],
    ]
)
NUM_STAGES = 7
