"""In-situ calibration of six-axis force/torque sensors with an accelerometer.

[Traversaro2014]: S. Traversaro, D. Pucci, F. Nori, "In situ calibration of six-axis force-torque
sensors using accelerometer measurements". The text of the paper that is at hand has lost most of
its equation bodies; they are derived anew here, with

    raw r (n,), gravity g (3,) in the sensor frame, wire wrench w = C (r - o) = M g,
    M = [m I; m (c x)],   environment on tool,

where g is minus the specific force of an accelerometer at rest. Data flow:

    spec -> source -> prepare (regressors) -> blocks -> screen (windows)
         -> smooth, moments (a few numbers a data set) -> offset, matrix, validate -> result
"""

from forcecal_ros.insitu.blocks import Chunk, Mounting
from forcecal_ros.insitu.calibrate import calibrate
from forcecal_ros.insitu.equations import Load
from forcecal_ros.insitu.reduce import DataSet, Options
from forcecal_ros.insitu.result import SensorResult, to_calibration, to_document
from forcecal_ros.insitu.spec import load_spec

__all__ = [
    'calibrate', 'Chunk', 'DataSet', 'Load', 'load_spec', 'Mounting', 'Options', 'SensorResult',
    'to_calibration', 'to_document',
]
