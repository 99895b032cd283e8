"""SQLite files of rosbag2: whole ones, and what can be read of damaged ones."""

from collections.abc import Iterator
from itertools import compress
from pathlib import Path
import sqlite3
from typing import Any

from forcecal_ros.core.errors import DataError
from forcecal_ros.core.topics import Topic
from forcecal_ros.io.bags.batch import Batch, Notes
import numpy as np

_ROWS = 8192
"""Messages that are read from the database at a time."""


class SqliteFile:
    """
    The messages of one file.

    Attributes
    ----------
    topics : dict of int to Topic
        By topic id.
    """

    def __init__(self, path: Path, notes: Notes) -> None:
        self._path = path
        self._notes = notes
        try:
            self._database = self._open()
            self.topics = self._read_topics()
        except sqlite3.DatabaseError as error:
            why = ' '.join(str(error).split())
            raise DataError(f'{path}: not a readable SQLite recording ({why}); try '
                            f'`sqlite3 {path.name} .recover`') from error

    def _open(self) -> sqlite3.Connection:
        """Open read-only; ``immutable`` where a lock or journal cannot be made beside it."""
        address = self._path.absolute().as_uri()
        for mode in ('mode=ro', 'mode=ro&immutable=1'):
            database = sqlite3.connect(f'{address}?{mode}', uri=True)
            database.text_factory = lambda text: text.decode(errors='replace')
            try:
                database.execute('SELECT count(*) FROM sqlite_master')
                return database
            except sqlite3.OperationalError as error:
                database.close()
                problem = error
        raise problem

    def _read_topics(self) -> dict[int, Topic]:
        try:
            definitions = dict(self._database.execute(
                "SELECT topic_type, encoded_message_definition FROM message_definitions "
                "WHERE encoding = 'ros2msg'"))
        except sqlite3.DatabaseError:
            definitions = {}
        rows = self._database.execute(
            "SELECT id, name, type FROM topics WHERE serialization_format = 'cdr'")
        return {number: Topic(name, kind, definitions.get(kind, ''))
                for number, name, kind in rows}

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def batches(self, topics: set[Topic]) -> Iterator[Batch]:
        """Yield the messages of some topics, some thousands at a time, in the file's order."""
        wanted = [number for number, topic in self.topics.items() if topic in topics]
        query = ('SELECT id, topic_id, timestamp, data FROM messages '  # noqa: S608 - of ?
                 f'WHERE topic_id IN ({", ".join("?" * len(wanted))}) AND id > ? ')
        last = -1
        try:
            for rows in self._rows(query + 'ORDER BY id', (*wanted, last)):
                last = rows[-1][0]
                yield from self._group(rows)
        except sqlite3.DatabaseError as error:
            self._notes.add(f'{self._path.name} is damaged or cut off ({error}): some messages '
                            'were left out')
            yield from self._backwards(query, wanted, last)

    def _backwards(self, query: str, wanted: list[int], last: int) -> Iterator[Batch]:
        """Yield what lies behind the damage, from the end."""
        try:
            for rows in self._rows(query + 'ORDER BY id DESC', (*wanted, last)):
                yield from self._group(rows[::-1])
        except sqlite3.DatabaseError:
            return

    def _rows(self, query: str, values: tuple[int, ...]) -> Iterator[list[tuple[Any, ...]]]:
        cursor = self._database.execute(query, values)
        rows: list[tuple[Any, ...]] = []
        try:
            for row in cursor:
                rows.append(row)
                if len(rows) == _ROWS:
                    yield rows
                    rows = []
        except sqlite3.DatabaseError:
            if rows:
                yield rows
            raise
        if rows:
            yield rows

    def _group(self, rows: list[tuple[Any, ...]]) -> Iterator[Batch]:
        rows = [row for row in rows if type(row[2]) is int and type(row[3]) is bytes]
        if not rows:
            return
        _, numbers, log_ns, blobs = zip(*rows)
        source, logs = np.array(numbers), np.array(log_ns)
        for number in set(numbers):
            chosen = source == number
            messages = list(compress(blobs, chosen))
            length = np.array([len(message) for message in messages])
            yield Batch(self.topics[number], b''.join(messages), np.cumsum(length) - length,
                        length, logs[chosen])
