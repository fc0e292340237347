"""Binary USD files (crates) that state counts which they do not have.

Source:
    OpenUSD, pxr/usd/sdf/crateFile.cpp: _BootStrap, _TableOfContents, _Section, and the packing of arrays.
"""

import struct
from collections.abc import Mapping

COUNT = 2**31
ARRAY_LENGTH = 12_347  # no other number of a file is this one

# Of each section, what its first numbers of 8 bytes are.
SECTIONS: Mapping[str, tuple[str, ...]] = {
    "TOKENS": ("count", "bytes", "packed bytes"),
    "STRINGS": ("count",),
    "FIELDS": ("count", "packed bytes"),
    "FIELDSETS": ("count", "packed bytes"),
    "PATHS": ("count", "count again", "packed bytes"),
    "SPECS": ("count", "packed bytes"),
}


def state_array_counts(crate: bytes, length: int = ARRAY_LENGTH, count: int = COUNT) -> bytes:
    """Every array of a length states another count.

    Raises:
        ValueError: There is no such array.
    """
    known = struct.pack("<Q", length)
    if known not in crate:
        raise ValueError(f"no array has {length} elements")
    return crate.replace(known, struct.pack("<Q", count))


def state_section_count(crate: bytes, section: str, number: int, count: int = COUNT) -> bytes:
    """One of the first numbers of a section is another one.

    Args:
        crate: The file.
        section: Its name, one of SECTIONS.
        number: Which of its numbers.
        count: What it states then.

    Raises:
        ValueError: There is no such section.
    """
    changed = bytearray(crate)
    (table,) = struct.unpack_from("<q", crate, 16)
    (sections,) = struct.unpack_from("<Q", crate, table)
    for name, start, _ in struct.iter_unpack("<16sqq", crate[table + 8 : table + 8 + 32 * sections]):
        if name.rstrip(b"\0").decode("ascii") == section:
            struct.pack_into("<Q", changed, start + 8 * number, count)
            return bytes(changed)
    raise ValueError(f"there is no section {section}")
