"""What a result may take the place of: files and folders; all else is written to, or refused.

Devices, pipes and links are made in a folder of the test's own, never those of the machine.
"""

import os
from pathlib import Path
import socket
import stat
import subprocess
import sys
from threading import Thread

from forcecal_ros.core.errors import ConfigError
from forcecal_ros.core.files import (
    descriptor_of,
    new_directory,
    refuse_file,
    refuse_folder,
    write_text,
)
import pytest

NULL, FULL, LOOP = (1, 3), (1, 7), (7, 200)


def node(path, kind, numbers):
    """Make a device of one's own; skip where that is not allowed, or a device is no device."""
    try:
        os.mknod(path, kind | 0o666, os.makedev(*numbers))
        if kind == stat.S_IFCHR:
            os.close(os.open(path, os.O_WRONLY))
    except OSError as error:
        pytest.skip(f'{path} cannot be made or opened as a device: {error.strerror}')
    return path


@pytest.mark.parametrize('numbers', [NULL, FULL], ids=['null', 'full'])
def test_a_device_is_written_to_and_stays(tmp_path, numbers):
    device = node(tmp_path / 'device', stat.S_IFCHR, numbers)
    (tmp_path / 'link').symlink_to(device)
    for path in (device, tmp_path / 'link'):
        refuse_file(path)
        if numbers == NULL:
            write_text(path, 'text')
        else:
            with pytest.raises(ConfigError, match='No space left on device'):
                write_text(path, 'text')
    assert stat.S_ISCHR(device.lstat().st_mode)
    assert device.stat().st_rdev == os.makedev(*numbers)
    assert sorted(os.listdir(tmp_path)) == ['device', 'link']


def disk(path):
    return node(path, stat.S_IFBLK, LOOP)


def bound(path):
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))
    return path


def pipe(path):
    os.mkfifo(path)
    return path


@pytest.mark.parametrize('make', [disk, bound])
def test_what_cannot_be_written_to_is_refused_and_stays(tmp_path, make):
    path = make(tmp_path / 'it')
    kind = path.lstat().st_mode
    for attempt in (refuse_file, lambda path: write_text(path, 'text')):
        with pytest.raises(ConfigError, match='it is neither a file nor a folder'):
            attempt(path)
    assert path.lstat().st_mode == kind and os.listdir(tmp_path) == ['it']


@pytest.mark.parametrize('make', [disk, bound, pipe])
def test_nothing_but_a_folder_or_file_gives_way_to_a_folder(tmp_path, make):
    path = make(tmp_path / 'it')
    for attempt in (lambda: refuse_folder(path, replaced=True),
                    lambda: refuse_folder(path, replaced=False), new_directory(path).__enter__):
        with pytest.raises(ConfigError, match='it is neither a file nor a folder'):
            attempt()
    assert os.listdir(tmp_path) == ['it']


def test_a_pipe_carries_the_whole_text_and_stays(tmp_path):
    path, heard = pipe(tmp_path / 'pipe'), []
    reader = Thread(target=lambda: heard.append(path.read_text()))
    reader.start()
    refuse_file(path)
    write_text(path, 'abc' * 100_000)
    reader.join()
    assert heard == ['abc' * 100_000]
    assert stat.S_ISFIFO(path.lstat().st_mode) and os.listdir(tmp_path) == ['pipe']


def test_a_link_is_written_through_and_stays(tmp_path):
    (tmp_path / 'far').mkdir()
    target = tmp_path / 'far' / 'target'
    target.write_text('before')
    (tmp_path / 'near').symlink_to('far/target')
    (tmp_path / 'link').symlink_to('near')
    write_text(tmp_path / 'link', 'new')
    assert [(tmp_path / name).is_symlink() for name in ('link', 'near')] == [True, True]
    assert not target.is_symlink() and target.read_text() == 'new'
    assert (tmp_path / 'far' / 'target~').read_text() == 'before'


def test_a_link_to_nothing_makes_what_it_leads_to(tmp_path):
    (tmp_path / 'link').symlink_to('target')
    write_text(tmp_path / 'link', 'new')
    assert (tmp_path / 'link').is_symlink() and (tmp_path / 'target').read_text() == 'new'


def test_a_link_to_itself_is_refused(tmp_path):
    (tmp_path / 'link').symlink_to('link')
    for attempt in (refuse_file, lambda path: write_text(path, 'text')):
        with pytest.raises(ConfigError, match='Too many levels of symbolic links'):
            attempt(tmp_path / 'link')
    assert (tmp_path / 'link').is_symlink()


def test_a_link_to_a_folder_stays_and_the_folder_gives_way(tmp_path):
    (tmp_path / 'run1').mkdir()
    (tmp_path / 'run1' / 'old').write_text('old')
    (tmp_path / 'latest').symlink_to('run1')
    with new_directory(tmp_path / 'latest') as folder:
        folder.mkdir()
        (folder / 'new').write_text('new')
    assert (tmp_path / 'latest').is_symlink()
    assert os.listdir(tmp_path / 'run1') == ['new']
    assert os.listdir(tmp_path / 'run1~') == ['old']


OUT = """
import pathlib, sys
from forcecal_ros.core.files import refuse_file, write_text
print('before')
refuse_file(sys.argv[1])
write_text(sys.argv[1], 'text\\n')
print('after')
"""


@pytest.mark.parametrize('number, where', [(1, 'file'), (2, 'pipe')])
def test_an_open_stream_is_written_to_where_it_stands(tmp_path, number, where):
    (tmp_path / 'stream').symlink_to(f'/proc/self/fd/{number}')
    with (tmp_path / 'file').open('w+') as file:
        file.write('earlier\n')
        file.flush()
        done = subprocess.run(
            [sys.executable, '-c', OUT, str(tmp_path / 'stream')], check=True,
            stdout=file if where == 'file' else subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True)
    told = (tmp_path / 'file').read_text().removeprefix('earlier\n') or done.stdout
    assert sorted(told.splitlines()) == ['after', 'before', 'text']
    if number == 1:
        assert told == 'before\ntext\nafter\n'
    assert (tmp_path / 'stream').is_symlink()
    assert sorted(os.listdir(tmp_path)) == ['file', 'stream']


def test_a_path_is_an_open_stream_by_whatever_name():
    assert [descriptor_of(Path(name)) for name in (
        '/dev/stdout', '/dev/stderr', '/dev/fd/7', '/proc/self/fd/1', f'/proc/{os.getpid()}/fd/3',
        '/dev/null', 'stdout', '7')] == [1, 2, 7, 1, 3, None, None, None]


def test_a_folder_that_is_not_there_is_refused_and_not_made(tmp_path):
    path = tmp_path / 'no' / 'result'
    for attempt in (refuse_file, lambda path: write_text(path, 'text'),
                    lambda path: refuse_folder(path, replaced=True),
                    lambda path: refuse_folder(path, replaced=False)):
        with pytest.raises(ConfigError, match=f'{tmp_path}/no'):
            attempt(path)
    assert not os.listdir(tmp_path)


def test_a_folder_does_not_give_way_to_a_file(tmp_path):
    for attempt in (refuse_file, lambda path: write_text(path, 'text')):
        with pytest.raises(ConfigError, match='is a folder; choose a file in it'):
            attempt(tmp_path)


def test_the_working_folder_and_a_mounted_one_are_not_replaced(tmp_path, monkeypatch):
    (tmp_path / 'here' / 'below').mkdir(parents=True)
    monkeypatch.chdir(tmp_path / 'here' / 'below')
    for path in ('.', '..', tmp_path / 'here', '/proc'):
        with pytest.raises(ConfigError, match='can be replaced; choose a new folder in it'):
            refuse_folder(path, replaced=True)
    refuse_folder('.', replaced=False)
    refuse_folder('new', replaced=True)


def test_a_folder_that_takes_no_files_is_found_before_the_work():
    for attempt in (refuse_file, lambda path: refuse_folder(path, replaced=True)):
        with pytest.raises(ConfigError, match='cannot be written'):
            attempt('/proc/result')
