"""What each effect means, in words: a phrase for its name, and a sentence for its numbers."""

from typing import NamedTuple

from forcecal_ros.core.quantity import quantity
from forcecal_ros.diagnose.judge.named_effects import AT_BOUND, NamedEffect, Parameter
from forcecal_ros.diagnose.model.gates import kind_of
from forcecal_ros.effects.library import EFFECTS, Quantity
from forcecal_ros.report.rows import HALF

ALL = '{all}'
"""Represents every number of an effect that is beyond chance, with its name."""

BEYOND = 2.0
"""Standard errors from which a number is one of those: 95 % of chance stays below."""


class Words(NamedTuple):
    """
    How one speaks of an effect.

    Attributes
    ----------
    phrase : str
        What it is, without numbers.
    sentence : str
        With the names of its parameters in braces, or :data:`ALL`.
    """

    phrase: str
    sentence: str


WORDS = {
    'wrench_delay': Words('force and torque come late',
                          'The measured wrench lags the simulated one by {delay}'),
    'wrench_lowpass': Words(
        'force and torque are smoothed by a filter',
        'The wrench is smoothed by a filter with a time constant of {time_constant}'),
    'wrench_bias_drift': Words(
        'the bias of force and torque drifts', 'The bias of the wrench drifts: {all}'),
    'wrench_bias_step': Words(
        'the bias of force and torque steps', 'The bias of the wrench steps: {all}'),
    'wrench_gain': Words(
        'force or torque reads too much or too little',
        'The wrench reads too much (+) or too little (-): {all}'),
    'wrench_crosstalk': Words(
        'one channel of the wrench shows part of another',
        'A channel of the wrench shows part of another: {all}'),
    'wrench_hysteresis': Words(
        'the reading depends on where the force came from',
        'The wrench lags behind where the force came from: {all}'),
    'wrench_saturation': Words(
        'the range of the force sensor ends', 'The range of the wrench sensor ends: {all}'),
    'wrench_quantisation': Words(
        'force and torque come in coarse steps', 'The wrench comes in coarse steps: {all}'),
    'accel_delay': Words(
        'the accelerometer comes late',
        'The measured acceleration lags the simulated one by {delay}'),
    'accel_gain': Words(
        'the accelerometer reads too much or too little',
        'The accelerometer reads too much (+) or too little (-): {all}'),
    'accel_bias': Words(
        'the bias of the accelerometer is off', 'The bias of the accelerometer is off: {all}'),
    'accel_misalignment': Words(
        'the accelerometer is turned on its mount',
        'The accelerometer is turned on its mount: {all}'),
    'accel_highpass': Words(
        'the accelerometer loses what stays constant, gravity first',
        'The accelerometer loses what stays constant at a rate of {rate}'),
    'accel_saturation': Words(
        'the range of the accelerometer ends', 'The range of the accelerometer ends: {all}'),
    'accel_resonance': Words(
        'the accelerometer rings on something soft',
        'The accelerometer rings on something soft at {frequency}'),
    'tool_mass': Words(
        'the tool is heavier or lighter', 'The mass of the tool is off by {change}'),
    'tool_com': Words(
        'the centre of mass is elsewhere', 'The centre of mass of the tool is elsewhere: {all}'),
    'tool_stiffness': Words(
        'the spring of the tool is stiffer or softer',
        'The stiffness of the tool is off by {change}'),
    'tool_damping': Words(
        'the tool damps more or less', 'The damping of the tool is off by {change}'),
    'tool_stiffening': Words(
        'the spring of the tool gets harder the further it bends',
        'The spring of the tool gets harder with its bending: cubic term {cubic}'),
    'tool_friction': Words(
        'the tool slides with dry friction', 'The tool slides with {force} of dry friction'),
    'tool_backlash': Words('the tool has backlash', 'The tool has {gap} of backlash'),
    'cable_force': Words(
        'a cable or hose pulls at the tool', 'A cable or hose pulls at the tool: {all}'),
    'spindle_vibration': Words(
        'an unbalance shakes the tool', 'The tool is shaken at {frequency}'),
    'robot_delay': Words('the robot moves late', 'The robot lags the simulated one by {delay}'),
    'robot_resonance': Words('the arm rings', 'The arm rings at {frequency}'),
    'base_tilt': Words('the base is not level', 'The base is not level: {all}'),
    'contact_stiffness': Words(
        'what is touched is harder or softer',
        'The stiffness of what is touched is off by {change}'),
    'contact_damping': Words(
        'what is touched damps more or less', 'The damping of what is touched is off by {change}'),
    'wall_position': Words(
        'what is touched stands elsewhere', 'What is touched stands {shift} from where it should'),
    'clock_skew': Words(
        'the clock of a stream runs fast or slow', 'The stamps of a stream run fast (+): {all}'),
    'dropouts': Words('messages get lost', 'Messages get lost: {all}'),
    'unknown': Words('something that is none of the known effects',
                     'It is none of the known effects'),
}
"""By name of the effect; all others are parameters of a third-party simulator."""


VERDICTS = {
    'no_gap': 'the residual is noise, or within the tolerances of the model',
    'identified': 'one cause, or several together, with size and probability',
    'ambiguous': 'several causes explain the data about equally well',
    'partial': 'causes that are probable, and a residual that they do not explain',
    'unknown': 'there is a gap, and no effect of the library explains it; nothing is added to the '
               'model',
    'not_excited': 'the motion is too small to decide',
    'invalid_data': 'the recording contradicts itself or lacks a stream',
}
"""Meaning of each verdict, as docs/reference/verdicts.md has it."""


def phrase(name: str) -> str:
    """Say what an effect is, without numbers."""
    known = WORDS.get(kind_of(name))
    return known.phrase if known else f'{name} is not what the simulator has'


def sentence(effect: NamedEffect) -> str:
    """Say what was found and how large it is, without the full stop."""
    known = WORDS.get(kind_of(effect.name))
    if known is None:  # a parameter of a third-party simulator
        return f'{effect.name} should be {sizes(effect).removeprefix("value ")}'
    text = known.sentence
    for name, p in effect.parameters.items():
        text = text.replace(f'{{{name}}}', number(effect.name, name, p))
    return text.replace(ALL, sizes(effect))


def sizes(effect: NamedEffect) -> str:
    """List the numbers of an effect that are beyond chance, or all where none is."""
    real = {k: p for k, p in effect.parameters.items() if not _shapes(effect.name, k)}
    sure = {k: p for k, p in real.items()
            if p.at_bound or abs(p.value - _nominal(effect.name, k)) > BEYOND * p.std}
    return ', '.join(f'{_called(k)} {number(effect.name, k, p)}' for k, p in
                     (sure or real or effect.parameters).items())


def number(effect: str, name: str, p: Parameter) -> str:
    """Write a number of an effect ± its 95 % interval; one that only shapes it has no percent."""
    plain = _shapes(effect, name) or effect not in WORDS
    known = _quantities(effect).get(name)
    signed = known is None or known.low < 0.0 <= known.high
    text = quantity(p.value, 0.0 if p.at_bound else HALF * p.std, '' if p.unit == '1' and plain
                    else p.unit, signed=signed and not plain).strip()
    return f'{text} ({AT_BOUND})' if p.at_bound else text


def _called(name: str) -> str:
    return name.replace('_of_', ' of ').replace('_', ' ')


def _quantities(effect: str) -> dict[str, Quantity]:
    return {q.name: q for q in EFFECTS[effect].parameters} if effect in EFFECTS else {}


def _shapes(effect: str, name: str) -> bool:
    known = _quantities(effect).get(name)
    return bool(known and known.shapes)


def _nominal(effect: str, name: str) -> float:
    known = _quantities(effect).get(name)
    return float(known.nominal) if known else 0.0
