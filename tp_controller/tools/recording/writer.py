# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Writer of bags: a folder with an MCAP file and its description, as in ROS 2."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast, Final

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys import get_typestore, Stores
from tp_controller.errors import TpControllerError

# Version of the description of a bag, that of Jazzy.
VERSION: Final = 9


class BagWriter:
    """
    Writer of messages, in the order of receipt, to a new bag.

    Parameters
    ----------
    path : pathlib.Path
        Folder of the bag; missing parent folders are created.

    Attributes
    ----------
    path : pathlib.Path
    counts : dict
        {topic: messages written}

    Raises
    ------
    TpControllerError
        The path exists already, or cannot be written.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.counts: dict[str, int] = {}
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[tuple[str, str], Connection] = {}
        try:
            self._writer = Writer(path, version=VERSION, storage_plugin=StoragePlugin.MCAP)
            # By chunk, so that complete chunks of a killed process can be read.
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
        except WriterError as error:
            raise TpControllerError(f'{path} exists already, and stays as it is: name another, or '
                                    'move it away') from error
        except OSError as error:
            raise TpControllerError(f'{path} cannot be written: {error.strerror}') from error
        # The type follows from the storage chosen above.
        self._storage = cast(McapWriter, self._writer.storage)

    def knows(self, kind: str) -> bool:
        """Return whether a message type, such as ``'std_msgs/msg/String'``, is known."""
        return kind in self._types.fielddefs

    def write(self, topic: str, kind: str, stamp: int, data: bytes,
              offered: Sequence[Qos] = ()) -> None:
        """
        Write a message.

        Parameters
        ----------
        topic, kind : str
            Names of the topic and of its type, which the bag `knows`.
        stamp : int
            Time of receipt [ns].
        data : bytes
            Content in CDR.
        offered : sequence of Qos
            QoS of the publishers, used with the first message of a topic.

        """
        connection = self._connections.get((topic, kind))
        if connection is None:
            connection = self._connections[topic, kind] = self._writer.add_connection(
                topic, kind, typestore=self._types, offered_qos_profiles=offered)
        self._writer.write(connection, stamp, data)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def write_message(self, topic: str, kind: str, stamp: int, fields: Mapping[str, Any]) -> None:
        """Write a message with the content {field: value}."""
        data = self._types.serialize_cdr(self.make(kind, fields), kind)
        self.write(topic, kind, stamp, bytes(data))

    def make(self, kind: str, fields: Mapping[str, Any]) -> object:
        """Return a message with the content {field: value}, as part of another one."""
        return self._types.types[kind](**fields)

    def flush(self) -> None:
        """Flush the written messages to the operating system; a killed process loses the rest."""
        if self._storage.chunk.msgs:
            self._storage.close_chunk()
        self._storage.bio.flush()

    def close(self) -> None:
        """Write the index and the description."""
        self._writer.close()

    def abandon(self) -> None:
        """Close the file without index and description."""
        self._writer.abort()

    def size(self) -> int:
        """Return the size of the file so far [bytes]."""
        return self._storage.path.stat().st_size
