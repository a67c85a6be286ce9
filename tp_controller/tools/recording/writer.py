# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Writes a bag: a folder with an MCAP file and its description, as ROS 2 has it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast, Final

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys import get_typestore, Stores
from tp_controller.errors import TpControllerError

# Of the bag's description; Jazzy writes it.
VERSION: Final = 9


class BagWriter:
    """
    Writes the messages of topics, as they came, to a new bag.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag; folders above it are made where they are missing.

    Attributes
    ----------
    path : pathlib.Path
    counts : dict
        {topic: messages written}

    Raises
    ------
    TpControllerError
        There is something of this name, or it cannot be written.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.counts: dict[str, int] = {}
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[tuple[str, str], Connection] = {}
        try:
            self._writer = Writer(path, version=VERSION, storage_plugin=StoragePlugin.MCAP)
            # Chunk by chunk, so that what was written before the process is killed can be read.
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        except WriterError as error:
            raise TpControllerError(f'{path} exists already, and stays as it is: name another, or '
                                    'move it away') from error
        except OSError as error:
            raise TpControllerError(f'{path} cannot be written: {error.strerror}') from error
        # Of the storage chosen above.
        self._storage = cast(McapWriter, self._writer.storage)

    def knows(self, kind: str) -> bool:
        """Say whether messages of a type, such as ``'std_msgs/msg/String'``, can be written."""
        return kind in self._types.fielddefs

    def write(self, topic: str, kind: str, stamp: int, data: bytes,
              offered: Sequence[Qos] = ()) -> None:
        """
        Write a message.

        Parameters
        ----------
        topic, kind : str
            Names of the topic and of its type, one that the bag `knows`.
        stamp : int
            When it was received [ns].
        data : bytes
            CDR.
        offered : sequence of Qos
            Of the publishers; read with the first message of a topic.

        """
        connection = self._connections.get((topic, kind))
        if connection is None:
            connection = self._connections[topic, kind] = self._writer.add_connection(
                topic, kind, typestore=self._types, offered_qos_profiles=offered)
        self._writer.write(connection, stamp, data)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def write_message(self, topic: str, kind: str, stamp: int, fields: Mapping[str, Any]) -> None:
        """Write a message that is made here, of {field: value}."""
        data = self._types.serialize_cdr(self.make(kind, fields), kind)
        self.write(topic, kind, stamp, bytes(data))

    def make(self, kind: str, fields: Mapping[str, Any]) -> object:
        """Return a message of {field: value}, to be part of another one."""
        return self._types.types[kind](**fields)

    def flush(self) -> None:
        """Hand over to the system what was written so far; a killed process loses the rest."""
        if self._storage.chunk.msgs:
            self._storage.close_chunk()
        self._storage.bio.flush()

    def close(self) -> None:
        """Write the index and the description."""
        self._writer.close()

    def abandon(self) -> None:
        """Leave what was written, without index and description."""
        self._writer.abort()

    def size(self) -> int:
        """Return the size of the file so far [bytes]."""
        return self._storage.path.stat().st_size
