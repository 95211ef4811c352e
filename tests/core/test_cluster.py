"""Samples made on a Dask cluster, whose workers may be killed; a worker that stands in for a renderer."""

import gc
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from dask import config as dask_config
from distributed import Client, LocalCluster
from distributed.security import Security
from farm_runs import alive, job, posix, until, workers
from stand_in import COMMAND, begun, whole
from synthetic import listing

from mpsnet_core.cli import main
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.synthesis.farm import cluster as dask
from mpsnet_core.synthesis.farm.address import check_address
from mpsnet_core.synthesis.farm.run import JobOutcome, make_samples
from mpsnet_core.synthesis.job import write_job

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def cluster() -> Iterator[LocalCluster]:
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as local:
        yield local


def run(cluster: LocalCluster, folder: Path, count: int, **options: object) -> JobOutcome:
    return make_samples(folder, job(count), COMMAND, cluster=cluster.scheduler_address, **options)  # type: ignore[arg-type]


def test_every_sample_is_made_once_and_what_is_there_is_not_made_again(cluster: LocalCluster, tmp_path: Path) -> None:
    told: list[str] = []
    assert run(cluster, tmp_path, 20) == JobOutcome(made=20)
    outcome = run(cluster, tmp_path, 30, progress=lambda fraction, words: told.append(words))
    assert outcome == JobOutcome(made=10, there=20)
    assert whole(tmp_path) == set(range(30))
    assert {number: len(pids) for number, pids in begun(tmp_path).items()} == dict.fromkeys(range(30), 1)
    assert told[-1] == "30 of 30" and next(words for words in told if "looking" not in words) == "20 of 30"
    until(lambda: not any(map(alive, workers(tmp_path))))


@posix
def test_a_killed_dask_worker_loses_only_its_current_sample(cluster: LocalCluster, tmp_path: Path) -> None:
    """SIGKILL for a Dask worker's process and for the process of ours that it asks, in the middle of the run."""
    (tmp_path / "slow").write_text("0.05")

    def parent(pid: int) -> int:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])

    killed: list[int] = []

    def kill() -> None:
        until(lambda: len(begun(tmp_path)) >= 15)
        ours = list(begun(tmp_path).values())[-1][0]
        killed.extend([parent(ours), ours])
        for pid in killed:
            os.kill(pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    outcome = run(cluster, tmp_path, 60)
    killer.join()
    with Client(cluster, set_as_default=False) as client:
        assert killed[0] not in client.run(os.getpid).values()
    assert outcome.made + outcome.there == 60 and not outcome.failed
    assert whole(tmp_path) == set(range(60))
    assert [name for name in listing(tmp_path) if "unfinished" in name] == []
    times = [len(pids) for pids in begun(tmp_path).values()]
    assert max(times) <= 2 and times.count(2) <= 1
    assert killed[1] in workers(tmp_path)


def test_cancelling_ends_tasks_and_processes(cluster: LocalCluster, tmp_path: Path) -> None:
    (tmp_path / "slow").write_text("0.05")

    def until_six(fraction: float, words: str) -> None:
        if fraction >= 6 / 40:
            raise Cancelled

    with pytest.raises(Cancelled):
        run(cluster, tmp_path, 40, progress=until_six)
    until(lambda: not any(map(alive, workers(tmp_path))))
    made = whole(tmp_path)
    assert 6 <= len(made) < 20
    time.sleep(0.3)
    assert whole(tmp_path) == made
    outcome = run(cluster, tmp_path, 40)
    assert outcome.made + outcome.there == 40 and whole(tmp_path) == set(range(40))


def test_a_folder_that_the_machines_do_not_see_is_reported(cluster: LocalCluster, tmp_path: Path) -> None:
    answers = dask.results_from_cluster(cluster.scheduler_address, COMMAND, tmp_path / "elsewhere", [0])
    with pytest.raises(InputError, match=r"worker tcp://.* does not see .*job\.json; choose a folder that all"):
        list(answers)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nowhere", "gopher://127.0.0.1:8786", "tcp://127.0.0.1:x"])
def test_an_address_where_nobody_answers_is_reported(tmp_path, address: str, monkeypatch, capfd) -> None:
    monkeypatch.setattr(dask, "CONNECT_SECONDS", 0.2)
    write_job(tmp_path, job(3))
    with pytest.raises(InputError, match=f"no Dask scheduler at {address} .*give one like tcp://"):
        make_samples(tmp_path, job(3), COMMAND, cluster=address, cluster_trusted=True)
    assert capfd.readouterr().err == ""
    assert not [thing for thing in gc.get_objects() if isinstance(thing, Client) and thing.status == "connecting"]


def test_a_cluster_that_is_refused_leaves_no_job_that_it_began(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask, "CONNECT_SECONDS", 0.2)
    begin = ["synthesize", "--count", "1", "--size", "24", "--seed", "3", "-o", str(tmp_path / "new")]
    resume = ["make", str(tmp_path / "begun")]
    (tmp_path / "begun").mkdir()
    write_job(tmp_path / "begun", job(3))
    for words in (begin, resume):
        assert main([*words, "--cluster", "tcp://127.0.0.1:1"]) == 2
    assert not (tmp_path / "new").exists() and (tmp_path / "begun" / "job.json").is_file()


@pytest.mark.parametrize("address", ["tcp://10.0.0.1:8786", "127.0.0.1.evil.example:8786", "wss://10.0.0.1:8786"])
def test_nobody_elsewhere_is_listened_to_who_cannot_prove_who_it_is(tmp_path: Path, address: str) -> None:
    with pytest.raises(InputError, match=f"^anyone who answers at {address} could run code here; give a tls:// .*ted"):
        make_samples(tmp_path, job(3), COMMAND, cluster=address)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "localhost:8786", "tcp://[::1]:8786", "tls://host:8786"])
def test_this_machine_and_whoever_proves_who_it_is_need_no_word(address: str) -> None:
    check_address(address, trusted=False)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two certificates that sign themselves, ours.pem and theirs.pem, their keys among them."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl, which makes certificates, is not installed")
    folder = tmp_path_factory.mktemp("certificates")
    for name in ("ours", "theirs"):
        made = ["-keyout", f"{name}.key", "-out", f"{name}.crt", "-subj", f"/CN={name}", "-days", "2"]
        command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", *made]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
        both = [(folder / f"{name}.{part}").read_text() for part in ("crt", "key")]
        (folder / f"{name}.pem").write_text("".join(both))
    return folder


def test_a_tls_address_needs_the_certificates_of_its_cluster(certificates: Path, tmp_path, monkeypatch) -> None:
    ours, theirs = (str(certificates / f"{name}.pem") for name in ("ours", "theirs"))
    roles = {f"tls_{role}_cert": ours for role in ("client", "scheduler", "worker")}
    security = Security(require_encryption=True, tls_ca_file=ours, **roles)
    how = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(protocol="tls", security=security, **how) as local:

        def made_with(certificate: str | None) -> JobOutcome:
            named = dict.fromkeys(("distributed.comm.tls.ca-file", "distributed.comm.tls.client.cert"), certificate)
            with dask_config.set(named):
                return make_samples(tmp_path, job(3), COMMAND, cluster=local.scheduler_address)

        with pytest.raises(InputError, match=r"^tls://.* needs certificates; name them in Dask's configuration"):
            made_with(None)
        with pytest.raises(InputError, match=r"^the certificates for tls://.* cannot be read .*check the paths"):
            made_with(str(certificates / "none.pem"))
        monkeypatch.setattr(dask, "CONNECT_SECONDS", 1)
        with pytest.raises(InputError, match=r"^no Dask scheduler at tls://"):
            made_with(theirs)
        monkeypatch.undo()
        assert made_with(ours) == JobOutcome(made=3)
