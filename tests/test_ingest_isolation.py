"""Isolation: whatever a decoder does to its process, the parent gets arrays or a sentence."""

import os
import signal
import time

import numpy as np
import pytest

from osl_analysis.errors import InputError
from osl_analysis.ingest.isolation import isolated


def test_arrays_come_back_as_they_are() -> None:
    given = [np.array([[1.0, np.nan], [-0.0, np.inf]]), np.zeros((0, 4)), np.arange(3.0)]
    for found, expected in zip(isolated(lambda: given, 10.0), given, strict=True):
        np.testing.assert_array_equal(found, expected)


def raises() -> list[np.ndarray]:
    raise OSError("no such\nchannel")


def segfaults() -> list[np.ndarray]:
    os.kill(os.getpid(), signal.SIGSEGV)
    return []


def exits() -> list[np.ndarray]:
    os._exit(7)


def hangs() -> list[np.ndarray]:
    time.sleep(60)
    return []


@pytest.mark.parametrize(
    ("work", "sentence"),
    [
        (raises, "no such channel"),
        (segfaults, r"the decoder crashed \(SIGSEGV\)"),
        (exits, r"the decoder crashed \(7\)"),
        (hangs, "the decoder was stopped: it ran out of time or memory"),
    ],
)
def test_a_failure_is_a_sentence(work: object, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        isolated(work, 0.5)


def test_nothing_of_the_childs_output_is_seen(capfd: pytest.CaptureFixture[str]) -> None:
    def talks() -> list[np.ndarray]:
        os.write(1, b"out")
        os.write(2, b"err")
        return []

    isolated(talks, 10.0)
    assert capfd.readouterr() == ("", "")


def test_it_works_inside_a_child_too() -> None:
    assert isolated(lambda: isolated(lambda: [np.ones(2)], 5.0), 10.0)[0].tolist() == [1, 1]
