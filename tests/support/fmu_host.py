"""A host of functional mock-up units in Python: a unit in its library, called as tools do."""

from __future__ import annotations

import ctypes as ct
import io
import zipfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

OK, ERROR = 0, 3
Array = npt.NDArray[np.float64]


class Callbacks(ct.Structure):
    _fields_ = [
        ("logger", ct.c_void_p), ("allocate", ct.c_void_p), ("free", ct.c_void_p),
        ("finished", ct.c_void_p), ("environment", ct.c_void_p),
    ]  # fmt: skip


LOGGER = ct.CFUNCTYPE(None, ct.c_void_p, ct.c_char_p, ct.c_int, ct.c_char_p, ct.c_char_p)


class Host:
    """A unit in its library, called as a simulation tool does."""

    def __init__(self, folder: Path, content: bytes, guid: str | None = None) -> None:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            archive.extractall(folder)
        self.xml = ET.parse(folder / "modelDescription.xml").getroot()
        (library,) = (folder / "binaries" / "linux64").iterdir()
        self.library = ct.CDLL(str(library))
        self.library.fmi2Instantiate.restype = ct.c_void_p
        self.said: list[str] = []
        self._logger = LOGGER(lambda _e, _n, _s, _c, text: self.said.append(text.decode()))
        self.callbacks = Callbacks(ct.cast(self._logger, ct.c_void_p))
        self.guid = guid or self.xml.get("guid", "")
        variables = self.xml.findall("ModelVariables/ScalarVariable")
        self.reference = {v.get("name"): int(v.get("valueReference", "")) for v in variables}
        self.booleans = {v.get("name") for v in variables if v.find("Boolean") is not None}
        self.variables = {v.get("name"): v for v in variables}

    def instance(self, kind: int = 1) -> int | None:
        found: int | None = self.library.fmi2Instantiate(
            b"unit", kind, self.guid.encode(), None, ct.byref(self.callbacks), 0, 0
        )
        return found

    def running(self, **settings: float) -> Unit:
        unit = Unit(self)
        assert all(unit.set(k.replace("__", "."), v) == OK for k, v in settings.items())
        unit.start()
        return unit


class Unit:
    """One instance."""

    def __init__(self, host: Host) -> None:
        self.host, self.time = host, 0.0
        found = host.instance()
        assert found
        self.component = ct.c_void_p(found)

    def call(self, name: str, *arguments: Any) -> int:
        status: int = getattr(self.host.library, f"fmi2{name}")(self.component, *arguments)
        return status

    def start(self) -> None:
        assert self.call("SetupExperiment", 0, ct.c_double(), ct.c_double(), 0, ct.c_double()) == OK
        assert self.call("EnterInitializationMode") == OK
        assert self.call("ExitInitializationMode") == OK

    def set(self, name: str, value: float) -> int:
        which = ct.c_uint(self.host.reference[name])
        return self.call("SetReal", ct.byref(which), ct.c_size_t(1), ct.byref(ct.c_double(value)))

    def get(self, name: str) -> float:
        which, one = ct.c_uint(self.host.reference[name]), ct.c_size_t(1)
        value: Any = ct.c_int() if name in self.host.booleans else ct.c_double()
        kind = "Boolean" if name in self.host.booleans else "Real"
        assert self.call(f"Get{kind}", ct.byref(which), one, ct.byref(value)) == OK
        return float(value.value)

    def step(self, span: float) -> int:
        status = self.call("DoStep", ct.c_double(self.time), ct.c_double(span), 1)
        self.time += span if status == OK else 0.0
        return status

    def follow(self, name: str, values: Array, spans: Array, output: str) -> Array:
        """Output at every communication point, inputs held over the spans."""
        found = [self.get(output)]
        for value, span in zip(values.tolist(), spans.tolist()):
            assert self.set(name, value) == OK
            assert self.step(span) == OK
            found.append(self.get(output))
        return np.array(found)
