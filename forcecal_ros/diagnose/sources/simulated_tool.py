"""The tool of a simulator that cannot be run: by the wrench and the motion that it recorded."""

from dataclasses import replace
from typing import NamedTuple

from forcecal_ros.checks.hypotheses import judge
from forcecal_ros.checks.messages import as_in_base, SIGN, Stated, WEIGHT_REMOVED
from forcecal_ros.core.errors import DataError, UnobservableError
from forcecal_ros.core.geometry import Array, skew
from forcecal_ros.core.rigid_body import BodyMotion, INERTIAL, regressor, symmetric
from forcecal_ros.core.streams import phase_spans, Recording, TOUCHING
from forcecal_ros.diagnose.recordings import add_imu
from forcecal_ros.effects.nuisances import possible, rows_of
from forcecal_ros.effects.rig import Rig, Tool
from forcecal_ros.sim.rigid_tool import CarriedTool, GYRATION, rigid_tool_of_rig, RigidTool
from forcecal_ros.sim.signals import BLOCK, block_means
import numpy as np
from scipy.optimize import least_squares

LIGHTEST = 0.02
"""Mass of a tool, at least, that a wrench sensor shows [kg]: 0.2 N, the noise of most."""

TURN = 'rotate it in the simulator'
"""How that of a simulator that is run is turned."""

DRAWN = (0.01, 0.001)
"""
How well a tool is known by its drawing, 1 sigma of mass (relative) and centre of mass [m]: cables
and screws are missing there.
"""

ZERO = (10.0, 1.0)
"""
Zero of the robot's sensor, 1 sigma [N], [N m], beyond the median difference that is removed: as
much as a tool's weight would move that.
"""

OUTLIER = 1.345
"""Residual, in its scale, from which it counts linearly: Huber's, 95 % efficient on Gaussians."""

SIMULATE_IT = 'simulate the mounted tool'
"""What to do where another tool hung on the robot than in the simulation."""


class SimulatedTool(NamedTuple):
    """
    A simulator's tool.

    Attributes
    ----------
    simulated : RigidTool
        As simulated, with no zero of the robot's sensor.
    unexplained : tuple of float
        RMS of what it leaves of the simulated wrench [N], [N m].
    zero : tuple of float
        Of the robot's sensor beyond the simulator's [N], [N m].
    """

    simulated: RigidTool
    unexplained: tuple[float, float]
    zero: tuple[float, ...] = (0.0,) * 6

    @property
    def rigid_tool(self) -> RigidTool:
        """The tool on the robot's sensor, with its zero."""
        sensor = self.simulated.wrench_sensor
        bias = tuple((np.array(sensor.bias) + self.zero).tolist())
        return replace(self.simulated, wrench_sensor=replace(sensor, bias=bias))

    def zeroed(self, apart: Array) -> 'SimulatedTool':
        """Take the middle of the robot's wrench less the simulated, shape (n, 6), for its zero."""
        return self._replace(zero=tuple(np.nanmedian(apart, axis=0).tolist()))


def simulated_tool(simulated: Recording, start: float, n_blocks: int, rig: Rig,
                   turn: str = '') -> SimulatedTool:
    """
    Tell the tool of a simulator from its wrench and motion.

    Parameters
    ----------
    simulated : Recording
        Wrench and pose; its accelerometer is not used.
    start : float
        When block 0 begins [s].
    rig : Rig
        Gives the tolerances.
    turn : str
        How a wrench of the other sign is rotated; by an option if it is a recorded one.

    Returns
    -------
    SimulatedTool
        With an accelerometer in its origin that speaks m/s^2.

    Raises
    ------
    DataError
        The wrench holds no weight, or that of a tool that falls up, or is in another frame.
    """
    vertical = _require_own_axes(simulated, rig)
    tool, bias, unexplained = _fit_tool(
        replace(simulated, accelerometer=None), start, n_blocks, rig)
    if tool[0] < -LIGHTEST:
        turn = turn or f'give --simulated-wrench-sign {-(simulated.wrench_sign or 1)}'
        raise DataError("the simulated wrench has the wrong sign: at rest it must be the tool's "
                        f'weight, pointing down, but shows {tool[0]:.2f} kg; {turn}')
    if tool[0] < LIGHTEST:
        raise DataError(f'the simulated wrench has no weight of a tool ({tool[0]:.3f} kg)'
                        f'{vertical}; let the simulator publish the wrench in the frame of its '
                        'sensor, without compensation')
    rigid_tool = add_imu(rigid_tool_of_rig(replace(
        rig, tool=_with_moments(rig.tool, tool), effects=(), optidrive=None,
        wrench_sensor=replace(rig.wrench_sensor, gain=(1.0,) * 6, bias=tuple(bias.tolist())))))
    spreads = replace(rigid_tool.spreads, mass=DRAWN[0], com=DRAWN[1], force_bias=ZERO[0],
                      torque_bias=ZERO[1], own_inertia=float(tool[0]) * GYRATION ** 2)
    force, torque = (float(np.sqrt(np.mean(part ** 2)))
                     for part in (unexplained[:, :3], unexplained[:, 3:]))
    return SimulatedTool(replace(rigid_tool, spreads=spreads), (force, torque))


def _require_own_axes(simulated: Recording, rig: Rig) -> str:
    """Refuse a simulated wrench in another frame than its pose; say if it stays vertical."""
    gravity = np.array(rig.gravity)
    try:
        judge(simulated, gravity, Stated(gravity / np.linalg.norm(gravity)))
    except UnobservableError:
        pass  # the fit of the tool reports it better
    except DataError as error:
        if error.about != SIGN:
            cause = str(error).rpartition(';')[0].replace('the driver', 'the simulator')
            how = ('without compensating gravity' if error.about == WEIGHT_REMOVED else
                   'in the frame of its pose')
            raise DataError(f'the simulated {cause}; let it publish the wrench {how}') from error
    if simulated.wrench is None or not len(simulated.wrench):
        return ''
    return as_in_base(simulated.wrench.values[:, :3], gravity)


def _fit_tool(simulated: Recording, start: float, n_blocks: int, rig: Rig
              ) -> tuple[Array, Array, Array]:
    """
    Fit a tool to the wrench along its motion, robustly.

    Returns
    -------
    tool : ndarray, shape (10,)
        Mass [kg], first moments [kg m], six elements of the inertia about the origin [kg m^2].
    bias : ndarray, shape (6,)
        [N], [N m]
    unexplained : ndarray, shape (n, 6)
        Of the wrench in free motion [N], [N m].
    """
    motion = CarriedTool(simulated, start, n_blocks, 'acc1')
    by_tool = regressor(BodyMotion(motion.t, -motion.specific_force_of_origin(rig), motion.omega,
                                   motion.alpha))
    by_tool = block_means(by_tool.reshape(-1, 6 * INERTIAL)).reshape(-1, 6, INERTIAL)
    X = np.concatenate([by_tool, np.tile(np.eye(6), (n_blocks, 1, 1))], axis=2)
    wrench = block_means(motion.recorded_wrench(simulated))
    free, t = np.ones(n_blocks, dtype=bool), start + BLOCK * (0.5 + np.arange(n_blocks))
    for begin, end in phase_spans(simulated.phases, TOUCHING):
        free &= (t < begin) | (t >= end)
    scale = np.repeat([1.0, 0.1], 3)  # a newton counts as much as a tenth of a newton metre
    a, b = (X / scale[:, np.newaxis])[free].reshape(-1, X.shape[2]), (wrench / scale)[free].ravel()
    theta = np.linalg.lstsq(a, b, rcond=1e-8)[0]
    spread = float(np.median(np.abs(b - a @ theta))) / 0.6745
    theta = least_squares(lambda x: a @ x - b, theta, lambda x: a, loss='huber',
                          f_scale=OUTLIER * max(spread, 1e-6)).x
    return theta[:INERTIAL], theta[INERTIAL:], (wrench - X @ theta)[free]


def _with_moments(tool: Tool, moments: Array) -> Tool:
    """Give a tool the mass, first and second moments of :func:`_fit_tool`."""
    mass = float(moments[0])
    com = moments[1:4] / mass
    W = skew(com)
    inertia = symmetric(moments[4:]) + mass * W @ W
    changed: Tool = replace(tool, mass=mass, com=tuple(com.tolist()),
                            inertia=rows_of(possible(inertia)))
    return changed
