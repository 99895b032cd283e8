"""What each effect means, in words."""

from forcecal_ros.core.quantity import quantity, scaled
from forcecal_ros.diagnose.judge.named_effects import AT_BOUND, NamedEffect, Parameter
from forcecal_ros.diagnose.model.gates import kind_of
from forcecal_ros.effects.library import EFFECTS, Quantity

WORDS = {
    'wrench_delay': 'the measured wrench lags the simulated one',
    'wrench_lowpass': 'a low-pass filter smooths the measured wrench',
    'wrench_bias_drift': 'the bias of the wrench drifts',
    'wrench_bias_step': 'the bias of the wrench steps',
    'wrench_gain': 'the gain of a force or torque channel differs',
    'wrench_crosstalk': 'one channel of the wrench shows part of another',
    'wrench_hysteresis': 'the wrench shows hysteresis',
    'wrench_saturation': 'the force sensor saturates',
    'wrench_quantisation': 'the wrench is quantised in coarse steps',
    'accel_delay': 'the measured acceleration lags the simulated one',
    'accel_gain': 'the gain of an accelerometer axis differs',
    'accel_bias': 'the bias of the accelerometer differs',
    'accel_misalignment': 'the accelerometer is rotated on its mount',
    'accel_highpass': 'the accelerometer is AC-coupled: a high-pass removes gravity',
    'accel_saturation': 'the accelerometer saturates',
    'accel_resonance': 'the mount of the accelerometer resonates',
    'tool_mass': 'the mass of the tool differs',
    'tool_com': 'the centre of mass of the tool differs',
    'tool_stiffness': 'the stiffness of the compliant axis differs',
    'tool_damping': 'the damping of the compliant axis differs',
    'tool_stiffening': 'the compliant axis stiffens with its deflection',
    'tool_friction': 'the compliant axis has dry friction',
    'tool_backlash': 'the compliant axis has backlash',
    'cable_force': 'a cable or hose pulls at the tool',
    'spindle_vibration': 'an unbalance shakes the tool',
    'robot_delay': 'the robot moves later than simulated',
    'robot_resonance': 'the arm resonates',
    'base_tilt': 'the base is tilted',
    'contact_stiffness': 'the stiffness of the contact differs',
    'contact_damping': 'the damping of the contact differs',
    'wall_position': 'the contact surface is at another place',
    'contact_friction': 'the friction of the contact differs',
    'clock_skew': 'the clock of a stream runs fast or slow',
    'dropouts': 'messages are lost',
    'unknown': 'none of the known effects',
}
"""By name of the effect; all others are parameters of a third-party simulator."""


VERDICTS = {
    'no_gap': 'the residual is noise, within the tolerances of the model, or too small to matter',
    'identified': 'one cause, or several together, with size and probability',
    'ambiguous': 'several causes explain the data about equally well',
    'partial': 'causes that are probable, and a residual that they do not explain',
    'unknown': 'there is a gap, and no effect of the library explains it; nothing is added to the '
               'model',
    'not_excited': 'the motion is too small to decide',
    'invalid_data': 'the data contradict themselves, lack a stream, or do not belong together',
}
"""Meaning of each verdict, as docs/reference/verdicts.md has it."""


def phrase(name: str) -> str:
    """Say what an effect is, without numbers."""
    return WORDS.get(kind_of(name), f'{name} differs from the simulator')


def sentence(effect: NamedEffect) -> str:
    """Say what was found and how large it is, without the full stop."""
    if kind_of(effect.name) not in WORDS:  # a parameter of a third-party simulator
        return sizes(effect)
    text = phrase(effect.name)
    return ': '.join(filter(None, (text[0].upper() + text[1:], sizes(effect))))


def sizes(effect: NamedEffect) -> str:
    """List the numbers of an effect that are beyond chance, or all if none is, and a frequency."""
    known = _quantities(effect.name)
    real = {k: p for k, p in effect.parameters.items() if k not in known or not known[k].shapes}
    # standard errors from which a number is one of those: 95 % of chance stays below
    sure = {k: p for k, p in real.items() if p.at_bound or abs(
        p.value - (known[k].nominal if k in known else 0.0)) > 2.0 * p.std}
    shown = {**(sure or real or effect.parameters),
             **{k: p for k, p in effect.parameters.items() if k == 'frequency'}}
    return ', '.join(f'{_called(k, effect.name)} {number(effect.name, k, p)}'
                     for k, p in shown.items())


def number(effect: str, name: str, p: Parameter) -> str:
    """Write a number of an effect; one that only shapes it is not in percent."""
    known = _quantities(effect).get(name)
    plain = effect not in WORDS or (known is not None and known.shapes)
    signed = known is None or known.low < 0.0 <= known.high
    unit, std = '' if p.unit == '1' and plain else p.unit, 0.0 if p.at_bound else p.std
    text = quantity(p.value, std, unit, signed=signed and not plain).strip()
    if p.nominal is not None:
        text = f'{scaled(p.value, unit, std)[1] * p.nominal:.5g} -> {text}'
    return f'{text} ({AT_BOUND})' if p.at_bound else text


def _called(name: str, effect: str) -> str:
    if name == 'value':  # of a third-party simulator's parameter
        return effect
    return name.replace('_of_', ' of ').replace('_', ' ')


def _quantities(effect: str) -> dict[str, Quantity]:
    """Return the numbers of an effect of the library, by name."""
    return {q.name: q for q in EFFECTS[effect].parameters} if effect in EFFECTS else {}
