"""The comparison of pinned answers, and the list of their cases."""

from pathlib import Path
import subprocess
import sys

import golden
from golden_cases import all_cases, Case
import pytest

BENCHMARK = Path(__file__).resolve().parents[2] / 'benchmark'

DELAY = Case('rig/delay', 'diagnoses', 'rig', 'rig', {}, 'rig', {'effects': ['wrench_delay']})
NONE = DELAY._replace(truth={'effects': []})


def diagnosed(grade, **values):
    return {'grade': grade, 'verdict': 'identified', 'values': values, 'seconds': 1.0,
            'digest': 'a'}


def found(verdict, *effects, candidates=()):
    return {'verdict': verdict, 'effects': list(effects), 'candidates': dict(candidates)}


@pytest.mark.parametrize('before, after, word', [
    ('exact', 'wrong', 'worse'), ('alias', 'missed', 'worse'), ('refused', 'off', 'worse'),
    ('exact', 'crashed', 'worse'), ('silent', 'time-out', 'worse'), ('wrong', 'first', 'better'),
    ('falsely refused', 'values', 'better'), ('exact', 'alias', 'lower'),
    ('refused', 'values', 'higher'), ('exact', 'exact', 'same'), ('wrong', 'missed', 'same')])
def test_an_answer_is_worse_when_it_was_right_and_is_not(before, after, word):
    assert golden.compare(diagnosed(before), diagnosed(after))[0] == word


def test_a_value_has_moved_when_it_differs_by_more_than_a_tenth_of_a_standard_error():
    one = diagnosed('exact', mass=[2.0, 0.1])
    assert golden.compare(one, diagnosed('exact', mass=[2.005, 0.1]))[0] == 'same'
    word, lines = golden.compare(one, diagnosed('exact', mass=[2.02, 0.1]))
    assert word == 'moved'
    assert 'mass: 2.0 -> 2.02' in lines[0]
    word, lines = golden.compare(diagnosed('exact', mass=[2.0, 0.1], com=[0.1, 0.1]),
                                 diagnosed('exact', mass=[2.0, 0.1], gain=[1.0, 0.1]))
    assert (word, lines) == ('moved', ['com: 0.1 -> none', 'gain: none -> 1.0'])


PINNED = {DELAY.name: diagnosed('exact')}
OTHER = {'digest': 'b'}


@pytest.mark.parametrize('now, status, said', [
    ({DELAY.name: diagnosed('wrong')}, 1, 'WORSE rig/delay'),
    ({DELAY.name: diagnosed('alias')}, 0, '1 lower'),
    ({DELAY.name: diagnosed('exact')}, 0, '1 same'),
    ({}, 1, 'NOT JUDGED rig/delay: its recording cannot be made'),
    ({DELAY.name: diagnosed('exact') | OTHER}, 0, '1 of another recording'),
    ({DELAY.name: diagnosed('wrong') | OTHER}, 1, '1 of another recording')])
def test_the_exit_status_is_1_for_an_answer_that_is_worse_or_cannot_be_judged(
        now, status, said, capsys):
    assert golden.report(PINNED, now, [DELAY]) == status
    shown = capsys.readouterr().out
    assert said in shown and ('WORSE' in shown) == (status == 1 and now != {})


def test_answers_without_a_case_or_a_pinned_one_are_named(capsys):
    assert golden.report(PINNED, {}, [], gone=[DELAY.name]) == 1
    assert 'NOT JUDGED rig/delay: it is pinned, and no case' in capsys.readouterr().out
    others = [DELAY._replace(name=name) for name in ('one', 'two')]
    assert golden.report({}, {'one': diagnosed('wrong')}, others) == 0
    assert '2 not pinned: one, two\n' in capsys.readouterr().out


def test_check_skips_real_recordings_that_are_absent_and_no_others(
        tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(golden, 'all_cases', lambda: [DELAY._replace(name='arm', family='real')])
    monkeypatch.setattr(golden, 'REAL_DATA', tmp_path / 'none')
    golden.write({name: diagnosed('exact') for name in ('arm', 'rig/gone')}, tmp_path / 'pinned')
    words = ['check', '--pinned', str(tmp_path / 'pinned'), '--out', str(tmp_path / 'out.json'),
             '--recordings', str(tmp_path / 'recordings')]
    assert golden.main(words) == 1
    said = capsys.readouterr().out
    assert '1 cases are skipped' in said and said.splitlines()[0].endswith(': arm')
    assert 'NOT JUDGED rig/gone' in said and 'NOT JUDGED arm' not in said
    assert golden.main([*words, '--only', 'arm']) == 0


@pytest.mark.parametrize('case, answer, grade', [
    (DELAY, found('identified', 'wrench_delay'), 'exact'),
    (DELAY, found('partial', 'wrench_delay', 'tool_com'), 'first'),
    (DELAY, found('ambiguous', 'wrench_lowpass', candidates={'wrench_delay': 0.3}), 'alias'),
    (DELAY, found('identified', 'wrench_lowpass'), 'wrong'),
    (DELAY, found('unknown', 'unknown'), 'missed'),
    (NONE, found('no_gap'), 'silent'), (NONE, found('unknown', 'unknown'), 'unknown'),
    (NONE, found('identified', 'tool_com'), 'false')])
def test_grades_of_diagnoses(case, answer, grade):
    assert golden.grade_of_diagnosis(case.truth, answer) == grade


def test_a_calibration_is_off_beyond_3_5_standard_errors_and_where_a_number_is_missing():
    truth = {'mass': 1.0, 'com.0': 0.01}
    assert not golden.errors({'mass': [1.03, 0.01], 'com.0': [0.01, 1e-4]}, truth)
    assert set(golden.errors({'mass': [1.05, 0.01]}, truth)) == {'mass', 'com.0'}


def test_list_prints_every_case():
    done = subprocess.run([sys.executable, BENCHMARK / 'golden.py', 'list'], check=True,
                          capture_output=True, text=True)
    names = [line.split('\t')[0] for line in done.stdout.splitlines()]
    assert names == [case.name for case in all_cases()]
    assert len(set(names)) == len(names) > 150
