"""Stated loads, frames and channels that cannot be are named; those of careful hands are not."""

from dataclasses import replace
from functools import partial
import re

from forcecal_ros.core.errors import ConfigError, DataError, ForcecalError, UnobservableError
from forcecal_ros.insitu import calibrate, Chunk, DataSet, Load, load_spec, Mounting, Options
from longer import first
import numpy as np
import pytest
import yaml

G = 9.80665
PLACES = ((0.0, 0.0, 0.0), (0.15, 0.02, 0.1), (-0.04, 0.16, 0.12), (-0.1, -0.12, 0.15),
          (0.05, -0.1, 0.22))
LOADS = tuple(Load(0.0 if k == 0 else 1.0 + 0.2 * k, place) for k, place in enumerate(PLACES))
BODY, COM = 1.5, np.array([0.01, -0.02, 0.09])
OFFSET = np.array([500.0, -300.0, 120.0, 900.0, -700.0, 50.0])
MAP = np.linalg.qr(np.random.default_rng(8).normal(size=(6, 6)))[0] / [
    30.0, 30.0, 30.0, 4.0, 4.0, 4.0] * 3000.0
POSES = Options(poses=True, mass_error=0.001, place_error=0.001)


def recorded(seed, place_error=0.001, mass_error=0.001, poses=14):
    """Poses of each load, with errors of the hands that screwed it on: t, raw, gravity."""
    rng = np.random.default_rng(seed)
    for load in LOADS:
        g = rng.normal(size=(poses, 3))
        g *= G / np.linalg.norm(g, axis=1, keepdims=True)
        mass = load.mass * (1 + mass_error * rng.normal())
        com = np.array(load.position) + place_error * rng.normal(size=3)
        force = (BODY + mass) * g
        raw = np.hstack([force, np.cross(BODY * COM + mass * com, g)]) @ MAP.T + OFFSET
        yield raw + 1.5 * rng.normal(size=raw.shape), g + 0.002 * rng.normal(size=g.shape)


def sets_of(seed, loads=LOADS, change=lambda k, raw, g: (raw, g), **errors):
    found = []
    for k, ((raw, g), load) in enumerate(zip(recorded(seed, **errors), loads)):
        raw, g = change(k, raw, g)
        chunk = Chunk(np.arange(len(g)) * 1.0, raw, -g, None)
        found.append(DataSet(f'set {k}', partial(Chunk, *chunk), load))
    return found


def said(sets, options=POSES, manufacturer=None):
    """Return the refusal, or all that was said beside the result."""
    try:
        return ' | '.join(calibrate('cell', sets, Mounting(), options, manufacturer).warnings)
    except ForcecalError as error:
        return str(error)


def stated(number, **change):
    return [replace(load, **change) if k == number else load for k, load in enumerate(LOADS)]


@pytest.mark.parametrize('seed', first(range(3)))
def test_careful_hands_contradict_nothing_and_standard_errors_hold_them(seed):
    result = calibrate('cell', sets_of(seed), Mounting(), POSES)
    assert result.warnings == ()
    off = (result.matrix.value - np.linalg.inv(MAP)) / result.matrix.std
    assert np.sqrt((off ** 2).mean()) < 3.0


@pytest.mark.parametrize('loads, words', [
    (stated(2, mass=1.54), 'except set 2 agree: they give its load as 1.4.. kg .* 1.54 kg'),
    (stated(3, position=(-0.1, -0.12, 0.20)),
     r'except set 3 .* 1\.\d+ kg at \(-0.[01].., -0.1.., 0.1[45].\) m; stated are 1.6 kg'),
    pytest.param([LOADS[k] for k in (0, 3, 2, 1, 4)], 'no single data set .* swapped loads',
                 marks=pytest.mark.long),
    pytest.param([replace(one, position=(-one.position[1], one.position[0], one.position[2]))
                  for one in LOADS],
                 r'no single data set .*R_sensor_accelerometer', marks=pytest.mark.long)])
def test_a_wrong_load_is_named_with_what_the_others_say(loads, words):
    assert re.search(words, said(sets_of(1, loads)))


@pytest.mark.parametrize('change, words', [
    pytest.param(lambda k, raw, g: (raw, g * [1, -1, 1]), 'left-handed', marks=pytest.mark.long),
    pytest.param(lambda k, raw, g: (raw, -g if k == 2 else g), 'except set 2 agree',
                 marks=pytest.mark.long),
    (lambda k, raw, g: (raw - raw[0], g), 'offset changed between data sets'),
    (lambda k, raw, g: (raw[:, ::-1] if k == 1 else raw, g), 'set 1'),
    (lambda k, raw, g: (np.where(np.arange(6) == 2, raw % 7.0, raw), g),
     'channel 3 does not respond to gravity')])
def test_wrong_axes_signs_tares_and_channels_are_named(change, words):
    assert words in said(sets_of(2, change=change))


def test_a_load_that_was_kept_back_is_held_against_what_is_found():
    sets = sets_of(3, stated(4, mass=2.2))
    sets[4] = replace(sets[4], train=False)
    assert 'set 4: the calibrated sensor finds 1.8' in said(sets)


def test_the_manufacturers_matrix_tells_a_sign_and_pounds():
    maker = np.linalg.inv(MAP)
    assert 'have the opposite sign' in said(
        sets_of(4, change=lambda k, raw, g: (raw, -g)), POSES, maker)
    pounds = [replace(load, mass=load.mass / 0.45359237) for load in LOADS]
    assert 'masses are in lb' in said(sets_of(4, pounds), POSES, maker)
    assert said(sets_of(4), POSES, maker) == ''


def test_turning_about_one_axis_is_refused_for_that():
    def about_one_axis(k, raw, g):
        a = np.linspace(-1, 1, len(g))
        return raw, G * np.stack([np.sin(a), 0 * a, np.cos(a)], axis=1) + 0.002 * np.sin(g)

    with pytest.raises((DataError, UnobservableError), match='too little along y'):
        calibrate('cell', sets_of(5, change=about_one_axis), Mounting(), POSES)


@pytest.mark.parametrize('load, words', [
    ({'added_mass': 510, 'position': [0, 0, 0.1]}, 'added_mass is 510.*is it in g'),
    ({'added_mass': 0.5, 'position': [30, 0, 100]}, 'position is .*is it in mm or cm')])
def test_grams_and_millimetres_are_refused_with_the_key(tmp_path, load, words):
    path = tmp_path / 'spec.yaml'
    path.write_text(yaml.safe_dump({
        'format': 'forcecal-insitu/1', 'accelerometer': {'columns': [6, 7, 8]},
        'sensors': {'cell': {'columns': list(range(6))}},
        'data_sets': [{'file': 'a.csv', **load}]}))
    with pytest.raises(ConfigError, match=words):
        load_spec(path)
