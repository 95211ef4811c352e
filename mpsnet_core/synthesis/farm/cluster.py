"""Make samples on a Dask cluster, whose workers start worker processes of their own."""

import asyncio
import contextlib
import logging
import uuid
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from mpsnet_core import __version__
from mpsnet_core.errors import FileError, InputError, SettingsError
from mpsnet_core.synthesis.farm.address import check_address
from mpsnet_core.synthesis.farm.work import SampleResult, SampleResults, Worker, gathered
from mpsnet_core.synthesis.job import JOB_FILE, read_job

try:
    from distributed import CancelledError, Client, Future, KilledWorker, WorkerPlugin, get_worker
    from distributed.comm import connect
    from distributed.security import Security
except ImportError as error:
    raise InputError(f"a cluster needs Dask ({error}); install it with: pip install distributed") from None

CONNECT_SECONDS = 10
# Of samples, which one process of ours makes.
LONGEST_BATCH = 50


def results_from_cluster(
    address: str, command: Sequence[str], folder: Path, numbers: Sequence[int], *, trusted: bool = False
) -> SampleResults:
    """Results of the Dask workers at the scheduler `address` for the samples `numbers`, a few to a task.

    trusted: whether the whole network is trusted. If not, a remote address must be tls://, see :func:`check_address`.
    Certificates are from Dask's configuration (``distributed.comm.tls``).

    Raises InputError if the cluster cannot be reached or authenticated, is lost, or its workers cannot make the job's
    samples.
    """
    check_address(address, trusted=trusted)
    if not numbers:
        return
    pending: dict[Any, Sequence[int]] = {}
    with _client(address) as client, _sample_workers(client, command, folder) as plugin:
        longest = min(LONGEST_BATCH, len(numbers) // (4 * (sum(client.nthreads().values()) or 1))) or 1
        batches = [numbers[start : start + longest] for start in range(0, len(numbers), longest)]

        def submit(batch: Sequence[int]) -> Future:
            key = f"{plugin}-{batch[0]}-{uuid.uuid4()}"
            return client.submit(_make, plugin, batch, key=key, pure=False, priority=-batch[0])

        try:
            yield from gathered(submit, batches, partial(_task_results, address), pending)
        finally:
            with contextlib.suppress(OSError):  # the scheduler has gone
                client.cancel(list(pending), force=True)


def _task_results(address: str, task: Future, batch: Sequence[int]) -> list[SampleResult] | None:
    """The answer of a task; None if it was lost with its worker while the scheduler is still there."""
    try:
        if task.status == "finished":
            return task.result()
        error = task.exception() if task.status == "error" else None
    except CancelledError:
        error = None
    if error is None and task.client.status == "running":
        return None
    if isinstance(error, KilledWorker):
        return [SampleResult(number, "failed", "the cluster's workers died of it again and again") for number in batch]
    if isinstance(error, InputError):
        raise error
    reason = f" ({error})" if error is not None else ""
    raise InputError(f"the cluster at {address} was lost{reason}; run again to continue")


async def _reach(address: str, security: Security) -> None:
    connecting = connect(address, timeout=CONNECT_SECONDS, **security.get_connection_args("client"))
    try:  # an open port that never answers would block connect() forever
        comm = await asyncio.wait_for(connecting, CONNECT_SECONDS + 1)
    except TimeoutError:
        raise OSError("it does not answer") from None
    await comm.close()


def _security(address: str) -> Security:
    """TLS security from Dask's configuration. A tls:// address requires certificates."""
    if not address.startswith("tls://"):
        return Security()
    try:
        security = Security(require_encryption=True)
        proven = security.get_connection_args("client")["ssl_context"] is not None
    except OSError as error:
        raise FileError(
            f"the certificates for {address} cannot be read ({error.strerror or error}); check the paths that Dask's "
            "configuration gives under distributed.comm.tls"
        ) from None
    if not proven:
        raise SettingsError(
            f"{address} needs certificates; name them in Dask's configuration, ca-file, client.cert and client.key "
            "under distributed.comm.tls"
        )
    return security


@contextlib.contextmanager
def _client(address: str) -> Iterator[Client]:
    security = _security(address)
    # Silence Dask's logs of errors that we report in a sentence.
    logs = [logging.getLogger(name) for name in ("distributed", "distributed.client", "distributed.comm")]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                # A Client that cannot connect stays half open until it is garbage collected. If that happens while the
                # next one starts, they deadlock. So test the connection before creating a Client.
                with ThreadPoolExecutor(1) as elsewhere:  # this thread may already run an event loop
                    elsewhere.submit(asyncio.run, _reach(address, security)).result()
                client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False, security=security)
            except Exception as error:  # noqa: BLE001 - bytes that are not from a scheduler can cause any exception
                reason = " ".join(str(error).split()) or type(error).__name__
                raise InputError(f"no Dask scheduler at {address} ({reason}); give one like tcp://host:8786") from None
        with client:
            versions: Any = client.get_versions()
            ours = versions["client"]["packages"]["distributed"]
            for where, facts in {"scheduler": versions["scheduler"], **versions["workers"]}.items():
                theirs = facts["packages"]["distributed"]
                if theirs != ours:
                    raise InputError(f"{where} has distributed {theirs}, this machine {ours}; install the same")
            yield client
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)


@contextlib.contextmanager
def _sample_workers(client: Client, command: Sequence[str], folder: Path) -> Iterator[str]:
    """Install :class:`_SampleWorkers` on all present and future workers of the cluster, under a unique name."""
    name = f"mpsnet-{uuid.uuid4()}"
    try:
        client.register_plugin(_SampleWorkers(command, folder), name=name)
    except ImportError as error:
        raise InputError(f"the cluster's workers lack mpsnet ({error}); install it on each machine") from None
    try:
        yield name
    finally:
        with contextlib.suppress(OSError):  # the scheduler has gone
            client.unregister_worker_plugin(name)


def _make(plugin: str, batch: Sequence[int]) -> list[SampleResult]:
    own: Any = get_worker().plugins[plugin]
    return own.make(batch)


class _SampleWorkers(WorkerPlugin):
    """Plugin of each Dask worker that starts a process of ours for each task."""

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        # Not a Path: the worker's operating system may have other paths.
        self.command, self.folder, self.version = tuple(command), str(folder), __version__

    def setup(self, worker: object) -> None:
        self.running: set[Worker] = set()

    def make(self, batch: Sequence[int]) -> list[SampleResult]:
        """Make samples. Raises InputError if this machine cannot make samples of the job."""
        where = get_worker().address
        if self.version != __version__:
            raise InputError(f"the cluster's worker {where} has mpsnet {__version__}, not {self.version}; update it")
        job = Path(self.folder) / JOB_FILE
        if not job.is_file():
            raise FileError(f"the cluster's worker {where} does not see {job}; choose a folder that all machines reach")
        worker = Worker(self.command, self.folder, seconds=read_job(self.folder).sample_seconds)
        self.running.add(worker)
        try:
            return [worker.make(number) for number in batch]
        finally:
            worker.close()
            self.running.discard(worker)

    def teardown(self, worker: object) -> None:
        for own in list(self.running):
            own.end()
