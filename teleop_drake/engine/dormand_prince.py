"""The tableau of Dormand and Prince, order 5(4), with dense output.

Source: J. R. Dormand, P. J. Prince, "A family of embedded Runge-Kutta formulae", J.
Comput. Appl. Math. 6 (1980); dense output by L. F. Shampine, "Some practical
Runge-Kutta formulas", Math. Comput. 46 (1986).
"""

import numpy as np

# The last stage is the first one of the next step, and its row the weights. A stage has
# the weight 0 in itself and in those after it.
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
C = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
# The difference of the two solutions.
E = np.array(
    [-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40]
)
# Coefficients of theta, theta^2, ... of each stage in the dense output.
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
