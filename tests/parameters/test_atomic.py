"""A file is written whole or not at all."""

from __future__ import annotations

import errno
import io
import os
import stat

import pytest

from fluidact_fit.errors import OutputError
from fluidact_fit.parameters import make_document, read_document, save_document, write_atomically


def test_writes_text_and_bytes(tmp_path):
    path = write_atomically(tmp_path / "a.yaml", "é\n")
    assert path.read_bytes() == "é\n".encode()
    write_atomically(path, b"\0", overwrite=True)
    assert path.read_bytes() == b"\0"
    assert os.listdir(tmp_path) == ["a.yaml"]


def test_an_existing_file_is_kept(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("old")
    with pytest.raises(OutputError, match="exists already") as caught:
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


def test_save_and_read(document, lookup, tmp_path):
    path = save_document(make_document(document, lookup), tmp_path / "p.yaml")
    read = read_document(path, lookup)
    with pytest.raises(OutputError):
        save_document(read, path)
    save_document(read, path, overwrite=True)
    assert read_document(path, lookup) == read
