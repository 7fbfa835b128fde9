"""Files of the real logger of `opensourceleg`, with an actuator in offline mode, fit the shipped source file."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import FORMATS, read_source, recognise
from osl_analysis.ingest.source import Source

osl_logging = pytest.importorskip("opensourceleg.logging", reason="the package opensourceleg is not installed")
osl_base = pytest.importorskip("opensourceleg.actuators.base")

ROWS = 400
GEAR = 41.5
SHIPPED = Path(__file__).parents[1] / "config" / "sources" / "opensourceleg.yaml"


class Bench:
    """One moment of a trial: row k is at k ms."""

    k = 0


def joint(bench: Bench) -> Any:
    """An actuator of the package, offline, whose motor turns."""

    class Joint(osl_base.ActuatorBase):  # type: ignore[misc,name-defined]
        """Its motor's angle and current are ours, everything else is the offline mode's."""

        _OFFLINE_PROPERTIES: ClassVar[list[str]] = ["motor_velocity", "motor_voltage", "case_temperature"]

        @property
        def motor_position(self) -> float:
            return float(np.sin(bench.k / 50) * GEAR)

        @property
        def motor_current(self) -> float:
            return 100.0 * bench.k

    Joint.__abstractmethods__ = frozenset()
    return Joint("ankle", GEAR, osl_base.MOTOR_CONSTANTS(16384, 0.1, 80.0, 110.0), offline=True)


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Callable[..., Path]]:
    """Records a trial with the package's own logger; `fails(k)` says where a reading fails."""
    logger = osl_logging.LOGGER  # there is one in a process
    logger._log_path = str(tmp_path)  # its constructor would take the folder of the call before
    logger.set_file_name("trial")
    logger.set_stream_level(osl_logging.LogLevel.CRITICAL)

    def recorded(fails: Callable[[int], bool] = lambda k: False, rows: int = ROWS) -> Path:
        bench = Bench()
        actuator = joint(bench)

        def current() -> float:
            if fails(bench.k):
                raise OSError("no answer")
            return float(actuator.motor_current)

        functions = {
            "time": lambda: bench.k * 1e-3,
            "joint_position": lambda: np.cos(bench.k / 50),
            "output_position": lambda: actuator.output_position,
            "motor_current": current,
            "case_temperature": lambda: actuator.case_temperature,
            "sync": lambda: bench.k % 100 < 50,
        }
        logger.track_function(list(functions.values()), list(functions))
        for bench.k in range(rows):
            logger.update()
        logger.close()
        return tmp_path / "trial.csv"

    yield recorded
    logger.reset()


def shipped(**options: Any) -> Source:
    source = read_source(SHIPPED)
    return source.model_copy(update=options)


def test_the_shipped_source_file_reads_what_the_logger_wrote(record: Callable[..., Path]) -> None:
    path = record()
    assert recognise(path) == "csv"
    recording = FORMATS["csv"].read(path, shipped())
    k = np.arange(ROWS)
    np.testing.assert_allclose(recording.samples["time"], k * 1e-3, atol=1e-12)
    np.testing.assert_allclose(recording.samples["theta"], np.cos(k / 50), atol=1e-12)
    np.testing.assert_allclose(recording.samples["theta_m"], np.sin(k / 50), atol=1e-12)
    np.testing.assert_allclose(recording.samples["current"], 0.1 * k, atol=1e-12)
    np.testing.assert_array_equal(recording.samples["sync"], k % 100 < 50)
    assert recording.warnings == []


def test_a_variable_that_was_dropped_before_the_header_was_written_has_no_name(record: Callable[..., Path]) -> None:
    """The header comes with the first thousand rows, without the variable, whose cells stand in the rows before."""
    path = record(lambda k: k >= 380)
    assert "motor_current" not in path.read_text()
    with pytest.raises(InputError, match="column 'motor_current' is missing"):
        FORMATS["csv"].read(path, shipped())
    channels = {name: one for name, one in shipped().channels.items() if name != "current"}
    recording = FORMATS["csv"].read(path, shipped(channels=channels))
    k = np.arange(ROWS)
    np.testing.assert_array_equal(recording.samples["sync"], k % 100 < 50)
    np.testing.assert_allclose(recording.samples["theta_m"], np.sin(k / 50), atol=1e-12)
    assert any("up to line 386, cells 4 of every row have no name and were left out" in t for t in recording.warnings)
