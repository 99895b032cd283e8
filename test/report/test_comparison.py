"""Two calibrations are told apart by the errors of both, and nothing that differs is left out."""

from dataclasses import replace
import json

from forcecal_ros.cli.main import main
from forcecal_ros.core.calibration import Estimate
from forcecal_ros.diagnose.dataset import units
from forcecal_ros.diagnose.judge.gap import Gap
from forcecal_ros.diagnose.judge.named_effects import NamedEffect, Parameter
from forcecal_ros.diagnose.localise import Location
from forcecal_ros.diagnose.result import Diagnosis, load_diagnosis
from forcecal_ros.diagnose.result import to_document as diagnosis_document
from forcecal_ros.io.calibration_file import save
from forcecal_ros.report.comparison import as_text, compare, to_document
import numpy as np
import pytest
from whole_calibration import whole_calibration

WHOLE = whole_calibration()


def test_a_change_has_the_interval_of_both():
    heavier = replace(WHOLE, mass=Estimate(13.006, 0.0009, 'kg'),
                      com=Estimate([0.0302, -0.01, 0.14], 1e-4, 'm'))
    found = compare(WHOLE, heavier)
    by_key = {one.first.key: one for one in found.changes}
    assert by_key['mass'].sigmas == pytest.approx(0.006 / np.hypot(0.001, 0.0009))
    # 1.4 standard errors are chance
    assert by_key['com.x'].sigmas == pytest.approx(2 ** 0.5)
    assert [one.first.key for one in found.changed] == ['mass']
    line = next(line for line in as_text(found).splitlines() if line.startswith('tool mass'))
    assert line.split() == ['tool', 'mass', '13.0000', '13.0060', '0.0060', '0.0026', 'kg',
                            'changed']
    assert as_text(found).endswith('95 % interval, tool mass most: +6.0 ± 2.6 g')


def test_a_number_of_unknown_error_is_shown_and_not_judged():
    moved = replace(WHOLE, accelerometer=replace(
        WHOLE.accelerometer, position=Estimate([0.5, 0, 0.18], np.nan, 'm')))
    one = next(one for one in compare(WHOLE, moved).changes
               if one.first.key == 'accelerometer.position.x')
    assert one.difference == pytest.approx(0.45) and one.sigmas is None
    assert not compare(WHOLE, moved).changed


def test_what_differs_besides_numbers_is_named():
    other = replace(WHOLE, wrench_sign=1, tool=None, accelerometer=replace(
        WHOLE.accelerometer, offset=Estimate([5.0, 5.0, 5.0], 0.1, 'm/s^2')))
    found = compare(WHOLE, other)
    assert found.settings['sensor.sign'] == (-1, 1)
    assert found.settings['accelerometer.offset.x.unit'] == ('V', 'm/s^2')
    assert found.only_first == ('tool.stiffness', 'tool.damping') and not found.only_second
    assert compare(other, WHOLE).only_second == found.only_first
    assert 'sensor.sign: -1, then 1' in as_text(found)


def test_the_command_prints_what_was_found_and_ends_with_0(capsys, tmp_path):
    before, after = str(tmp_path / 'before.yaml'), str(tmp_path / 'after.yaml')
    save(WHOLE, before)
    save(replace(WHOLE, matrix=Estimate(np.full((6, 7), 2.0), 0.1, 'N, N m per count')), after)
    assert main(['compare', before, after]) == 0
    out = capsys.readouterr().out
    assert '42 of ' in out and 'N m per count' in out and (
        'matrix force x 1 most: +1.00 ± 0.28 N per count' in out)
    assert main(['compare', before, after, '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['estimates']['matrix.force.x.1']['change'] == 1.0
    assert len(document['changed']) == 42
    assert to_document(compare(WHOLE, WHOLE))['changed'] == []
    assert main(['compare', before, str(tmp_path)]) == 1
    assert capsys.readouterr().err.count('\n') == 1


def late(delay, closed, verdict='identified', **more):
    return Diagnosis(
        verdict, 'because', effects=(NamedEffect('wrench_delay', {
            'delay': Parameter(delay, 1e-4, 's')}, 0.97),),
        candidates=(('wrench_delay', 0.97), ('unknown', 0.03)),
        localisation=(Location('wrench_sensor', 'force.x', 'step', (16.0, 32.0), 4.0, 1e-6),),
        gap=Gap(2.0, 1.5, 0.1, closed, (closed - 0.05, closed + 0.05),
                {'force.x': (0.4, 0.3, 0.1, 0.1)}), **more)


def test_two_diagnoses_are_told_apart_likewise(capsys, tmp_path):
    first, second = tmp_path / 'first', tmp_path / 'second'
    for folder, one in ((first, late(0.004, 0.9)),
                        (second, late(0.006, 0.88, 'partial', not_excited=('friction',)))):
        folder.mkdir()
        (folder / 'diagnosis.json').write_text(json.dumps(diagnosis_document(one, units(), None)))
    assert load_diagnosis(first)[0] == late(0.004, 0.9)
    told = late(0.004, 0.9, at_tolerance=('kp',), remarks=('a drive is at its limit',),
                joints=('elbow',))
    (tmp_path / 'told.json').write_text(json.dumps(diagnosis_document(told, units(), None)))
    assert load_diagnosis(tmp_path / 'told.json')[0] == told
    assert main(['compare', str(first), str(second / 'diagnosis.json')]) == 0
    out = capsys.readouterr().out
    assert 'verdict: identified, then partial' in out
    assert 'not excited: not stated, then friction' in out
    # 2 ms of 0.1 * sqrt(2) ms; the share changed by less than its interval
    assert '1 of 2 numbers changed' in out and (
        'wrench_delay delay most: +2.00 ± 0.28 ms' in out)
    assert main(['compare', str(first), str(second), '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['changed'] == ['effects.wrench_delay.delay']
    assert document['estimates']['gap.closed']['sigmas'] == pytest.approx(
        -0.02 / (0.05 / 1.96 * 2 ** 0.5))
    assert document['estimates']['gap.force.x']['first'] == pytest.approx(3.0)


def test_what_is_no_diagnosis_or_of_another_kind_is_one_line(capsys, tmp_path):
    good, calibration = tmp_path / 'good.json', tmp_path / 'c.yaml'
    document = diagnosis_document(late(0.004, 0.9), units(), None)
    good.write_text(json.dumps(document))
    save(WHOLE, str(calibration))
    assert main(['compare', str(good), str(calibration)]) == 2
    assert 'compare two diagnoses' in capsys.readouterr().err
    for text in ('{', '[]', json.dumps({**document, 'effects': [{}]}),
                 json.dumps({**document, 'gap': {'closed_ci95': 1}})):
        bad = tmp_path / 'bad.json'
        bad.write_text(text)
        assert main(['compare', str(good), str(bad)]) == 1
        err = capsys.readouterr().err
        assert err.count('\n') == 1 and str(bad) in err and 'diagnose again' in err
