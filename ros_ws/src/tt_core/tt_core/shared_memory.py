"""Shared memory of the middleware Fast DDS: its size, removal of files that dead processes left, and a check of the free space."""

from __future__ import annotations

import fcntl
import os
import re
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
LEAST_FREE = 2**16  # bytes that must be free in SHARED_MEMORY for a node to start
SEGMENT_VARIABLE = "TT_SEGMENT_SIZE"  # environment variable that config/fastdds.xml reads
SMALL_SEGMENT = 2**20  # bytes, for a process that sends no images
IMAGE_SEGMENT = 40 * 2**20  # bytes, for a process that sends images, see `set_segment`
LEAST_AGE = 5.0  # s; the participant that creates a younger file may not have mapped and locked it yet, which usually takes 1 ms
FILE = re.compile(r"fastrtps_(port\d+|[0-9a-f]{16})")  # a port at which a participant of Fast DDS receives, or the data that it sends


def check_room() -> None:
    """End the process with one line and exit code 2 if shared memory has fewer than LEAST_FREE bytes free.

    Libraries of ROS map files into shared memory. Without free space the process would end with SIGBUS. With more than LEAST_FREE bytes the
    middleware uses UDP where shared memory does not suffice.
    """
    if SHARED_MEMORY.is_dir():
        disk = os.statvfs(SHARED_MEMORY)
        if (free := disk.f_bavail * disk.f_frsize) < LEAST_FREE:
            print(f"{SHARED_MEMORY} has {free} bytes free, nodes need {LEAST_FREE}; remove files of other programs there", file=sys.stderr)
            sys.exit(2)


def set_segment(size: int) -> None:
    """Set the size (bytes) of the shared memory in which this process keeps what it sends; call it before rclpy.init().

    It acts with the profile config/fastdds.xml, which scripts/env selects.

    Fast DDS keeps what it has sent until every receiver has taken it. A receiver that stands still or is killed takes nothing, and leaves
    up to 512 pieces of up to 64 kB, 32 MB. If these fill the segment of the sender, Fast DDS 2.14.5 takes them back one by one until the
    sum of the free bytes suffices. But these bytes may be scattered, so that from then on small messages are sent, and images reach nobody
    any more. Therefore IMAGE_SEGMENT is larger than what one receiver can leave.
    """
    os.environ[SEGMENT_VARIABLE] = str(size)


def remove_leftovers(folder: Path = SHARED_MEMORY) -> list[str]:
    """Remove the files of Fast DDS that dead processes left and that nobody uses, as `fastdds shm clean` does.

    A node that is killed leaves its files, about 0.6 MB. If nodes are started and killed again and again, these fill the shared memory of a
    container, 64 MB. Each file has a lock file, whose name ends with `_el`; its owner holds the lock as long as it lives. A file is left
    over if nobody holds its lock and no process whose memory map can be read has mapped it. This function holds the lock while it checks,
    so that no new participant can begin to use the file. A file younger than LEAST_AGE may be one that a participant is just creating.
    Without this file nothing that others send would reach the participant, so it stays.

    Args:
        folder: Folder of the files.

    Returns:
        The names of the files that were removed, without those of lock files.
    """
    removed = []
    with ExitStack() as locks:
        idle = [path for path in _own_files(folder) if locks.enter_context(_locked(path))]
        mapped = _mapped_inodes() if idle else set()
        for path in idle:
            with suppress(OSError):
                if path.stat().st_ino not in mapped:
                    path.unlink(missing_ok=True)
                    path.with_name(f"sem.{path.name}_mutex").unlink(missing_ok=True)
                    removed.append(path.name)
    return removed


def _own_files(folder: Path) -> list[Path]:
    files, newest = [], time.time() - LEAST_AGE
    for path in folder.glob("fastrtps_*"):
        with suppress(OSError):
            status = path.lstat()
            is_own = FILE.fullmatch(path.name) and stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid()
            if is_own and status.st_mtime < newest:
                files.append(path)
    return files


@contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Try to lock a file of Fast DDS through its lock file, as Fast DDS does; yield whether the lock was obtained.

    The lock file is removed before the lock is released, if it was created here or if the file that it belongs to was removed meanwhile.
    """
    lock = path.with_name(f"{path.name}_el")
    existed = lock.exists()
    try:
        descriptor = os.open(lock, os.O_CREAT | os.O_RDONLY, 0o666)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        is_held = os.fstat(descriptor).st_nlink > 0  # 0: its owner has deleted the lock file since it was opened here
    except OSError:
        is_held = False
    try:
        yield is_held
    finally:
        if is_held and not (existed and path.exists()):
            lock.unlink(missing_ok=True)
        os.close(descriptor)


def _mapped_inodes() -> set[int]:
    """Return the inodes of all Fast DDS files that running processes have mapped, as far as we may read their /proc/PID/maps."""
    inodes = set()
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with suppress(OSError), maps.open(errors="replace") as lines:
            inodes |= {int(line.split()[4]) for line in lines if "/fastrtps_" in line}
    return inodes
