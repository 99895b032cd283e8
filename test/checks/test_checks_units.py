"""An accelerometer at rest tells its unit; a light tool is asked whether its newtons are any."""

from forcecal_ros.checks.gravity import refuse_on_another_link, refuse_other_unit
from forcecal_ros.checks.hypotheses import questions_of
from forcecal_ros.core.errors import DataError
import numpy as np
import pytest

G = 9.81


def at_rest(scale, offset=0.0, gain=1.0, seed=0):
    directions = np.random.default_rng(seed).standard_normal((6, 3))
    return scale * (gain * G * directions / np.linalg.norm(directions, axis=1)[:, None] + offset)


@pytest.mark.parametrize('offset, gain', [(0.0, 1.0), (0.5, 1.1), (-0.5, 0.9)])
def test_gravity_in_its_unit_is_left_alone(offset, gain):
    for seed in range(5):
        refuse_other_unit(at_rest(1.0, offset, gain, seed), G)


@pytest.mark.parametrize('scale, said', [
    (1 / 9.80665, 'it is in g; multiply by 9.80665 '),
    (1e3 / 9.80665, 'it is in mg; multiply by 0.00980665 .*unit: mg'),
    (1e3, r'it is in mm/s\^2; multiply by 0.001 '), (0.01, 'the driver subtracts gravity'),
    (3.0, 'its gain is wrong; divide by ')])
@pytest.mark.parametrize('offset, gain', [(0.0, 1.0), (0.3, 1.05)])
def test_another_unit_is_named_with_what_to_multiply_by(scale, said, offset, gain):
    with pytest.raises(DataError, match=f'accelerometer: it reads .* at rest.*{said}'):
        refuse_other_unit(at_rest(scale, offset, gain), G)


def test_no_gravity_is_the_drivers_doing_unless_it_decays():
    with pytest.raises(DataError, match='subtracts gravity; configure it to publish') as no:
        refuse_other_unit(at_rest(0.01), G)
    assert '--coupling' not in str(no.value)
    with pytest.raises(DataError, match='AC-coupled; pass --coupling ac$'):
        refuse_other_unit(at_rest(0.01), G, decays=True)


def test_a_tool_of_a_kilogram_in_another_unit_is_questioned():
    near, unbiased = np.array([0.0, 0.0, 0.1]), np.zeros(3)
    question, = questions_of(0.932 / 9.80665, near, unbiased)
    assert 'pass --tool-mass' in question
    assert 'If it weighs 0.932 kg, the forces are in kgf' in question
    question, = questions_of(0.932 / 4.448, near, unbiased)
    assert 'if 0.932 kg, in lbf' in question
    for mass, bias in ((1300.0, unbiased), (0.932, [3.0, -800.0, 0.0])):
        question, = questions_of(mass, near, bias)
        assert 'counts of a converter' in question
    question, = questions_of(1.0, near * 0.7 / 0.11298, unbiased)
    assert 'If it is 0.07 m, the torques are in lbf in' in question
    assert not [*questions_of(0.932, 2.0 * near, unbiased),
                *questions_of(40.0, unbiased, [300.0, -20.0, 50.0])]


def test_an_accelerometer_that_does_not_turn_with_the_pose_is_on_another_link():
    gravity = at_rest(1.0)
    refuse_on_another_link(-0.9 * gravity[:, [1, 0, 2]] + 0.5, gravity)
    refuse_on_another_link(np.tile([0.0, 0.0, G], (6, 1)), np.tile([0.0, 0.0, -G], (6, 1)))
    with pytest.raises(DataError, match='is not mounted on the tool; select'):
        refuse_on_another_link(0.01 * gravity + [0.0, 0.0, G], gravity)
