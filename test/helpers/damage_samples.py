"""One small recording in every kind of file that is read, and damage to its bytes."""

from collections.abc import Callable
import json
from pathlib import Path
import struct
from typing import Any, NamedTuple

from bag_samples import copy_bag, small_recording, STORAGES
from forcecal_ros.core.streams import Recording
from forcecal_ros.io.bags import read_recording, write_recording
from forcecal_ros.io.csv_import import assemble, load_specification
import lz4.frame
import numpy as np
from scipy.io import savemat

N = 40
"""Samples of the wrench."""

BAGS = {f'{storage.name} {mode.name}': (storage, mode) for storage, mode in STORAGES}
TABLES = ('csv', 'long csv', 'mat', 'mat compressed')
KINDS = (*BAGS, 'MCAP lz4', 'metadata.yaml', *TABLES)

FOOTER, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, SUMMARY_OFFSET, DATA_END = 2, 6, 7, 8, 14, 15
MAGIC = b'\x89MCAP0\r\n'


class Kind(NamedTuple):
    """Bytes of an intact file, where a damaged copy of it belongs, and what reads that."""

    content: bytes
    path: Path
    read: Callable[[], Recording]

    def damaged(self, content: bytes) -> Callable[[], Recording]:
        """Put other bytes in place of the file, and return what reads them."""
        self.path.write_bytes(content)
        return self.read


def make(kind: str, folder: Path) -> Kind:
    """Write the recording as a file of a kind."""
    if kind in TABLES:
        return _table(kind, folder)
    write_recording(folder / 'source', small_recording(N))
    if kind == 'metadata.yaml':
        path = folder / 'source' / kind
        return Kind(path.read_bytes(), path, lambda: read_recording(folder / 'source'))
    if kind == 'MCAP lz4':
        content, suffix = with_lz4((folder / 'source' / 'source.mcap').read_bytes()), '.mcap'
    else:
        bag = copy_bag(folder / 'source', folder / 'copy', *BAGS[kind])
        file = next(file for file in bag.iterdir() if file.suffix != '.yaml')
        content, suffix = file.read_bytes(), ''.join(file.suffixes)
    path = folder / f'damaged{suffix}'
    return Kind(content, path, lambda: read_recording(path))


def records(content: bytes) -> list[tuple[int, int, int]]:
    """Return (opcode, start, end) of the records at the top of an MCAP file."""
    position, found = len(MAGIC), []
    while position < len(content) - len(MAGIC):
        opcode, size = struct.unpack_from('<BQ', content, position)
        found.append((opcode, position, position + 9 + size))
        position += 9 + size
    return found


def with_lz4(content: bytes) -> bytes:
    """Return an MCAP file of chunks without compression with lz4, its index put right."""
    made, moved, summary = MAGIC, {}, 0
    for opcode, start, end in records(content):
        body = content[start + 9:end]
        if opcode == CHUNK:
            assert struct.unpack_from('<I', body, 28) == (0,)
            packed = lz4.frame.compress(body[40:])
            body = body[:28] + _text('lz4') + struct.pack('<Q', len(packed)) + packed
            moved[start] = (len(made), 9 + len(body), len(packed))
        elif opcode == CHUNK_INDEX:
            place, length, packed = moved[struct.unpack_from('<Q', body, 16)[0]]
            body = (body[:16] + struct.pack('<QQIQ', place, length, 0, 0) + _text('lz4')
                    + struct.pack('<Q', packed) + body[-8:])
        elif opcode == FOOTER:
            body = struct.pack('<QQI', summary, 0, 0)
        elif opcode in (MESSAGE_INDEX, SUMMARY_OFFSET):
            continue
        made += struct.pack('<BQ', opcode, len(body)) + body
        summary = len(made) if opcode == DATA_END else summary
    return made + MAGIC


def _text(word: str) -> bytes:
    return struct.pack('<I', len(word)) + word.encode()


def _table(kind: str, folder: Path) -> Kind:
    """Write the wrench, and a phase in a column of its own, as a table."""
    wrench = small_recording(N).wrench
    names = [f'{part}{axis}' for part in 'ft' for axis in 'xyz']
    stated: dict[str, Any] = {
        'file': 'log.csv', 'time': {'column': 'when', 'unit': 's'}, 'signals': {'wrench': {
            'frame': 'ft_sensor', 'force': {'columns': names[:3], 'unit': 'N'},
            'torque': {'columns': names[3:], 'unit': 'N m'}}}}
    path = folder / 'log.csv'
    if kind == 'csv':
        stated |= {'delimiter': ';', 'decimal': ',', 'phases': {'column': 'phase'},
                   'time': {'column': 'when', 'unit': 'date'}}
        rows = [';'.join([f'2024-03-01 12:00:00.{round(1e6 * t):06d}',
                          *(repr(x).replace('.', ',') for x in row.tolist()),
                          'measure' if t < 0.02 else 'move'])
                for t, row in zip(wrench.t, wrench.values)]
        path.write_text('\n'.join([';'.join(['when', *names, 'phase']), *rows]) + '\n')
    elif kind == 'long csv':
        stated |= {'long': {'name': 'signal', 'value': 'value'}}
        rows = [f'{t:.3f},{name},{x!r}' for t, row in zip(wrench.t, wrench.values)
                for name, x in zip(names, row.tolist())]
        path.write_text('\n'.join(['when,signal,value', *rows]) + '\n')
    else:
        path = folder / 'log.mat'
        stated |= {'file': path.name}
        stated['signals']['wrench']['force']['columns'] = [f's.f({k})' for k in (1, 2, 3)]
        savemat(path, {'when': wrench.t, 's': {'f': wrench.values[:, :3]}, 'note': 'text',
                       **dict(zip(names[3:], wrench.values[:, 3:].T))},
                do_compression=kind != 'mat')
    (folder / 'import.yaml').write_text(json.dumps(
        {'format': 'forcecal-import/1', 'tables': [stated]}))
    specification = load_specification(folder / 'import.yaml')
    return Kind(path.read_bytes(), path, lambda: Recording(
        wrench=assemble(specification).signals['wrench']))


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """Return a copy with flipped bits, overwritten, cut off, or with a piece taken out."""
    copy = bytearray(content)
    at, size = int(random.integers(len(copy))), int(random.integers(1, 65))
    kind = random.integers(4)
    if kind == 0:
        for bit in random.integers(8 * len(copy), size=random.integers(1, 9)):
            copy[bit // 8] ^= 1 << int(bit % 8)
    elif kind == 1:
        copy[at:at + size] = random.bytes(size)
    elif kind == 2:
        del copy[at:at + size]
    else:
        del copy[at:]
    return bytes(copy)
