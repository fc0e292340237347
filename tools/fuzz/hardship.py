"""What a machine may do to a command: a small limit of file sizes, a full folder for temporary files, other users.

Each is made in the process of the command, after the fork, and ends with it.
"""

import ctypes
import os
import resource
import subprocess
import tempfile
from pathlib import Path

TEMPORARY = "tmp"  # of a case's folder: its folder for temporary files
_CLONE_NEWNS = 0x00020000
_PR_CAPBSET_DROP = 24
_OVERRIDES = (1, 2, 3)  # of Linux: CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH, CAP_FOWNER


def limit_files(kib: int) -> None:
    """No file may get larger; writing more fails as on a full disk (EFBIG)."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (1024 * kib, 1024 * kib))


def fill_temporary(left_kib: int) -> None:
    """Mount a small disk as TMPDIR, seen by this process alone, with so much room.

    Raises:
        OSError: Mounting is not allowed.
    """
    if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNS):
        raise OSError(ctypes.get_errno(), "no namespace of its own")
    place = Path(TEMPORARY).absolute()
    for words in (["--make-rprivate", "/"], ["-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)]):
        done = subprocess.run(["mount", *words], capture_output=True, text=True, check=False)
        if done.returncode:
            raise PermissionError(done.stderr.strip())
    with (place / "filling").open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, 1024 * (256 - left_kib))
    os.environ["TMPDIR"], tempfile.tempdir = str(place), None


def obey_permissions() -> None:
    """Act as an ordinary user: root loses the rights by which it may do all with the files of others.

    Raises:
        OSError: The system has no such rights, or they cannot be dropped.
    """
    if os.geteuid() != 0:
        return
    libc = ctypes.CDLL(None, use_errno=True)
    for number in _OVERRIDES:  # of the programs that it starts
        if libc.prctl(_PR_CAPBSET_DROP, number, 0, 0, 0):
            raise OSError(ctypes.get_errno(), "a right cannot be dropped")
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # version 3, this process
    sets = (ctypes.c_uint32 * 6)()
    if libc.capget(header, sets):
        raise OSError(ctypes.get_errno(), "rights cannot be read")
    for index in (0, 1, 2):  # effective, permitted, inheritable
        sets[index] &= ~sum(1 << number for number in _OVERRIDES)
    if libc.capset(header, sets):
        raise OSError(ctypes.get_errno(), "rights cannot be dropped")
