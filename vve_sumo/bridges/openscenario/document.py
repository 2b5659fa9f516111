"""An OpenSCENARIO file with its catalogs: elements in which references to catalogs are resolved.

Reads files; knows no roads and no actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element, read_xml
from vve_sumo.errors import ConfigError

ROOT: Final = "OpenSCENARIO"
#: elements that an entry of a catalog may be
ENTRIES: Final = frozenset(
    ("Vehicle", "Pedestrian", "MiscObject", "Controller", "Environment", "Maneuver", "Trajectory", "Route")
)


class Entry(NamedTuple):
    """An element, with the parameters that are known in it."""

    element: Element
    scope: Scope


class Document:
    """One scenario file with what it refers to."""

    def __init__(self, file: Path, given: Mapping[str, str]) -> None:
        """Read a file, with values for some of its parameters.

        Raises ConfigError for what is no OpenSCENARIO XML 1.x and for a parameter that the file does not declare.
        """
        self.file, self.root = file, read_openscenario(file)
        declarations = self.root.child("ParameterDeclarations")
        names = [one.attributes.get("name", "") for one in declarations.children] if declarations else []
        unknown = next((name for name in given if name not in names), None)
        if unknown is not None:
            known = ", ".join(names) or "none"
            raise ConfigError(f"{file}: parameter {unknown!r} is not declared, expected {known}")
        try:
            self.scope = Scope().declared(declarations, given)
        except NotTakenError as error:
            raise ConfigError(str(error)) from None
        self.numbers = _numbers(self.scope, names)
        self._catalogs: dict[str, list[Element]] | None = None

    def resolved(self, holder: Element, scope: Scope, *tags: str) -> Entry:
        """Return the element with one of the names that a holder holds, or refers to in a catalog.

        Raises NotTakenError where it is neither there nor in a catalog.
        """
        direct = next((one for one in holder.children if one.tag in tags), None)
        if direct is not None:
            return Entry(direct, scope.declared(direct.child("ParameterDeclarations")))
        reference = holder.child("CatalogReference")
        if reference is None:
            raise NotTakenError(holder, f"expected {' or '.join(tags)} or a CatalogReference")
        return self.entry(reference, scope, *tags)

    def entry(self, reference: Element, scope: Scope, *tags: str) -> Entry:
        """Return the entry of a catalog that a CatalogReference names; raises NotTakenError where there is none."""
        catalog, name = scope.text(reference, "catalogName"), scope.text(reference, "entryName")
        for one in self._known(reference).get(catalog, []):
            if one.tag in tags and one.attributes.get("name") == name:
                assigned = reference.child("ParameterAssignments")
                given = {
                    pair.attributes.get("parameterRef", "").removeprefix("$"): scope.text(pair, "value")
                    for pair in ([] if assigned is None else assigned.children)
                }
                return Entry(one, scope.declared(one.child("ParameterDeclarations"), given))
        raise NotTakenError(reference, f"no entry {name!r} in a catalog {catalog!r}")

    def _known(self, reference: Element) -> dict[str, list[Element]]:
        if self._catalogs is None:
            self._catalogs = {}
            locations = self.root.child("CatalogLocations")
            for location in [] if locations is None else locations.children:
                directory = location.child("Directory")
                folder = self.file.parent / self.scope.text(directory or location, "path")
                for file in sorted(folder.glob("*.xosc")) if folder.is_dir() else []:
                    catalog = read_openscenario(file).child("Catalog")
                    if catalog is not None:
                        entries = [one for one in catalog.children if one.tag in ENTRIES]
                        self._catalogs.setdefault(catalog.attributes.get("name", ""), []).extend(entries)
        return self._catalogs


def _numbers(scope: Scope, names: list[str]) -> dict[str, float]:
    """Return the parameters that are numbers."""
    found = {}
    for name in names:
        try:
            found[name] = float(scope.values[name])
        except ValueError:
            continue
    return found


def read_openscenario(file: Path) -> Element:
    """Return the root of an OpenSCENARIO XML file of version 1.x; raises ConfigError for any other."""
    root = read_xml(file, "OpenSCENARIO XML")
    if root.tag != ROOT:
        raise ConfigError(f"{root.where}: expected the root <{ROOT}>")
    header = root.child("FileHeader")
    major = "" if header is None else header.attributes.get("revMajor", "")
    if major != "1":
        raise ConfigError(f"{(header or root).where}: expected revMajor 1, got {major or 'none'!r}")
    return root
