"""Where nothing hangs but the added mass: means of poses, integer counts, a bent sensor."""

from dataclasses import replace
from pathlib import Path

from forcecal_ros.core.errors import ConfigError, DataError, UnobservableError
from forcecal_ros.insitu import calibrate, Chunk, DataSet, Load, load_spec, Mounting, Options
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
G = 9.80665
LOADS = (Load(0.3, (0.0, 0.0, 0.03)), *(Load(1.0, (x, y, 0.05))
                                        for x in (-0.03, 0.03) for y in (-0.03, 0.03)))
GAUGES = np.random.default_rng(3).normal(size=(8, 6)) * [20, 20, 20, 300, 300, 300]
POSES = Options(poses=True, body=False)


def gravity(seed, poses=12):
    g = np.random.default_rng(seed).normal(size=(poses, 3))
    return G * g / np.linalg.norm(g, axis=1, keepdims=True)


def counts(g, load, bend):
    """Return what eight gauges show of a load, in whole counts; ``bend`` of a range squared."""
    force = load.mass * g
    raw = np.hstack([force, np.cross(load.position, force)]) @ GAUGES.T
    return np.round(300 + raw + bend * raw ** 2 / 400)


def data_set(k, bend=0.0, train=True, repeated=1):
    g = np.repeat(gravity(k), repeated, axis=0)
    raw = counts(g, LOADS[k], bend)
    chunk = Chunk(np.arange(len(g)) / 100, raw, -g, None)
    return DataSet(f'place {k}', lambda: chunk, LOADS[k], train)


def calibrated(bend=0.0, out=None, options=POSES):
    return calibrate('cell', [data_set(k, bend, k != out) for k in range(5)], Mounting(), options)


def test_whole_counts_of_still_poses_give_the_load_of_a_place_left_out():
    for out in (0, 2):
        found = calibrated(out=out).data_sets[out]
        step = 0.01  # a count is 0.05 N beside 12 poses
        assert abs(float(found.added_mass.value) - LOADS[out].mass) < step
        assert np.abs(found.position.value - LOADS[out].position).max() < 0.003


def test_a_linear_sensor_is_not_called_bent():
    assert not any('nonlinear' in warning for warning in calibrated().warnings)


@pytest.mark.parametrize('out', [0, 3])
def test_a_bent_sensor_is_named_and_its_standard_errors_hold_the_bend(out):
    result = calibrated(1.0, out)
    found = result.data_sets[out].added_mass
    assert any('nonlinear' in warning for warning in result.warnings)
    assert abs(float(found.value) - LOADS[out].mass) < 3 * float(found.std)
    assert float(found.std) > 0.01


def test_still_counts_of_seconds_a_pose_are_neither_clipped_nor_shaken():
    sets = [data_set(k, repeated=200) for k in range(5)]
    result = calibrate('cell', sets, Mounting(), Options(body=False))
    assert np.allclose([d.added_mass.value for d in result.data_sets],
                       [load.mass for load in LOADS], atol=0.01)
    assert not any('clipped' in warning or 'shaken' in warning for warning in result.warnings)


def test_places_on_a_line_are_refused():
    sets = [replace(data_set(k), load=Load(1.0, (0.02 * k, 0.0, 0.05))) for k in range(4)]
    with pytest.raises(UnobservableError, match='off the line of the others'):
        calibrate('cell', sets, Mounting(), POSES)


def test_a_bent_sensor_with_an_unknown_body_is_refused_for_its_bend():
    sets = [data_set(0), *(data_set(k, 2.0) for k in range(1, 5))]
    sets[0] = replace(sets[0], load=Load(0.0))
    with pytest.raises(UnobservableError, match='nonlinear'):
        calibrate('cell', sets, Mounting(), Options(poses=True))


def test_a_negative_mass_is_no_answer():
    sets = [replace(data_set(k), train=k != 1, load=LOADS[k]) for k in range(5)]
    turned = Chunk(np.arange(12) / 100, counts(-gravity(1), LOADS[1], 0.0), -gravity(1), None)
    sets[1] = DataSet('turned', lambda: turned, LOADS[1], False)
    with pytest.raises(DataError, match=r'turned is estimated as -0.99\d ± .* kg: the stated'):
        calibrate('cell', sets, Mounting(), POSES)


def test_the_example_of_poses_is_read_and_wants_every_mass(tmp_path):
    example = ROOT / 'config' / 'examples' / 'insitu_poses.yaml'
    options = load_spec(example).options
    assert options.poses and not options.body
    path = tmp_path / 'spec.yaml'
    path.write_text(example.read_text().replace('added_mass: 0.3, position: [0, 0, 0.03]', ''))
    with pytest.raises(ConfigError, match='added_mass'):
        load_spec(path)
