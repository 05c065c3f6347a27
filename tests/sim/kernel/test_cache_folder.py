"""The cache of kernels is code: what somebody else may have put there is never used."""

import os
from pathlib import Path

import pytest

from sim.kernel.cache import _cache_folder


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "shadow-gateway" / "kernels"


def test_a_cache_of_the_users_own_is_used_and_kept(cache: Path) -> None:
    assert _cache_folder() == cache
    assert not cache.stat().st_mode & 0o022
    (cache / "kernel_x.py").write_text("x = 1\n")
    assert _cache_folder() == cache
    assert (cache / "kernel_x.py").exists()


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757])
@pytest.mark.parametrize("place", [".", "__pycache__"])
def test_what_others_could_write_is_emptied_and_closed(cache: Path, mode: int, place: str) -> None:
    folder = _cache_folder() / place
    folder.mkdir(exist_ok=True)
    planted = folder / "kernel_x.py"
    planted.write_text("raise SystemExit\n")
    folder.chmod(mode)
    assert _cache_folder() == cache
    assert not planted.exists()
    assert not folder.stat().st_mode & 0o022


@pytest.mark.skipif(os.getuid() != 0, reason="only the administrator can give files away")
@pytest.mark.parametrize("place", [".", "kernel_x.py", "__pycache__", "__pycache__/x.nbi", ".."])
def test_what_belongs_to_somebody_else_is_not_used(cache: Path, place: str) -> None:
    (cache / "__pycache__").mkdir(parents=True)  # before this process looks
    (cache / "kernel_x.py").touch()
    (cache / "__pycache__" / "x.nbi").touch()
    os.chown(cache / place, 12345, 12345)
    other = _cache_folder()
    assert not other.is_relative_to(cache)
    assert other.stat().st_uid == os.getuid()
    assert other == _cache_folder()  # one for the whole process
