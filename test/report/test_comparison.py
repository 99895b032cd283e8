"""Two calibrations are told apart by the errors of both, and nothing that differs is left out."""

from dataclasses import replace
import json

from forcecal_ros.calibration.file import save
from forcecal_ros.calibration.model import Estimate
from forcecal_ros.cli import main
from forcecal_ros.report.comparison import as_text, compare, to_document
import numpy as np
import pytest
from whole_calibration import whole_calibration

WHOLE = whole_calibration()


def test_a_change_is_told_in_the_standard_errors_of_both():
    heavier = replace(WHOLE, mass=Estimate(13.006, 0.0009, 'kg'),
                      com=Estimate([0.0302, -0.01, 0.14], 1e-4, 'm'))
    found = compare(WHOLE, heavier)
    by_key = {one.first.key: one for one in found.changes}
    assert by_key['mass'].sigmas == pytest.approx(0.006 / np.hypot(0.001, 0.0009))
    # 1.4 standard errors are chance
    assert by_key['com.x'].sigmas == pytest.approx(2 ** 0.5)
    assert [one.first.key for one in found.changed] == ['mass']
    line = next(line for line in as_text(found).splitlines() if line.startswith('tool mass'))
    assert line.split() == ['tool', 'mass', '13.0000', '13.00600', '0.0060', '+4.5', 'kg']
    assert as_text(found).endswith('standard errors, tool mass most (+4.5)')


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
    assert '42 of ' in out and 'N m per count' in out and 'matrix force x 1 most (+7.1)' in out
    assert main(['compare', before, after, '--json']) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['estimates']['matrix.force.x.1']['change'] == 1.0
    assert len(document['changed']) == 42
    assert to_document(compare(WHOLE, WHOLE))['changed'] == []
    assert main(['compare', before, str(tmp_path)]) == 1
    assert capsys.readouterr().err.count('\n') == 1
