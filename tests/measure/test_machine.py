"""Facts of the machine: complete, and the commit only of a checkout."""

import subprocess

import pytest

import ringlight
from ringlight.measure import machine as module
from ringlight.measure.machine import machine, source_commit


def test_the_machine_is_described():
    facts = machine()
    assert facts.cpu
    assert facts.cores >= 1
    assert facts.threads >= 1
    assert facts.isa in ("generic", "avx2", "avx512", "avx512_bf16", "avx512_amx", "none")


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A git checkout with one commit, in which ringlight seems to lie."""
    package = tmp_path / "src" / "ringlight"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    monkeypatch.setattr(ringlight, "__file__", str(package / "__init__.py"))
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "First"]):
        identity = ["-c", "user.name=A", "-c", "user.email=a@b.c"]
        try:
            subprocess.run(["git", "-C", str(tmp_path), *identity, *arguments], check=True, capture_output=True)
        except FileNotFoundError:
            pytest.skip("needs git, which is not on this machine")
    return package


def test_the_commit_of_a_checkout_says_whether_files_changed(checkout):
    clean = source_commit()
    assert clean is not None
    assert len(clean) == 40
    (checkout / "__init__.py").write_text("changed = True\n")
    assert source_commit() == f"{clean}+changes"


def test_an_installed_copy_has_no_commit(tmp_path, monkeypatch):
    installed = tmp_path / "lib" / "site-packages" / "ringlight" / "__init__.py"
    monkeypatch.setattr(ringlight, "__file__", str(installed))
    (tmp_path / ".git").mkdir()
    assert source_commit() is None


def test_a_machine_without_git_has_no_commit(checkout, monkeypatch):
    def missing(*arguments, **options):
        raise FileNotFoundError

    monkeypatch.setattr(module.subprocess, "run", missing)
    assert source_commit() is None
