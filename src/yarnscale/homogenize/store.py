"""Samples on disk: a zarr store in which every finished state is written whole, at once, and for good.

Each state is one chunk of every array; its ``status`` chunk is written last. A run that is killed at any moment leaves
a store that opens, and whose finished states all count. Chunks are written uncompressed, by rename.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import NDArray

from yarnscale.arrays import Array
from yarnscale.errors import InputError, system_errors
from yarnscale.homogenize.worker import STATUS_CODES, STRAINS
from yarnscale.kinematics import COMPONENTS

if TYPE_CHECKING:
    import xarray

_FORMAT = {"format": "yarnscale-samples", "version": 1}
RAY_DIMS = ("ray", "level", "iterate")
"""State dimensions of a store of rays of loads (``homogenize.rays``): strains are found, not given."""


@dataclass(frozen=True)
class _Field:
    dtype: str
    fill: float | int
    units: str
    about: str
    dims: tuple[str, ...] = ()


_NAN = float("nan")
_FIELDS = {
    "energy_density": _Field("<f8", _NAN, "J/m^2", "energy per reference area"),
    "iterations": _Field("<i4", 0, "1", "Newton iterations"),
    "seconds": _Field("<f8", _NAN, "s", "wall time of the solve"),
    "residual": _Field("<f8", _NAN, "1", "force norm over the summed norms of the energy terms"),
    "min_distance_over_diameter": _Field("<f8", _NAN, "1", "closest approach of two yarns"),
    "stress": _Field("<f8", _NAN, "J/m^2, J/m", "derivative of energy_density by s_x, s_a, s_y [J/m^2], II11, II12, "
                     "II22 [J/m]", ("component",)),
    "strain": _Field("<f8", _NAN, "1, 1/m", "s_x, s_a, s_y, II11 [1/m], II12 [1/m], II22 [1/m]", ("component",)),
    "moduli": _Field("<f8", _NAN, "J/m^2, J/m, J", "second derivative of energy_density by the components of stress, "
                     "NaN where the cell has none", ("component", "component_2")),
    "fluctuation": _Field("<f8", _NAN, "m", "co-rotated fluctuation of the primary tile's vertices",
                          ("vertex", "axis")),
    "twist": _Field("<f8", _NAN, "rad", "twist of every edge", ("vertex",)),
    "positions": _Field("<f8", _NAN, "m", "positions of the primary tile's vertices", ("vertex", "axis")),
    "status": _Field("|i1", 0, "1", ", ".join(f"{code} {name}" for code, name in STATUS_CODES.items())),
}  # fmt: skip
"""What is stored of a state, the last to be written last; not every store has strain, moduli and positions."""


def _fields(
    vertices: int, positions: bool, moduli: bool, strains: bool = False
) -> dict[str, tuple[_Field, tuple[int, ...]]]:
    """The fields of a store, and their shapes."""
    kept = {"positions": positions, "moduli": moduli, "strain": strains}
    sizes = {"component": 6, "component_2": 6, "vertex": vertices, "axis": 3}
    return {
        name: (entry, tuple(sizes[axis] for axis in entry.dims))
        for name, entry in _FIELDS.items()
        if kept.get(name, True)
    }


class SampleStore:
    """States of a sampling run and their results, on disk.

    ``shape``: sizes of the state dimensions: a grid of strains, one dimension ``state``, or rays of loads
    (``RAY_DIMS``). ``states``: (N, 5) strains in the order of ``STRAINS``, row-major over ``shape``; of rays, whose
    strains are found, NaN. ``rays``: their plain descriptions.
    """

    def __init__(self, path: str | Path) -> None:
        """Open an existing store; InputError where there is none or it has other contents."""
        self.path = path = Path(path)
        try:
            group = zarr.open_group(str(path), mode="r")
        except Exception as error:
            raise InputError(
                "no sample store", where=path, expected="a folder written by 'sample'", found=error
            ) from None
        self.attributes: dict[str, Any] = dict(group.attrs)
        if self.attributes.get("format") != _FORMAT["format"]:
            raise InputError("not a sample store", where=path, expected=_FORMAT, found=self.attributes.get("format"))
        if self.attributes.get("version") != _FORMAT["version"]:
            found = self.attributes.get("version")
            raise InputError("sample store of another version", where=path, expected=_FORMAT["version"], found=found)
        try:
            self._describe(group)
        except (KeyError, TypeError, ValueError, OSError) as error:
            raise InputError("damaged sample store", where=path, expected=_FORMAT, found=repr(error)) from None

    def _describe(self, group: zarr.Group) -> None:
        """Learn dimensions, states and fields from the metadata."""
        self.dims: tuple[str, ...] = tuple(self.attributes["state_dimensions"])
        self.attributes["provenance"]["area_density"]
        self.shape: tuple[int, ...] = tuple(group["status"].shape)  # type: ignore[union-attr]
        self.rays: list[dict[str, Any]] = list(self.attributes.get("rays", []))
        if self.dims == RAY_DIMS:
            self.states = np.full((math.prod(self.shape), len(STRAINS)), np.nan)
        else:
            axes = {name: np.asarray(group[name][...]) for name in STRAINS}  # type: ignore[index]
            self.states = states_of(self.dims, axes)
        self.has_positions = "positions" in group
        self.has_moduli = "moduli" in group
        self._fields = _fields(
            int(self.attributes["vertices"]), self.has_positions, self.has_moduli, self.dims == RAY_DIMS
        )

    @classmethod
    def create(
        cls,
        path: Path,
        axes: Mapping[str, Array],
        *,
        scattered: bool,
        vertices: int,
        positions: bool = False,
        moduli: bool = False,
        provenance: Mapping[str, object],
    ) -> SampleStore:
        """A new store for a grid (five axes) or for scattered states (five columns of equal length)."""
        dims = ("state",) if scattered else STRAINS
        shape = (len(axes["s_x"]),) if scattered else tuple(len(axes[name]) for name in STRAINS)
        return cls._created(
            path, _Layout(dims, shape, _fields(vertices, positions, moduli), vertices, provenance, axes)
        )

    @classmethod
    def create_rays(
        cls, path: Path, rays: Sequence[Mapping[str, object]], *, iterates: int, vertices: int,
        provenance: Mapping[str, object],
    ) -> SampleStore:  # fmt: skip
        """A new store for rays of loads (plain descriptions), with room for ``iterates`` states on each level."""
        shape = len(rays), max(len(ray["levels"]) for ray in rays), iterates  # type: ignore[arg-type]
        fields = _fields(vertices, positions=False, moduli=True, strains=True)
        return cls._created(path, _Layout(RAY_DIMS, shape, fields, vertices, provenance, rays=rays))

    @classmethod
    def _created(cls, path: Path, layout: _Layout) -> SampleStore:
        with _building(path) as building:
            if path.exists() and (not path.is_dir() or any(path.iterdir())):
                expected = "a new folder, --overwrite or --resume"
                raise InputError("output exists", where=path, expected=expected, found="files in it")
            path.parent.mkdir(parents=True, exist_ok=True)
            _write_empty(building, layout)
            if path.exists():
                path.rmdir()
            os.replace(building, path)
        return cls(path)

    def extended(self, rays: Sequence[Mapping[str, object]]) -> SampleStore:
        """This store with further rays (plain descriptions), not yet computed; finished states stay.

        Killed at any moment, it leaves the store as it was or extended (``recover``). Raises InputError for
        a store without rays, or a folder that cannot be written.
        """
        if self.dims != RAY_DIMS:
            raise InputError("rays cannot be added", where=self.path, expected="a store of rays of loads")
        everything = [*self.rays, *rays]
        shape = (len(everything), *self.shape[1:])
        vertices, provenance = int(self.attributes["vertices"]), self.attributes["provenance"]
        with _building(self.path) as building:
            _write_empty(building, _Layout(self.dims, shape, self._fields, vertices, provenance, rays=everything))
            for name in self._fields:
                if (self.path / name / "c").is_dir():
                    _link_tree(self.path / name / "c", building / name / "c")
            os.replace(self.path, _beside(self.path, "before"))
            os.replace(building, self.path)
            shutil.rmtree(_beside(self.path, "before"), ignore_errors=True)
        return SampleStore(self.path)

    @staticmethod
    def recover(path: Path) -> None:
        """Put back what a run that was killed in ``extended`` left beside ``path``; nothing where there is nothing."""
        before = _beside(path, "before")
        if before.is_dir() and not path.exists():
            os.replace(before, path)
        shutil.rmtree(before, ignore_errors=True)

    @property
    def count(self) -> int:
        return len(self.states)

    def _chunk(self, name: str, index: int, extra: int) -> Path:
        place = np.unravel_index(index, self.shape)
        parts = [str(int(i)) for i in place] + ["0"] * extra
        return self.path.joinpath(name, "c", *parts)

    def status(self) -> NDArray[np.int8]:
        """Status code of every state, (N,)."""
        codes = np.zeros(self.count, np.int8)
        for index in range(self.count):
            try:
                codes[index] = np.frombuffer(self._chunk("status", index, 0).read_bytes(), np.int8)[0]
            except (OSError, IndexError):
                continue
        return codes

    def write(self, index: int, result: Mapping[str, object]) -> None:
        """Store one finished state; ``status`` goes last, so that a state is there whole or not at all."""
        for name, (_, shape) in self._fields.items():
            array = np.asarray(result[name])
            if array.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, found {array.shape}")
            self._write(index, name, array)

    def _write(self, index: int, name: str, array: NDArray) -> None:
        entry, shape = self._fields[name]
        target = self._chunk(name, index, len(shape))
        target.parent.mkdir(parents=True, exist_ok=True)
        building = target.with_name(f"{target.name}.{os.getpid()}.building")
        building.write_bytes(np.asarray(array, np.dtype(entry.dtype), order="C").tobytes())
        os.replace(building, target)

    def write_empty(self, index: int, status: int) -> None:
        """Give a state a status and no values: it bends about both axes, or its ray does not need or reach it."""
        self._write(index, "status", np.array(status))

    def discard_unfinished(self) -> None:
        """Remove what a killed run was writing; nothing of it counts."""
        for name in self._fields:
            for leftover in (self.path / name).rglob("*.building"):
                leftover.unlink(missing_ok=True)

    def read(self, index: int, name: str) -> NDArray:
        """One array of one finished state; its fill value where the state has a status and no values."""
        entry, shape = self._fields[name]
        try:
            raw = self._chunk(name, index, len(shape)).read_bytes()
        except FileNotFoundError:
            return np.full(shape, entry.fill, np.dtype(entry.dtype))
        try:
            return np.frombuffer(raw, np.dtype(entry.dtype)).reshape(shape)
        except ValueError:
            where, found = self._chunk(name, index, len(shape)), f"{len(raw)} bytes"
            raise InputError("damaged sample store", where=where, expected=f"shape {shape}", found=found) from None

    def dataset(self) -> xarray.Dataset:
        """Everything as an ``xarray.Dataset``, loaded."""
        import xarray

        with xarray.open_zarr(str(self.path), consolidated=True) as opened:
            return opened.load()


@contextmanager
def _building(path: Path) -> Iterator[Path]:
    """Where a store is built that is to be at ``path``, removed on any error. InputError where it cannot be written."""
    building = _beside(path, "building")
    try:
        with system_errors(path, "cannot write the store"):
            shutil.rmtree(building, ignore_errors=True)
            yield building
    finally:
        shutil.rmtree(building, ignore_errors=True)


def _beside(path: Path, word: str) -> Path:
    return path.with_name(f".{path.name}.{word}")


def _link_tree(source: Path, target: Path) -> None:
    """The files of a folder in another one, linked where the file system can, else copied."""

    def link(file: str, place: str) -> None:
        try:
            os.link(file, place)
        except OSError:
            shutil.copy2(file, place)

    ignored = shutil.ignore_patterns("*.building")
    shutil.copytree(source, target, copy_function=link, ignore=ignored, dirs_exist_ok=True)


def states_of(dims: tuple[str, ...], axes: Mapping[str, Array]) -> Array:
    """Strains (N, 5) of a grid with five axes, or of scattered states with five columns."""
    columns = [axes[name] for name in STRAINS]
    if dims == ("state",):
        return np.column_stack(columns)
    return np.stack(np.meshgrid(*columns, indexing="ij"), -1).reshape(-1, len(STRAINS))


class _Layout(NamedTuple):
    """What a new store has: state dimensions and their sizes, fields with their shapes, and attributes."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    fields: Mapping[str, tuple[_Field, tuple[int, ...]]]
    vertices: int
    provenance: Mapping[str, object]
    axes: Mapping[str, Array] = MappingProxyType({})
    rays: Sequence[Mapping[str, object]] = ()


def _write_empty(path: Path, layout: _Layout) -> None:
    dims, shape, fields, vertices, provenance, axes, rays = layout
    group = zarr.create_group(str(path), overwrite=False)
    attributes = {**_FORMAT, "state_dimensions": list(dims), "vertices": vertices, "provenance": provenance}
    group.attrs.update(json.loads(json.dumps(attributes | ({"rays": rays} if rays else {}))))
    for name, column in axes.items():
        values = np.asarray(column, dtype=np.float64)
        own = dims if dims == ("state",) else (name,)
        array = group.create_array(name, data=values, dimension_names=own)
        array.attrs["units"] = "1/m" if name.startswith("lambda") else "1"
    for name, (entry, inner) in fields.items():
        array = group.create_array(
            name,
            shape=shape + inner,
            chunks=(1,) * len(shape) + inner,
            dtype=entry.dtype,
            fill_value=entry.fill,
            compressors=None,
            dimension_names=dims + entry.dims,
        )
        array.attrs.update({"units": entry.units, "long_name": entry.about})
        if name in ("stress", "strain"):
            array.attrs["components"] = list(COMPONENTS)
        if name == "status":
            codes = list(STATUS_CODES)
            array.attrs.update({"flag_values": codes, "flag_meanings": " ".join(STATUS_CODES[c] for c in codes)})
    if dims == ("state",):
        group.attrs["coordinates"] = " ".join(STRAINS)
    with warnings.catch_warnings():
        # Readers look for consolidated metadata first; that format 3 has not standardised it is no news to them.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(str(path))
