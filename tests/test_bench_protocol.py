"""The stepped sine is found wherever it lies, and what does not follow it is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest

from osl_analysis.bench.protocol import (
    Block,
    Segment,
    SteppedSineProtocol,
    block_segments,
    find_blocks,
    repeated_cycles,
    rows_of,
    settled,
    unit_block,
)
from osl_analysis.errors import InputError

PROTOCOL = SteppedSineProtocol(amplitudes=(0.03, 0.06, 0.1), frequencies_hz=(2.0, 4.0), cycles=6)


RATE = 500.0


def stepped_record(start=3.0, rests=(1.0, 1.0, 2.0), unit=1.0, protocol=PROTOCOL):
    pieces = [np.zeros(round(start * RATE))]
    for amplitude, rest in zip(protocol.amplitudes, rests, strict=True):
        pieces += [amplitude * unit * unit_block(protocol, RATE), np.zeros(round(rest * RATE))]
    theta = np.concatenate(pieces)
    return np.arange(len(theta)) / RATE, theta


@pytest.mark.parametrize("start", [0.0, 3.0, 7.7])
def test_finds_every_segment_wherever_the_record_starts(start):
    blocks = find_blocks(*stepped_record(start), PROTOCOL)
    starts = [start, start + 4.5 + 1.0, start + 2 * (4.5 + 1.0)]
    assert [b.segments[0].start / RATE for b in blocks] == pytest.approx(starts, abs=1.5 / RATE)
    assert [(s.stop - s.start) / RATE for b in blocks for s in b.segments] == pytest.approx([3, 1.5] * 3)


def test_a_protocol_that_is_not_in_the_record_is_refused():
    with pytest.raises(InputError, match=r"amplitude of 98\.\d+ deg, the protocol says 1\.7"):
        find_blocks(*stepped_record(unit=57.3), PROTOCOL)
    time, theta = stepped_record()
    with pytest.raises(InputError, match=r"amplitude of 0\.00 deg"):
        find_blocks(time, 0 * theta, PROTOCOL)
    with pytest.raises(InputError, match="the trial lasts"):
        find_blocks(time[:3000], theta[:3000], PROTOCOL)


@pytest.mark.parametrize("frequencies_hz", [(2.0, 4.0), (1.0, 2.0, 3.0, 4.0, 5.0), (3.0,), (4.0, 4.4, 5.0)])
@pytest.mark.parametrize("really", [6, 7, 9, 12])
def test_a_configuration_with_fewer_cycles_than_were_recorded_is_refused_with_both_counts(frequencies_hz, really):
    """At rest, at another frequency (a tenth higher at least) and at another amplitude a sine does not go on."""
    configured = replace(PROTOCOL, frequencies_hz=frequencies_hz, cycles=6)
    time, theta = stepped_record(rests=(1.0, 0.0, 0.0), protocol=replace(configured, cycles=really))
    theta += 1e-4 * np.random.default_rng(1).standard_normal(len(theta)) + 0.02
    if really == 6:
        assert len(find_blocks(time, theta, configured)) == len(configured.amplitudes)
    else:
        with pytest.raises(InputError, match="the protocol says 6; correct `cycles`") as caught:
            find_blocks(time, theta, configured)
        assert int(re.search(r"about (\d+) cycles", str(caught.value))[1]) in (really - 1, really, really + 1)


def test_settled_cycles_leave_out_the_first_and_the_last_and_keep_one():
    segment = Segment(0.1, 2.0, 100, 1100, 10)
    block = Block(0.1, (segment,))
    (kept,) = settled([block], 2)
    assert (kept.start, kept.stop, kept.cycles) == (300, 1000, 7)
    (kept,) = settled([block], 20)
    assert (kept.start, kept.stop, kept.cycles) == (1000, 1100, 1)


def test_cycles_tile_the_rows_of_the_segments_also_when_they_are_thinned_out():
    protocol = SteppedSineProtocol((0.1,), (2.0, 3.0), 9)
    segments = settled([Block(0.1, block_segments(17, 0.1, protocol, 500.0))], 1)
    for every, skip in ((1, 0), (8, 3)):
        cycles = repeated_cycles(segments, every, skip)
        kept = sum(len(range(s.start, s.stop, every)) - skip for s in segments)
        assert cycles.first[0] == 0
        assert (np.diff(cycles.first) > 0).all()
        assert cycles.first[-1] < kept
        assert list(np.bincount(cycles.stratum)) == [7, 7]
        assert cycles.first[7] == len(range(segments[0].start, segments[0].stop, every)) - skip
    assert len(rows_of(segments)) == segments[0].stop - segments[0].start + segments[1].stop - segments[1].start
    second = repeated_cycles(segments).first[7]
    assert second == segments[0].stop - segments[0].start
    assert repeated_cycles(settled([Block(0.1, block_segments(0, 0.1, protocol, 500.0))], 5)) is None
