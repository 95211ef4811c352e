"""A claim is one process's, and gone with it."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from claim_holder import HOLD, has_it

from mpsnet_core.errors import InputError
from mpsnet_core.io.claims import LOCK_FILE, Claims

Other = Callable[[int], "subprocess.Popen[str]"]


@pytest.fixture
def other(tmp_path: Path) -> Iterator[Other]:
    """Starts another process that claims a number; its first line says whether it has it."""
    children = []

    def start(number: int) -> "subprocess.Popen[str]":
        command = [sys.executable, "-c", HOLD, str(tmp_path), str(number)]
        child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        children.append(child)
        return child

    yield start
    for child in children:
        child.kill()
        child.communicate()


def test_what_another_process_holds_is_not_ours_until_it_is_killed(tmp_path: Path, other: Other) -> None:
    child = other(7)
    assert has_it(child)
    with Claims(tmp_path) as claims:
        with claims.claim(7) as ours:
            assert not ours
        for neighbour in (0, 6, 8, 10_000_000):
            with claims.claim(neighbour) as ours:
                assert ours
        child.kill()
        child.wait()
        with claims.claim(7) as ours:
            assert ours


def test_a_claim_ends_with_its_block_whatever_ends_it(tmp_path: Path, other: Other) -> None:
    with Claims(tmp_path) as claims:
        with claims.claim(3) as ours:
            assert ours
            assert not has_it(other(3))
        with pytest.raises(ZeroDivisionError), claims.claim(4):
            1 / 0  # noqa: B018
        assert has_it(other(4))
        assert has_it(other(3))


def test_children_do_not_inherit_claims(tmp_path: Path, other: Other) -> None:
    """A process started while a claim is held keeps nothing of it."""
    with Claims(tmp_path) as claims, claims.claim(5) as ours:
        assert ours
        bystander = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    assert has_it(other(5))
    bystander.communicate(b"\n")


def test_a_folder_without_room_for_locks_is_reported(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).mkdir()
    with pytest.raises(InputError, match=r"job\.lock.*choose another folder"):
        Claims(tmp_path)
