"""A file is written whole or not at all."""

from __future__ import annotations

import errno
import io
import multiprocessing
import os
import signal
import stat
import subprocess
import sys

import pytest

from fluidact_fit.errors import OutputError
from fluidact_fit.parameters import (
    atomic,
    make_document,
    read_document,
    save_document,
    write_atomically,
)
from fluidact_fit.parameters.atomic import write_together


def test_writes_text_and_bytes(tmp_path):
    path = write_atomically(tmp_path / "a.yaml", "é\n")
    assert path.read_bytes() == "é\n".encode()
    write_atomically(path, b"\0", overwrite=True)
    assert path.read_bytes() == b"\0"
    assert os.listdir(tmp_path) == ["a.yaml"]


def test_an_existing_file_is_kept(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("old")
    with pytest.raises(OutputError, match="already exists") as caught:
        write_atomically(path, "new")
    assert "--force" in caught.value.remedy
    assert path.read_text() == "old"


def _fail(*args, **options):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def _interrupt(*args, **options):
    raise KeyboardInterrupt


class _FullDisk(io.BufferedWriter):
    def write(self, content):
        super().write(content[:3])
        return _fail()


def _full_disk(descriptor, mode):
    return _FullDisk(io.FileIO(descriptor, mode))


@pytest.mark.parametrize(
    ("name", "fault", "error"),
    [
        ("replace", _fail, OutputError),
        ("fsync", _fail, OutputError),
        ("fdopen", _full_disk, OutputError),
        ("open", _fail, OutputError),
        ("fsync", _interrupt, KeyboardInterrupt),
    ],
)
def test_a_fault_leaves_the_old_file_whole(tmp_path, monkeypatch, name, fault, error):
    path = tmp_path / "a.yaml"
    path.write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr(os, name, fault)
        with pytest.raises(error) as caught:
            write_atomically(path, "new content", overwrite=True)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.yaml"]
    if error is OutputError:
        assert "No space left" in str(caught.value)
        assert caught.value.remedy
        assert caught.value.exit_status == 3


def test_places_that_cannot_be_written(tmp_path):
    file = tmp_path / "file"
    file.write_text("x")
    for path, words in (
        (tmp_path, "directory"),
        (tmp_path / "absent" / "a.yaml", "No such file"),
        (file / "a.yaml", "Not a directory"),
        (tmp_path / ("x" * 300), "too long"),
        ("a\0b", "cannot be written"),
        ("", "directory"),
        (f"{tmp_path}/absent/", "directory"),
        (f"{tmp_path}/.", "directory"),
    ):
        with pytest.raises(OutputError, match=words) as caught:
            write_atomically(path, "x")
        assert caught.value.remedy


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
def test_a_directory_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="Permission denied"):
        write_atomically(tmp_path / "a.yaml", "x")


@pytest.mark.skipif(os.name != "posix", reason="POSIX modes")
def test_modes(tmp_path):
    before = os.umask(0o027)
    try:
        path = write_atomically(tmp_path / "a.yaml", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o604)
    write_atomically(path, "y", overwrite=True)
    assert stat.S_IMODE(path.stat().st_mode) == 0o604


def test_several_files_are_written_all_or_none(tmp_path):
    new, old, link = tmp_path / "new", tmp_path / "old", tmp_path / "link"
    old.write_text("before")
    link.symlink_to("target")
    (tmp_path / "folder").mkdir()
    contents = {str(p): "x" for p in (new, old, link, tmp_path / "folder")}
    with pytest.raises(OutputError, match="directory"):
        write_together(contents, overwrite=True)
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != "target") == [
        "folder", "link", "old",
    ]  # fmt: skip
    assert old.read_text() == "before"
    del contents[str(tmp_path / "folder")]
    with pytest.raises(OutputError, match="already exists"):
        write_together(contents)
    assert not new.exists()
    assert write_together(contents, overwrite=True) == [new, old, link]
    assert {p.read_text() for p in (new, old, link)} == {"x"}
    assert link.is_symlink()


@pytest.mark.skipif(os.name != "posix", reason="POSIX links and devices")
def test_links_stay_links_and_devices_devices(tmp_path):
    target, link = tmp_path / "sub", tmp_path / "link.yaml"
    target.mkdir()
    (target / "a.yaml").write_text("old")
    link.symlink_to("sub/a.yaml")
    write_atomically(link, "new", overwrite=True)
    assert link.is_symlink()
    assert (target / "a.yaml").read_text() == "new"
    dangling = tmp_path / "dangling.yaml"
    dangling.symlink_to("sub/b.yaml")
    write_atomically(dangling, "x")
    assert (target / "b.yaml").read_text() == "x"
    write_atomically("/dev/null", "x")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def _race(path, results, ready):
    ready.wait()
    try:
        write_atomically(path, str(os.getpid()))
        results.put(os.getpid())
    except OutputError:
        results.put(0)


@pytest.mark.skipif(os.name != "posix", reason="needs fork")
def test_of_runs_that_write_one_new_file_at_once_one_does(tmp_path):
    # a barrier in every process lets all of them begin at the same moment
    context = multiprocessing.get_context("fork")
    for number in range(20):
        path, results, ready = tmp_path / f"{number}.yaml", context.Queue(), context.Barrier(4)
        runs = [context.Process(target=_race, args=(path, results, ready)) for _ in range(4)]
        for run in runs:
            run.start()
        outcomes = sorted(results.get() for _ in runs)
        for run in runs:
            run.join()
        assert outcomes[:3] == [0, 0, 0]
        assert path.read_text() == str(outcomes[3])
    assert sorted(os.listdir(tmp_path)) == sorted(f"{n}.yaml" for n in range(20))


def _taken_meanwhile(monkeypatch, path):
    """Let another program create the file after the first look at it."""
    real = os.fsync

    def fsync(descriptor):
        path.write_text("theirs")
        real(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)


@pytest.mark.parametrize("hard_links", [True, False])
def test_a_file_that_appears_meanwhile_is_kept(tmp_path, monkeypatch, hard_links):
    path = tmp_path / "a.yaml"
    if not hard_links:
        monkeypatch.setattr(os, "link", _fail)
        assert write_atomically(tmp_path / "b.yaml", "whole").read_text() == "whole"
        (tmp_path / "b.yaml").unlink()
    _taken_meanwhile(monkeypatch, path)
    with pytest.raises(OutputError, match="already exists"):
        write_atomically(path, "mine")
    assert path.read_text() == "theirs"
    assert os.listdir(tmp_path) == ["a.yaml"]


def test_without_hard_links_a_fault_leaves_no_empty_file(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "link", _fail)
    monkeypatch.setattr(os, "replace", _fail)
    with pytest.raises(OutputError, match="No space left"):
        write_atomically(tmp_path / "a.yaml", "x")
    assert os.listdir(tmp_path) == []


_KILLED = """
import os, signal
from fluidact_fit.parameters import write_atomically
os.fsync = lambda descriptor: os.kill(os.getpid(), signal.SIGKILL)
write_atomically("a.yaml", "new", overwrite=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="POSIX signals")
def test_what_a_killed_run_left_is_removed_and_nothing_else(tmp_path):
    (tmp_path / "a.yaml").write_text("old")
    done = subprocess.run([sys.executable, "-c", _KILLED], cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "a.yaml").read_text() == "old"
    left = {*os.listdir(tmp_path)} - {"a.yaml"}
    assert len(left) == 1
    others = {".fluidact-notes.tmp", "fluidact-0123456789abcdef.tmp", ".fluidact-0.tmp"}
    for name in others:
        (tmp_path / name).write_text("of the user")
    folder = ".fluidact-0123456789abcdef.tmp"
    (tmp_path / folder).mkdir()
    link = ".fluidact-fedcba9876543210.tmp"
    (tmp_path / link).symlink_to("a.yaml")
    write_atomically(tmp_path / "b.yaml", "x")
    assert {*os.listdir(tmp_path)} == {"a.yaml", "b.yaml", folder, link, *others}


@pytest.mark.skipif(os.name != "posix", reason="POSIX locks")
def test_the_temporary_file_of_a_running_write_is_left_alone(tmp_path, monkeypatch):
    real, seen = os.fsync, []

    def fsync(descriptor):
        real(descriptor)
        if not seen:
            seen.append("once")
            write_atomically(tmp_path / "inner.yaml", "inner")

    monkeypatch.setattr(os, "fsync", fsync)
    write_atomically(tmp_path / "outer.yaml", "outer")
    assert sorted(os.listdir(tmp_path)) == ["inner.yaml", "outer.yaml"]
    assert (tmp_path / "outer.yaml").read_text() == "outer"


@pytest.mark.parametrize("locks", ["none", "refused"])
def test_without_locks_only_old_files_are_removed(tmp_path, monkeypatch, locks):
    new, old = (tmp_path / f".fluidact-{c * 16}.tmp" for c in "ab")
    new.touch()
    old.touch()
    os.utime(old, (0, 0))
    if locks == "none":
        monkeypatch.setattr(atomic, "fcntl", None)
    else:
        monkeypatch.setattr(atomic.fcntl, "flock", _fail)
    write_atomically(tmp_path / "a.yaml", "x")
    assert sorted(os.listdir(tmp_path)) == [new.name, "a.yaml"]


def test_save_and_read(document, lookup, tmp_path):
    path = save_document(make_document(document, lookup), tmp_path / "p.yaml")
    read = read_document(path, lookup)
    with pytest.raises(OutputError):
        save_document(read, path)
    save_document(read, path, overwrite=True)
    assert read_document(path, lookup) == read
