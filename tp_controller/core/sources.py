# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Digest of the C++ sources, by which an outdated core is detected; run by setup.py as well."""

from hashlib import blake2b
from pathlib import Path


def digest(folder: Path) -> int:
    """Return a 64-bit digest of the names and contents of the C++ files; 0 if there are none."""
    files = sorted([*folder.glob('*.cpp'), *folder.glob('*.h')])
    total = blake2b(digest_size=8)
    for file in files:
        total.update(file.name.encode() + b'\0' + file.read_bytes())
    return int.from_bytes(total.digest(), 'big') if files else 0
