"""The first code of a process: what its main() raises about files is told in one line."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("path", ["nothing/file.txt", "/dev/full"])
def test_a_file_that_cannot_be_written_ends_the_process_with_one_line(path, tmp_path):
    (tmp_path / "writes.py").write_text(f"def main():\n    with open({path!r}, 'w') as file:\n        file.write('text')\n")
    done = subprocess.run([sys.executable, "-m", "tt_core.start", "writes"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
