"""Path: what lies between the joint's torque and its number."""

from abc import abstractmethod

import numpy as np

from osl_analysis.inference.constants import COMPLIANCES, DELAYS, LAGS
from osl_analysis.inference.hypothesis import Candidate, OneParameter, Search
from osl_analysis.inference.spectra import Spectrum
from osl_analysis.trial import Array


class Path(OneParameter):
    """What lies between the joint's torque and its record."""

    family = "path"

    def candidates(self, search: Search) -> list[Candidate]:
        return super().candidates(search) if search.may_be_path else []


class Filter(Path):
    """A linear filter of the torque."""

    def grid(self) -> Array:
        return np.geomspace(*LAGS, 11)

    @abstractmethod
    def response(self, value: float) -> Spectrum:
        """Response of the path (f,)."""

    def columns(self, values: Array) -> Array:
        responses = np.array([self.response(value) for value in values.tolist()])
        return self.data.column(self.data.spectra.derivatives[:3] * responses[:, None])


class Delay(Filter):
    """A torque that is late by a constant time, or early if it is negative."""

    name = "delay"

    def grid(self) -> Array:
        return np.linspace(*DELAYS, 26)

    def response(self, value: float) -> Spectrum:
        return np.asarray(np.exp(-value * self.data.spectra.s))


class LowPass(Filter):
    """A torque behind a low-pass of first order, or an angle, whose time constant is negative."""

    name = "low-pass"

    def grid(self) -> Array:
        of_torque = super().grid()
        return np.concatenate([-of_torque[::-1], of_torque])

    def response(self, value: float) -> Spectrum:
        low_pass = 1 / (1 + abs(value) * self.data.spectra.s)
        return low_pass if value > 0 else 1 / low_pass


class SeriesSpring(Path):
    """A spring between the angle's encoder and the joint.

    With Z = K + B s + I s^2 and the compliance c the torque is Z/(1 + c Z) theta, which is not
    linear in K, B and I: Gauss-Newton steps linearise it.
    """

    name = "spring in series"

    def grid(self) -> Array:
        return np.geomspace(*COMPLIANCES, 9)

    def left_on_grid(self, search: Search) -> Array:
        models = [self.model(value, search) for value in self.values_on_grid.tolist()]
        return np.array([search.fit(columns, torque)[0] for columns, torque in models])

    def model(self, value: float, search: Search) -> tuple[Array, Array]:
        spectra = self.data.spectra
        powers = spectra.s ** np.arange(3)[:, None]
        impedance = search.impedance
        columns = self.data.motion
        torque = self.data.torque
        for _ in range(4):
            of_joint = impedance @ powers
            gain = 1 / (1 + value * of_joint)
            columns = self.data.column(spectra.derivatives[:3] * gain**2)
            modelled = self.data.column(spectra.derivatives[0] * of_joint * gain)
            torque = self.data.torque - (modelled - impedance @ columns)
            impedance = search.fit(columns, torque)[1]
        return columns, torque
