"""The farm with a worker that stands in for a renderer: what it makes, tells, survives and leaves behind."""

import os
import signal
import time
from pathlib import Path

import pytest
from farm_runs import alive, job, posix, start, until, workers
from stand_in import COMMAND, begun, whole
from synthetic import left_by, listing

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.synthesis.farm.run import FAILURES_IN_A_ROW, JobOutcome, make_samples
from mpsnet_core.synthesis.farm.work import THIS_PYTHON


def run(folder: Path, count: int, processes: int = 2, **changes: object) -> JobOutcome:
    return make_samples(folder, job(count, **changes), COMMAND, processes=processes)


def unfinished(folder: Path) -> list[str]:
    return [name for name in listing(folder) if "unfinished" in name]


def test_every_sample_is_made_once_and_the_way_is_reported(tmp_path: Path) -> None:
    told: list[tuple[float, str]] = []
    outcome = make_samples(
        tmp_path / "new", job(30), COMMAND, processes=2, progress=lambda fraction, words: told.append((fraction, words))
    )
    assert outcome == JobOutcome(made=30)
    assert whole(tmp_path / "new") == set(range(30))
    assert {number: len(pids) for number, pids in begun(tmp_path / "new").items()} == dict.fromkeys(range(30), 1)
    assert len(workers(tmp_path / "new")) == 2
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions) and fractions[-1] == 1
    assert (told[0], told[-1]) == ((0, "0 of 30"), (1, "30 of 30"))
    assert any(words.startswith("15 of 30, ") and words.endswith(" s left") for _, words in told)
    until(lambda: not any(map(alive, workers(tmp_path / "new"))))


def test_what_is_there_is_not_made_again_and_a_larger_count_extends_it(tmp_path: Path) -> None:
    assert run(tmp_path, 4) == JobOutcome(made=4)
    (tmp_path / "sample_000001.exr").unlink()
    (tmp_path / "sample_000002.exr").write_bytes(b"")
    half = (tmp_path / "sample_000003.exr").read_bytes()[:-20]
    (tmp_path / "sample_000003.exr").write_bytes(half)
    (tmp_path / "begun").unlink()
    assert run(tmp_path, 6) == JobOutcome(made=5, there=1)
    assert set(begun(tmp_path)) == {1, 2, 3, 4, 5}
    assert whole(tmp_path) == set(range(6))
    assert run(tmp_path, 3, sample_seconds=60) == JobOutcome(there=3)


def test_neighbours_of_one_shape_go_to_one_worker(tmp_path: Path) -> None:
    (tmp_path / "slow").write_text("0.02")
    run(tmp_path, 32, views=4)
    makers = begun(tmp_path)
    for first in range(0, 32, 4):
        assert len({makers[number][0] for number in range(first, first + 4)}) == 1
    assert len(workers(tmp_path)) == 2


def test_what_cannot_be_made_is_reported_and_the_rest_goes_on(tmp_path: Path) -> None:
    for number in (3, 4):
        (tmp_path / f"fail_{number}").touch()
    outcome = run(tmp_path, 8)
    assert outcome.made == 6
    assert outcome.failed == {n: f"sample {n} shows nothing; choose another" for n in (3, 4)}
    assert whole(tmp_path) == set(range(8)) - {3, 4}


@posix
def test_nothing_is_written_through_a_link_in_the_folder(tmp_path: Path) -> None:
    folder, precious = tmp_path / "samples", tmp_path / "precious"
    run(folder, 1)
    precious.write_text("mine")
    (folder / "sample_000001.exr").symlink_to(precious)
    outcome = run(folder, 3)
    assert outcome.made == 1 and "is a link to" in outcome.failed[1]
    (folder / "job.json").rename(precious.with_name("job.json"))
    (folder / "job.json").symlink_to(precious.with_name("job.json"))
    with pytest.raises(InputError, match="is a link to"):
        run(folder, 4)
    assert precious.read_text() == "mine" and '"count": 3' in precious.with_name("job.json").read_text()


def test_when_all_fail_it_stops(tmp_path: Path) -> None:
    for number in range(200):
        (tmp_path / f"fail_{number}").touch()
    with pytest.raises(InputError, match=rf"{FAILURES_IN_A_ROW} samples in a row failed.*sample \d+ shows nothing"):
        run(tmp_path, 200)
    assert len(begun(tmp_path)) < 200


def test_a_worker_that_dies_loses_only_its_sample_which_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "die_2").touch()
    assert run(tmp_path, 8, processes=1) == JobOutcome(made=8)
    assert whole(tmp_path) == set(range(8))
    first, second = begun(tmp_path)[2]
    assert first != second
    assert [begun(tmp_path)[number] for number in (0, 1)] == [[first]] * 2
    assert [begun(tmp_path)[number] for number in range(3, 8)] == [[second]] * 5
    assert unfinished(tmp_path) == []


def test_a_sample_is_made_though_its_worker_dies_before_it_says_so(tmp_path: Path) -> None:
    (tmp_path / "die_late_2").touch()
    assert run(tmp_path, 5) == JobOutcome(made=5)
    assert whole(tmp_path) == set(range(5)) and len(begun(tmp_path)[2]) == 1


def test_a_sample_that_every_worker_dies_of_is_given_up(tmp_path: Path) -> None:
    (tmp_path / "always_die_2").touch()
    outcome = run(tmp_path, 5)
    assert outcome.made == 4
    assert list(outcome.failed) == [2]
    assert outcome.failed[2].startswith("the worker died of it twice (signal 9; " if os.name == "posix" else "the ")
    assert len(begun(tmp_path)[2]) == 2
    assert unfinished(tmp_path) == []


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ([THIS_PYTHON, "-c", "import sys; print('hello'); sys.exit('no extension here')"], "exit code 1.*no extension"),
        ([THIS_PYTHON, "-c", """print('{"error": "no bpy here; install it"}')"""], "^no bpy here; install it$"),
        (["no-such-blender", "-b"], "cannot run no-such-blender .*; check the path"),
    ],
)
def test_workers_that_cannot_start_are_one_sentence(tmp_path: Path, command: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        make_samples(tmp_path, job(50), command, processes=2)
    assert "\n" not in str(caught.value)


def answering(*lines: str) -> list[str]:
    """The command of a worker that sends these answers, one to each request, whatever that is."""
    return [
        THIS_PYTHON,
        "-c",
        f"print('{{\"ready\": true}}', flush=True)\nfor line in {lines}: input(), print(line, flush=True)",
    ]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (answering('{"error": "seven is no number"}'), "^seven is no number$"),
        (answering('{"result": {"number": 7, "state": "made"}}'), "does not answer as a worker does"),
        ([THIS_PYTHON, "-c", """print('{"error": {}}')"""], r'exit code 0; its last words: {"error": {}}'),
        ([THIS_PYTHON, "-c", "print('[' * 60000)"], r"exit code 0; its last words: \[\["),
    ],
)
def test_a_program_that_is_no_worker_of_ours_is_reported(tmp_path: Path, command: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_samples(tmp_path, job(1), command, processes=1)


def test_a_worker_that_never_answers_is_ended_and_its_sample_given_up_after_two_tries(tmp_path: Path) -> None:
    script = f"""
import os, sys
with open({str(tmp_path / "silent")!r}, "a") as file:
    print(os.getpid(), file=file)
print('{{"ready": true}}', flush=True)
while sys.stdin.readline():
    pass
"""
    outcome = make_samples(tmp_path, job(1, sample_seconds=1), [THIS_PYTHON, "-c", script], processes=1)
    assert outcome == JobOutcome(failed={0: "the worker died of it twice (no answer in 1 s)"})
    pids = [int(line) for line in (tmp_path / "silent").read_text().split()]
    assert len(pids) == 2
    until(lambda: not any(map(alive, pids)))


@posix
def test_what_a_worker_started_ends_with_it(tmp_path: Path) -> None:
    """It holds the worker's pipes, whose end is waited for."""
    script = "import subprocess, sys; child = subprocess.Popen(['sleep', '1000']); sys.exit(f'left {child.pid}')"
    with pytest.raises(InputError, match="exit code 1; its last words: left ") as caught:
        make_samples(tmp_path, job(1), [THIS_PYTHON, "-c", script], processes=1)
    pid = int(str(caught.value).partition("left ")[2].partition(")")[0])
    until(lambda: not alive(pid))


def test_cancelling_ends_the_workers_at_once_and_the_next_run_goes_on(tmp_path: Path) -> None:
    (tmp_path / "slow").write_text("0.05")

    def until_stuck(fraction: float, words: str) -> None:
        """Cancels once six are made and the workers are in samples that would take them a minute."""
        if fraction >= 6 / 40:
            (tmp_path / "slow").write_text("60")
            time.sleep(0.3)
            raise Cancelled

    with pytest.raises(Cancelled):
        make_samples(tmp_path, job(40), COMMAND, processes=2, progress=until_stuck)
    assert not any(map(alive, workers(tmp_path)))
    assert unfinished(tmp_path) == []
    made = whole(tmp_path)
    assert 6 <= len(made) < 40
    (tmp_path / "slow").unlink()
    assert run(tmp_path, 40) == JobOutcome(made=40 - len(made), there=len(made))
    assert whole(tmp_path) == set(range(40))


@posix
def test_workers_of_a_killed_run_end_after_their_sample(tmp_path: Path) -> None:
    (tmp_path / "slow").write_text("0.3")
    parent = start(tmp_path, 100)
    until(lambda: len(begun(tmp_path)) == 2)
    parent.send_signal(signal.SIGKILL)
    parent.communicate()
    until(lambda: not any(map(alive, workers(tmp_path))))
    assert whole(tmp_path) == set(begun(tmp_path)) and len(whole(tmp_path)) < 100
    assert unfinished(tmp_path) == []


@posix
def test_what_killed_runs_left_is_cleared_by_the_next(tmp_path: Path) -> None:
    (tmp_path / "slow").write_text("60")
    parent = start(tmp_path, 4)
    until(lambda: len(unfinished(tmp_path)) == 2)
    os.kill(parent.pid, signal.SIGSTOP)  # neither sees the other end first, and clears up
    for pid in (*workers(tmp_path), parent.pid):
        os.kill(pid, signal.SIGKILL)
    parent.communicate()
    until(lambda: not any(map(alive, workers(tmp_path))))
    assert len(unfinished(tmp_path)) == 2
    left_by(parent.pid, tmp_path / "contact_sheet.png").touch()
    (tmp_path / "slow").unlink()
    assert run(tmp_path, 4) == JobOutcome(made=4)
    assert whole(tmp_path) == set(range(4))
    assert unfinished(tmp_path) == []


def test_two_runs_share_a_folder_and_no_sample_is_made_twice(tmp_path: Path) -> None:
    (tmp_path / "slow").write_text("0.02")
    runs = [start(tmp_path, 60), start(tmp_path, 60)]
    answers = [child.communicate(timeout=60) for child in runs]
    assert [words for _, words in answers] == ["", ""]
    counts = [tuple(map(int, out.split())) for out, _ in answers]
    assert all(made + there == 60 and failed == 0 for made, there, failed in counts)
    assert sum(made for made, _, _ in counts) == 60
    assert {number: len(pids) for number, pids in begun(tmp_path).items()} == dict.fromkeys(range(60), 1)
    assert len(workers(tmp_path)) == 4
    assert whole(tmp_path) == set(range(60))
