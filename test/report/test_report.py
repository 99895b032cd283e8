"""The report shows the numbers, escapes what it was given, and needs no network."""

from dataclasses import replace
import re

from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.core.streams import Phase, PoseStream, Recording, Stream
from forcecal_ros.report.calibration import in_words, render
from forcecal_ros.report.rows import as_text, Row, table
import numpy as np
import pytest


@pytest.fixture
def calibration():
    return Calibration(
        mass=Estimate(13.0012, 0.0011, 'kg'), com=Estimate([0.03, -0.01, 0.14], 1e-4, 'm'),
        wrench_bias=Estimate([4, -3, 8, 0.3, -0.2, 0.1], 0.01, 'N, N m'),
        quality={'warnings': ['<script>alert(1)</script> & more'], 'chi2': 1.25},
        source={'recording': '<b>bag</b>', 'created': 'today'})


@pytest.fixture
def recording():
    t = np.arange(400) / 100
    R = np.broadcast_to(np.diag([1.0, -1.0, -1.0]), (400, 3, 3))
    return Recording(
        wrench=Stream(t, np.ones((400, 6)), 'ft_sensor'),
        pose=PoseStream(t, np.zeros((400, 3)), R),
        phases=(Phase('measure', 0.0, 2.0), Phase('measure', 2.0, 4.0)))


def test_intervals_decide_how_many_digits_are_shown(calibration):
    line = as_text(table(calibration)).splitlines()[2]
    assert line.split() == ['tool', 'mass', '13.0012', '0.0022', 'kg']


def test_a_table_for_a_terminal_has_the_digits_and_units_of_the_page():
    rows = [Row('delay', 'delay', 's', 0.0040021, 0.00014), Row('rise', 'rise', 's', 0.0140837,
                                                                np.nan),
            Row('share', 'share', '1', 0.51234, 0.004)]
    assert [line.split() for line in as_text(rows).splitlines()[2:-1]] == [
        ['delay', '4.00', '0.27', 'ms'], ['rise', '14.1', '-', 'ms'], ['share', '0.512', '0.008']]


def test_a_quantity_has_one_unit_in_a_table():
    rows = [Row('x', 'x', 'N m', 0.026, np.nan), Row('z', 'z', 'N m', 0.00936, np.nan),
            Row('xx', 'xx', 'kg m^2', 0.12, 0.001), Row('xy', 'xy', 'kg m^2', 0.002, 0.001)]
    assert [line.split()[1:] for line in as_text(rows).splitlines()[2:-1]] == [
        ['0.0260', '-', 'N', 'm'], ['0.00936', '-', 'N', 'm'],
        ['0.1200', '0.0020', 'kg', 'm^2'], ['0.0020', '0.0020', 'kg', 'm^2']]


def test_forces_and_torques_have_units_of_their_own(calibration):
    units = {row.key: row.unit for row in table(calibration)}
    assert units['wrench_bias.force.z'] == 'N' and units['wrench_bias.torque.x'] == 'N m'


def test_an_error_below_the_last_digit_is_no_zero_and_no_distance():
    exact = Row('map xx', 'map.xx', '1', 0.9999999991, 2e-9, 1.0)
    assert as_text([exact]).splitlines()[2].split() == [
        'map', 'xx', '1', '<', '1e-7', '1', '0']


def test_the_truth_stands_beside_with_its_distance(calibration):
    rows = table(calibration, {'mass': np.array(13.0)})
    assert rows[0].truth == 13.0
    assert as_text(rows).splitlines()[2].split() == [
        'tool', 'mass', '13.0012', '0.0022', 'kg', '13.0000', '0.0012']


@pytest.mark.parametrize('truth', [None, {'mass': np.array(13.0)}])
def test_a_page_has_one_notation_of_uncertainty_and_explains_it_once(
        calibration, recording, truth):
    page = render(recording, calibration, truth=truth)
    assert page.count('95 %') == page.count('± is the half-width of the 95 % interval.') == 1
    assert page.index('is the half-width') < page.index('13.0012\u00a0±\u00a00.0022\u00a0kg')
    assert not re.search('sigma|σ|standard error', page)


def test_what_a_recording_says_is_escaped(calibration, recording):
    page = render(recording, calibration)
    assert '<script>' not in page and '&lt;script&gt;' in page
    assert '<b>bag' not in page


def test_one_file_without_network(calibration, recording):
    contact = Stream(recording.wrench.t, recording.wrench.values)
    page = render(recording, calibration, contact)
    assert re.findall(r'(?:src|href)="(?!data:|file:)', page) == []
    assert page.count('<img') == 2
    assert page.index('<h2>Force before and after') < page.index('<h2>Estimates') < page.index(
        '<details>')


def test_the_first_sentence_says_what_becomes_of_weight_and_inertia(calibration, recording):
    still = replace(recording, wrench=replace(recording.wrench, values=np.tile(
        [4.0, -3.0, 108.0, 0.0, 0.0, 0.0], (400, 1))))
    contact = Stream(still.wrench.t, np.tile([0.3, 0.0, 0.4, 0.0, 0.0, 0.0], (400, 1)))
    assert ('In free motion the sensor shows 100 N; 0.50 N RMS remain after compensation'
            in render(still, calibration, contact).replace('\u00a0', ' '))
    touching = replace(still, phases=(Phase('contact', 0.0, 4.0),))
    assert 'In free motion' not in render(touching, calibration, contact)


def test_quality_is_said_in_words():
    said = dict(in_words({'condition': 1.7361, 'residual_rms': [0.0036, 0.0055, 0.0039, 3e-4] + [
        6e-5, 1e-4], 'chi_square': {'value': 3.789, 'degrees': 8, 'probability': 0.0012},
        'notes': ['x points along +x'], 'questions': []}))
    assert said['Residual at rest'].startswith('3.6, 5.5, 3.9 mN and 0.30, ')
    assert said['Fit of the poses'] == ('They do not fit one rigid tool: chi-square 3.79 for 8 '
                                        'degrees of freedom (probability 0.0012).')
    assert said['Note'] == 'X points along +x.' and not dict(in_words({}))
    untested = {'value': float('nan'), 'degrees': 8, 'probability': float('nan')}
    assert 'Not tested' in dict(in_words({'chi_square': untested}))['Fit of the poses']


def test_poses_that_separate_nothing_alone_and_a_missing_estimate_are_stated(
        calibration, recording):
    few = {'condition': 414000.0, 'poses': [{}, {}, {}]}
    assert dict(in_words(few))['Poses'] == (
        '3 poses do not separate mass, centre of mass and bias alone; the motion between them '
        'does.')
    note = 'inertia not identified: no rotation was recorded; rotate about all three axes'
    page = render(recording, replace(calibration, quality={'notes': [note]}))
    assert page.index('its checks') < page.index('>Inertia not identified: no rotation'
                                                  ) < page.index('<table')
    assert 'said warn' not in render(recording, replace(calibration, quality={}))


def test_warnings_come_before_the_numbers(calibration, recording):
    page = render(recording, calibration)
    assert page.index('bad warning"') < page.index('<table')


def test_an_inertia_has_six_rows():
    inertia = Estimate(np.diag([0.12, 0.15, 0.06]), np.full((3, 3), 1e-4), 'kg m^2')
    rows = table(Calibration(mass=Estimate(13.0, 0.1, 'kg'), com=Estimate(np.zeros(3), 1e-4, 'm'),
                             wrench_bias=Estimate(np.zeros(6), 0.01, 'N, N m'), inertia=inertia))
    assert sum(row.name.startswith('inertia') for row in rows) == 6
