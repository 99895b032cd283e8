"""Many recordings: the same answers on one core, several, or a cluster, whoever is killed."""

import json
import os

from forcecal_ros.cli.main import main
from forcecal_ros.cli.many import each
from forcecal_ros.core.errors import ConfigError
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.calibration_file import save
from longer import first
import numpy as np
from observing import calibration, record, Swing
import pytest
from scale_work import always_killed, killed_at_first, meet, square

distributed, dask = pytest.importorskip('distributed'), pytest.importorskip('dask')

NAMES = ('one', 'two', 'friday/one')
SWING = Swing(place=(0.012, 0.004, 0.006), turn=0.2)


@pytest.fixture(scope='module')
def cluster():
    """Start a scheduler and two worker processes of one thread each; return the address."""
    # how long the scheduler looks for what a dead worker had done
    with (dask.config.set({'distributed.comm.timeouts.connect': '2s'}),
          distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
          as local):
        yield local.scheduler_address


def values(outcomes):
    return {outcome.index: outcome.value for outcome in outcomes}


def test_one_failure_stops_nobody_and_says_why():
    outcomes = list(each(square, [3, -1, 2, 'x']))
    assert [outcome.value for outcome in outcomes[:3]] == [9, None, 4]
    assert outcomes[1].error == '-1 is negative [FC0001]'
    assert outcomes[3].error.startswith('TypeError: ') and 'scale_work.py' in outcomes[3].error


def test_outcomes_come_as_they_are_done():
    waiting = each(square, range(1, 1000))
    assert next(waiting).value == 1


def test_work_is_spread_over_processes(tmp_path):
    pids = set(values(each(meet, [str(tmp_path)] * 8, jobs=2)).values())
    assert len(pids) == 2 and os.getpid() not in pids


@pytest.mark.long
def test_a_process_killed_half_way_costs_nothing_but_time(tmp_path):
    tasks = [(number, str(tmp_path / 'mark')) for number in range(6)]
    assert values(each(killed_at_first, tasks, jobs=2)) == {i: i * i for i in range(6)}
    assert (tmp_path / 'mark').exists()


def test_an_item_that_kills_whoever_works_on_it_is_given_up_alone():
    outcomes = {outcome.index: outcome for outcome in each(always_killed, range(4), jobs=2)}
    assert {i: one.value for i, one in outcomes.items()} == {0: 0, 1: None, 2: 2, 3: 3}
    assert 'killed' in outcomes[1].error


@pytest.mark.long
def test_a_worker_of_a_cluster_killed_half_way_costs_nothing_but_time(cluster, tmp_path):
    tasks = [(number, str(tmp_path / 'mark')) for number in range(6)]
    assert values(each(killed_at_first, tasks, dask=cluster)) == {i: i * i for i in range(6)}
    assert (tmp_path / 'mark').exists()


def test_a_cluster_that_is_not_there_is_said_so():
    with pytest.raises(ConfigError, match='no Dask scheduler answers at nowhere'):
        list(each(square, [1, 2], dask='nowhere'))


@pytest.fixture(scope='module')
def fleet(tmp_path_factory):
    """Write three recordings, the last of another day, and their calibration."""
    folder = tmp_path_factory.mktemp('fleet')
    for i, name in enumerate(NAMES):
        (folder / name).parent.mkdir(exist_ok=True)
        write_recording(folder / name, record(1.5, SWING, seed=i))
    save(calibration(), folder / 'calibration.yaml')
    return folder


def estimated(folder, *names):
    topic = {'wrench': '/observer/contact_wrench'}
    return [read_recording(folder / name, topic).wrench.values for name in names]


@pytest.fixture(scope='module')
def alone(fleet, tmp_path_factory):
    """Estimate the recordings one by one; return the contact wrenches."""
    folder = tmp_path_factory.mktemp('alone')
    (folder / 'friday').mkdir()
    for name in NAMES:
        assert main(['estimate', str(fleet / name), '--calibration',
                     str(fleet / 'calibration.yaml'), '-o', str(folder / name)]) == 0
    return estimated(folder, *NAMES)


@pytest.mark.parametrize('where', first(['jobs', 'dask']))
def test_many_recordings_are_estimated_as_one_by_one_to_the_bit(
        capsys, fleet, alone, tmp_path, where, request):
    known = ['--calibration', str(fleet / 'calibration.yaml')]
    at = ['--jobs', '2'] if where == 'jobs' else ['--dask', request.getfixturevalue('cluster')]
    capsys.readouterr()
    assert main(['estimate', *(str(fleet / name) for name in NAMES), *known, *at,
                 '-o', str(tmp_path / 'b'), '--json']) == 0
    documents = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {one['recording'] for one in documents} == {str(fleet / name) for name in NAMES}
    for one_by_one, together in zip(alone, estimated(tmp_path / 'b', *NAMES)):
        np.testing.assert_array_equal(one_by_one, together)


def test_a_list_of_recordings_leaves_out_what_cannot_be_read_and_says_so(
        capsys, fleet, tmp_path):
    (tmp_path / 'list').write_text(f'# a comment\n{fleet}/one\n\n{fleet}/nothing\n')
    (tmp_path / 'out' / 'nothing').mkdir(parents=True)
    (tmp_path / 'out' / 'nothing' / 'old').write_text('of an earlier run')
    status = main(['estimate', f'@{tmp_path}/list', '--calibration',
                   str(fleet / 'calibration.yaml'), '-o', str(tmp_path / 'out')])
    said = capsys.readouterr()
    assert status == 1 and 'nothing does not exist' in said.err
    assert '1 of 2 recordings' in said.out
    assert len(estimated(tmp_path / 'out', 'one')[0]) == 1500
    # what an earlier run found does not stand beside the answer of this one
    assert sorted(os.listdir(tmp_path / 'out')) == ['nothing~', 'one']
    assert (tmp_path / 'out' / 'nothing~' / 'old').read_text() == 'of an earlier run'


def test_two_recordings_of_one_name_never_overwrite_each_other(capsys, fleet, tmp_path):
    bag = next((fleet / 'one').glob('*.mcap'))
    assert main(['estimate', str(bag), str(bag.with_suffix('.db3')), '--calibration',
                 str(fleet / 'calibration.yaml'), '-o', str(tmp_path / 'out')]) == 2
    assert 'would both be written to' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()
