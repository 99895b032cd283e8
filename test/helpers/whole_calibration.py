"""A calibration with every part that a file can hold."""

import math

from forcecal_ros.core.calibration import (
    Accelerometer,
    Calibration,
    Estimate,
    Noise,
    ObserverGain,
    Tool,
)
import numpy as np


def whole_calibration():
    return Calibration(
        mass=Estimate(13.0, 0.001, 'kg'),
        com=Estimate([0.03, -0.01, 0.14], 1e-4, 'm'),
        wrench_bias=Estimate([4, -3, 8, 0.3, -0.2, 0.1], 0.01, 'N, N m'),
        inertia=Estimate(np.diag([0.12, 0.15, 0.06]), 0.01, 'kg m^2'),
        accelerometer=Accelerometer(
            offset=Estimate([5.09, 5.1, 5.0], 3e-4, 'V'),
            gain=Estimate([-0.29, -0.3, -0.28], 1e-4, 'V/(m/s^2)'),
            map=Estimate(np.eye(3), 1e-3, '1'), delay=Estimate(0.004, 1e-5, 's'),
            coupling='ac', cutoff=Estimate(0.01, math.nan, 'Hz'),
            position=Estimate([0.05, 0, 0.18], math.nan, 'm')),
        tool=Tool(Estimate(5000, 10, 'N/m'), Estimate(130, 3, 'N s/m')),
        noise=Noise(
            Q=Estimate(np.diag([0, 1e-6]), math.nan, '(m, m/s)^2 s'),
            R=Estimate(np.eye(3), math.nan, '(m, m/s, m/s^2)^2 s'),
            wrench=Estimate(np.eye(6), math.nan, '(N, N m)^2'),
            specific_force=Estimate(np.eye(3), math.nan, '(m/s^2)^2'),
            wrench_rate=1000.0, accelerometer_rate=1000.0),
        observer=ObserverGain(
            K=Estimate([[0.04, 6e-4, -7e-3], [0.1, 1e-4, 1.0]], math.nan, '1'),
            A=Estimate([[0, 1], [0, 0]], 0, '1'), C=Estimate([[1, 0], [0, 1], [0, 0]], 0, '1'),
            dt=1e-3, kalman={'force': Estimate(np.ones(6), math.nan, '1')}),
        matrix=Estimate(np.ones((6, 7)), 0.1, 'N, N m per count'),
        matrix_offset=Estimate(np.arange(7.0), 0.1, 'count'),
        gravity=9.8209, wrench_sign=-1,
        quality={'warnings': ['mind the gap'], 'chi2': np.float64(1.5)},
        source={'bag': 'x', 'poses': [1, 2]})
