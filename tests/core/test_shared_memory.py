"""What dead participants of the middleware left in shared memory is removed, and nothing else."""

import fcntl
import mmap
import os
import time
from contextlib import ExitStack

import pytest
from tt_core.shared_memory import LEAST_AGE, check_room, remove_leftovers

PORT, SEGMENT = "fastrtps_port7661", "fastrtps_055e4749680e0f2f"


@pytest.fixture
def files(tmp_path):
    """Return a function that creates files of given names, of the age LEAST_AGE, in an empty folder and returns the folder."""

    def make(*names):
        for name in names:
            (tmp_path / name).write_bytes(bytes(4096))
            os.utime(tmp_path / name, 2 * (time.time() - LEAST_AGE,))
        return tmp_path

    return make


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_files_of_dead_participants_are_removed_with_their_locks(files):
    folder = files(PORT, f"{PORT}_el", f"sem.{PORT}_mutex", SEGMENT, f"{SEGMENT}_el", "fastrtps_port7663")
    assert sorted(remove_leftovers(folder)) == sorted([PORT, SEGMENT, "fastrtps_port7663"])
    assert names(folder) == []


@pytest.mark.parametrize("marked", [False, True])
def test_a_file_in_use_stays(files, marked):
    """A process has mapped it, here this one; whether there is a lock file makes no difference."""
    folder = files(PORT, *([f"{PORT}_el"] if marked else []))
    before = names(folder)
    with (folder / PORT).open("r+b") as file, mmap.mmap(file.fileno(), 0):
        assert remove_leftovers(folder) == []
        assert names(folder) == before
    assert remove_leftovers(folder) == [PORT]


def test_a_file_that_may_just_be_created_stays(files):
    """A participant that has created it, but has not mapped it yet, would get no messages."""
    folder = files(PORT)
    os.utime(folder / PORT)
    assert remove_leftovers(folder) == []
    assert names(folder) == [PORT]


def test_a_file_whose_participant_lives_stays(files):
    folder = files(PORT, f"{PORT}_el")
    with ExitStack() as stack:
        descriptor = os.open(folder / f"{PORT}_el", os.O_RDONLY)
        stack.callback(os.close, descriptor)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        assert remove_leftovers(folder) == []
    assert remove_leftovers(folder) == [PORT]


def test_other_files_stay(files):
    folder = files("fastrtps_port7661_log", "fastrtps_notes", "psm_12345678", f"{PORT}x", "sem.mp-abcdefgh")
    (folder / PORT).symlink_to(folder / "fastrtps_notes")
    before = names(folder)
    assert remove_leftovers(folder) == []
    assert names(folder) == before


def test_a_folder_that_is_not_there_is_empty(tmp_path):
    assert remove_leftovers(tmp_path / "none") == []


def test_full_memory_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("tt_core.shared_memory.SHARED_MEMORY", tmp_path)
    check_room()
    monkeypatch.setattr("tt_core.shared_memory.LEAST_FREE", 2**62)
    with pytest.raises(SystemExit) as end:
        check_room()
    assert end.value.code == 2
    assert str(tmp_path) in capsys.readouterr().err
