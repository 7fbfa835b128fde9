"""Files of the real logger of `opensourceleg` fit the shipped source file."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import FORMATS, read_source, recognise

osl_logging = pytest.importorskip("opensourceleg.logging", reason="the package opensourceleg is not installed")
K = np.arange(400)
SHIPPED = Path(__file__).parents[1] / "config" / "sources" / "opensourceleg.yaml"


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Callable[..., Path]]:
    """Records a trial with the package's own logger, row k at k ms; a reading of the current fails from `fails` on."""
    logger = osl_logging.LOGGER  # there is one in a process
    logger._log_path = str(tmp_path)  # its constructor would take the folder of the call before
    logger.set_file_name("trial")
    logger.set_stream_level(osl_logging.LogLevel.CRITICAL)

    def recorded(fails: int = K.size) -> Path:
        k = 0

        def current() -> float:
            if k >= fails:
                raise OSError("no answer")
            return 100.0 * k

        functions = {
            "time": lambda: k * 1e-3,
            "joint_position": lambda: np.cos(k / 50),
            "output_position": lambda: np.sin(k / 50),
            "motor_current": current,
            "case_temperature": lambda: 25.0,
            "sync": lambda: k % 100 < 50,
        }
        logger.track_function(list(functions.values()), list(functions))
        for k in range(K.size):  # noqa: B007
            logger.update()
        logger.close()
        return tmp_path / "trial.csv"

    yield recorded
    logger.reset()


def test_the_shipped_source_file_reads_what_the_logger_wrote(record: Callable[..., Path]) -> None:
    path = record()
    assert recognise(path) == "csv"
    recording = FORMATS["csv"].read(path, read_source(SHIPPED))
    expected = {"time": K * 1e-3, "theta": np.cos(K / 50), "theta_m": np.sin(K / 50), "current": 0.1 * K}
    for column, values in expected.items():
        np.testing.assert_allclose(recording.samples[column], values, atol=1e-12)
    np.testing.assert_array_equal(recording.samples["sync"], K % 100 < 50)
    assert recording.warnings == []


def test_a_variable_that_was_dropped_before_the_header_was_written_has_no_name(record: Callable[..., Path]) -> None:
    """The header comes with the first thousand rows, without the variable, whose cells stand in the rows before."""
    path = record(380)
    assert "motor_current" not in path.read_text()
    with pytest.raises(InputError, match="column 'motor_current' is missing"):
        FORMATS["csv"].read(path, read_source(SHIPPED))
    source = read_source(SHIPPED)
    del source.channels["current"]
    recording = FORMATS["csv"].read(path, source)
    np.testing.assert_array_equal(recording.samples["sync"], K % 100 < 50)
    np.testing.assert_allclose(recording.samples["theta_m"], np.sin(K / 50), atol=1e-12)
    assert any("up to line 386, cells 4 of every row have no name and were left out" in t for t in recording.warnings)
