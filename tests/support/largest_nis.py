"""A recorder beside those of the harness: the example of docs/structure.md."""

import numpy as np

from harness.engine.kernel_names import LANES, get, put, select, splat
from harness.runner.contract import Recorder
from harness.runner.filter_loop import no_room, record_first, record_sample, recording_room, run_filter


def run_and_keep_largest(source, belief, first, largest):
    """Run a filter over a batch and keep the largest NIS of each run."""
    memories = np.empty(first.memory.shape), np.empty(first.memory.shape)
    run_filter(source, belief, first, memories, (largest,))


def begin_largest(samples, state, u, belief, room, record):
    put(splat(0.0), record[0], 0)


def add_largest(k, state, previous, u_before, u, y, belief, work, info, room, record):
    nis, largest = get(info.nis, 0), get(record[0], 0)
    put(select(nis > largest, nis, largest), record[0], 0)


class LargestNis:
    """The largest NIS of each run ``(LANES,)``."""

    recorder = Recorder(
        run_and_keep_largest, {recording_room: no_room, record_first: begin_largest, record_sample: add_largest}
    )

    def run(self, loop, source, belief, first, limits, filter_):
        largest = np.empty((1, LANES))
        loop(source, belief, first, largest)
        return largest[0]

    def of(self, history, filter_):
        return np.nanmax(history.facts[:, 0], axis=0)
