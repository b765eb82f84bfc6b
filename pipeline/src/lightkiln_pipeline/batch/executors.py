"""Where tasks run: processes of this machine, or the workers of a Dask cluster. Tasks → outcomes as they arrive."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass
from queue import Empty, SimpleQueue
from threading import Event
from typing import Any, Protocol

from ..errors import EnvironmentFault, PipelineError
from .stamp import Stamp
from .task import Task, run_task
from .tiles import gather_asset, merge_asset, solve_asset

Message = dict[str, Any]


@dataclass(frozen=True)
class Outcome:
    """How a task ended."""

    task: Task
    stamp: Stamp | None
    message: str = ""
    """Why it failed."""
    exit_code: int = 0
    attempts: int = 1


Items = Generator["tuple[Task, Message] | Outcome", None, None]


class Executor(Protocol):
    """Runs tasks."""

    def run(self, tasks: Sequence[Task], stop_on_failure: bool) -> Items:
        """Yields progress as (task, event), and an outcome per task that was started."""


class LocalExecutor:
    """A process per task, so that a crash takes nothing else along."""

    def __init__(self, jobs: int) -> None:
        """`jobs`: tasks at a time."""
        self._jobs = jobs
        self._processes: set[subprocess.Popen[str]] = set()
        self._ending = Event()

    def run(self, tasks: Sequence[Task], stop_on_failure: bool) -> Items:
        """See Executor."""
        events: SimpleQueue[tuple[Task, Message]] = SimpleQueue()
        waiting, running = list(reversed(tasks)), set[Future[Outcome]]()
        with ThreadPoolExecutor(self._jobs) as pool:
            try:
                while waiting or running:
                    while waiting and len(running) < self._jobs:
                        running.add(pool.submit(self._attempts, waiting.pop(), events))
                    done, running = wait(running, timeout=0.1, return_when=FIRST_COMPLETED)
                    yield from _drained(events)
                    for future in done:
                        outcome = future.result()
                        if outcome.stamp is None and stop_on_failure:
                            waiting.clear()
                        yield outcome
            finally:
                # Interrupted: what runs is ended, what is finished stays.
                self._ending.set()
                for process in list(self._processes):
                    _end(process)

    def _attempts(self, task: Task, events: SimpleQueue[tuple[Task, Message]]) -> Outcome:
        """Runs a task again after a crash or a timeout; a fault that it reports itself would only come again."""
        retries = int(task.settings.get("retries", 1))
        for attempt in range(1, retries + 2):
            outcome = self._attempt(task, events, attempt)
            if outcome.stamp is not None or outcome.exit_code != 0 or self._ending.is_set():
                return outcome
        return Outcome(task, None, f"{outcome.message}; tried {attempt} times", 1, attempt)

    def _attempt(self, task: Task, events: SimpleQueue[tuple[Task, Message]], attempt: int) -> Outcome:
        command = [sys.executable, "-m", "lightkiln_pipeline.batch.task"]
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        process = subprocess.Popen(command, text=True, encoding="utf-8", start_new_session=os.name != "nt", **pipes)
        self._processes.add(process)
        timeout, start = task.settings.get("timeout"), time.monotonic()
        last: Message = {}
        timed_out = False
        try:
            assert process.stdin is not None and process.stdout is not None and process.stderr is not None
            with ThreadPoolExecutor(2) as readers:
                said = readers.submit(process.stderr.read)
                if timeout is not None:
                    readers.submit(_end_after, process, float(timeout))
                # Held open until the task ends: when this process dies, the task notices.
                process.stdin.write(json.dumps(asdict(task)) + "\n")
                process.stdin.flush()
                for line in process.stdout:
                    last = json.loads(line)
                    events.put((task, last))
                process.wait()
                timed_out = timeout is not None and time.monotonic() - start >= float(timeout)
        except (OSError, ValueError) as error:
            return Outcome(task, None, f"the worker broke off: {error}", 0, attempt)
        finally:
            self._processes.discard(process)
            if process.stdin is not None:
                with contextlib.suppress(OSError):
                    process.stdin.close()
        if last.get("event") == "finished":
            return Outcome(task, Stamp(**last["stamp"]), "", 0, attempt)
        if last.get("event") == "failed":
            return Outcome(task, None, str(last["message"]), int(last["exit_code"]), attempt)
        if timed_out:
            return Outcome(
                task, None, f"it took longer than {timeout} s; raise `timeout` or lower the density", 0, attempt
            )
        words = said.result().strip().splitlines()
        reason = f": {words[-1]}" if words else ""
        return Outcome(task, None, f"the worker ended with code {process.returncode}{reason}", 0, attempt)


def _drained(events: SimpleQueue[tuple[Task, Message]]) -> Iterator[tuple[Task, Message]]:
    while True:
        try:
            yield events.get_nowait()
        except Empty:
            return


def _end_after(process: subprocess.Popen[str], seconds: float) -> None:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    """Ends a worker and its baker, which are a group where the system has groups."""
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
    else:
        process.terminate()


class DaskExecutor:
    """The workers of a Dask cluster: of a scheduler, or of a cluster that this process starts."""

    def __init__(self, scheduler: str | None, jobs: int) -> None:
        """Connects. Raises EnvironmentFault if Dask or the scheduler is missing."""
        try:
            from distributed import Client, LocalCluster
        except ImportError as error:
            raise EnvironmentFault("Dask is missing: pip install 'lightkiln-pipeline[dask]'") from error
        try:
            cluster = None if scheduler else LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
            self._client = Client(scheduler or cluster, timeout=30)
        except OSError as error:
            raise EnvironmentFault(f"no Dask scheduler answers at {scheduler}: {error}") from error
        self._cluster = cluster

    def run(self, tasks: Sequence[Task], stop_on_failure: bool) -> Items:
        """See Executor. Workers that die are replaced by Dask, which then runs their task again."""
        from distributed import as_completed

        jobs = [self._submit(task) for task in tasks]
        results = {job.result: job for job in jobs}
        steps = {step: job for job in jobs for step in job.steps}
        try:
            for future in as_completed([*steps, *results]):
                if future in steps:
                    job = steps[future]
                    job.finished += 1
                    yield job.task, {"event": "progress", "stage": "gather", "done": job.finished / len(job.steps)}
                    continue
                task = results[future].task
                if future.status != "finished":
                    yield Outcome(task, None, f"the worker was lost: {future.exception()}", 1)
                    stamp = None
                else:
                    stamp, message, code = future.result()
                    yield Outcome(task, stamp, message, code)
                if stamp is None and stop_on_failure:
                    return
        finally:
            self._client.cancel([*steps, *results])
            self._client.close()
            if self._cluster is not None:
                self._cluster.close()

    def _submit(self, task: Task) -> _Job:
        """The asset as one task, or as its parts: solve, then tiles, then merge."""
        retries, of = int(task.settings.get("retries", 1)), int(task.settings.get("tiles", 1))

        def submit(part: str, work: Callable[..., Ending], *inputs: Any) -> Any:
            key = f"lightkiln-{part}-{task.name}-{task.key}"
            return self._client.submit(run_quietly, work, task, *inputs, key=key, retries=retries)

        if of == 1:
            return _Job(task, submit("bake", _bake), [])
        solved = submit("solve", _solve)
        tiles = [submit(f"gather{part}", _gather, solved, part, of) for part in range(of)]
        return _Job(task, submit("merge", _merge, tiles), [solved, *tiles])


Ending = tuple["Stamp | None", str, int]
"""A stamp where there are results, or the message and exit code of a fault: such a fault would only come again."""


@dataclass
class _Job:
    """An asset on a cluster."""

    task: Task
    result: Any
    """The future of its ending."""
    steps: list[Any]
    """Futures that come before."""
    finished: int = 0
    """How many of these are done."""


def run_quietly(work: Callable[..., Ending], task: Task, *inputs: Any) -> Ending:
    """Does a part of an asset."""
    try:
        return work(task, *inputs)
    except PipelineError as error:
        return None, str(error), error.exit_code


def _bake(task: Task) -> Ending:
    return run_task(task, _silent), "", 0


def _solve(task: Task) -> Ending:
    solve_asset(task, _silent)
    return None, "", 0


def _gather(task: Task, solved: Ending, part: int, of: int) -> Ending:
    if not solved[1]:
        gather_asset(task, range(part, part + 1), of, _silent)
    return solved


def _merge(task: Task, gathered: list[Ending]) -> Ending:
    failed = next((ending for ending in gathered if ending[1]), None)
    return failed or (merge_asset(task, _silent), "", 0)


def _silent(_: Message) -> None:
    """Progress does not leave the worker."""
