"""A fit on a thread of its own, that can be stopped and continued."""

import json
import pathlib
import threading
from typing import Any, Optional

import dsdf

#: Seconds between two looks at the metrics of a running fit.
PERIOD = 0.01


class _Stop(Exception):
    """Ends a fit, which then writes a checkpoint."""


class RunningFit:
    """A fit in the run folder ``run``. It starts at the first wait for an iteration.

    One fit of dsdf is all iterations: nobody calls it for each of them. So it runs on by itself,
    and the caller follows it. ``stop`` ends it after a checkpoint; the next wait continues it.
    """

    def __init__(self, dataset: pathlib.Path, run: pathlib.Path, options: dict[str, Any]):
        self.dataset, self.run, self.options = dataset, run, options
        self._thread: Optional[threading.Thread] = None
        self._error: Optional[BaseException] = None
        self._stops = False
        #: The verdict of a fit that has done all iterations.
        self.verdict: Optional[str] = None
        #: The metrics of each iteration of the run so far.
        self._metrics: list[dict[str, float]] = []
        self._read = 0

    def has_model(self) -> bool:
        """Whether the run folder has a checkpoint and its model."""
        return (self.run / "checkpoint" / "state.safetensors").is_file()

    def wait_for(self, iteration: int) -> dict[str, float]:
        """The metrics of an iteration, counted from 1, once the fit has done it."""
        while True:
            # In this order: a thread that has ended writes no more.
            is_over = self._thread is None or not self._thread.is_alive()
            self._follow()
            # After its last iteration, a fit averages its parameters, and examines the surface.
            is_last = iteration >= int(self.options["iterations"])
            if len(self._metrics) >= iteration and (is_over or not is_last):
                self._raise()
                return self._metrics[iteration - 1]
            if not is_over:
                self._thread.join(PERIOD)
                continue
            if self._thread is not None:
                self._thread = None
                self._raise()
                done = len(self._metrics)
                raise RuntimeError(f"the fit ended after {done} iterations, not {iteration}")
            self._start()

    def stop(self) -> None:
        """Stops the fit, if it is running, after a checkpoint."""
        if self._thread is not None:
            self._stops = True
            self._thread.join()
            self._thread = None
            self._raise()

    def first_model(self) -> None:
        """Makes the model after the first iteration, unless there is a model."""
        if not self.has_model():
            self._fit(stop_after=1)

    def _start(self) -> None:
        self._stops = False
        self._thread = threading.Thread(target=self._run, name="dsdf fit", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._fit(progress=self._look)
        except _Stop:
            pass
        except BaseException as error:  # the thread that waits raises it
            self._error = error

    def _fit(self, **more: Any) -> None:
        resume = self.has_model()
        run = dsdf.fit(self.dataset, self.run, resume=resume, **self.options, **more)
        verdict = (run.report or {}).get("verdict")
        if verdict is not None:
            self.verdict = verdict["text"]

    def _look(self, _fraction: float, _text: str) -> None:
        if self._stops:
            raise _Stop

    def _raise(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _follow(self) -> None:
        """Reads the new lines of the metrics."""
        path = self.run / "metrics.jsonl"
        if not path.is_file():
            return
        with open(path, "rb") as file:
            # A fit that begins again in a larger sphere begins its metrics again.
            if file.seek(0, 2) < self._read:
                self._read = 0
            file.seek(self._read)
            new = file.read()
        whole = new[: new.rfind(b"\n") + 1]
        self._read += len(whole)
        for line in whole.splitlines():
            metrics = json.loads(line)
            del self._metrics[metrics["iteration"] - 1 :]
            self._metrics.append(metrics)
