"""Motion elements and coordinate systems of an MTConnect device: who carries whom, and where they stand."""

from __future__ import annotations

import math

import numpy as np

from symfive.arrays import Array
from symfive.files import shown
from symfive.importers._xml import Element, vector

MAX_CHAIN = 50


class Motions:
    """The kinematics that a device's configuration tells, in its `frame`: the coordinate system of type MACHINE, or else that
    of its first Motion. What the document leaves open is None."""

    def __init__(self, device: Element) -> None:
        self.systems = {e.get("id"): e for e in device.inside("CoordinateSystem")}
        self.motions = {e.get("id"): e for e in device.inside("Motion")}
        used = [e.get("coordinateSystemIdRef") for e in self.motions.values()]
        machine = [name for name in used if name in self.systems and self.systems[name].get("type") == "MACHINE"]
        self.frame = next(iter((*machine, *used)), "")

    def lineage(self, motion: Element) -> list[Element]:
        """The motion, its parent, and so on to the first on the bed. Raises `InputError` for a parent that is not there."""
        return _lineage(motion, self.motions)

    def axis(self, motion: Element) -> Array | None:
        """The direction in which, or about which, the component itself moves, (3,)."""
        stated, system = vector(motion, "Axis"), self._system(motion)
        return None if stated is None or system is None else np.asarray(system[:3, :3] @ stated)

    def origin(self, motion: Element) -> Array | None:
        """A point on the axis with all axes at zero, (3,) mm."""
        place = self._place(motion)
        return None if place is None else np.asarray(place[:3, 3])

    def turned(self, motion: Element) -> bool:
        """Whether transformations turn the motion against its coordinate system: the standard leaves open whether its Axis is
        meant before or after."""
        place, system = self._place(motion), self._system(motion)
        return place is not None and system is not None and not np.allclose(place[:3, :3], system[:3, :3], atol=1e-9)

    def _system(self, motion: Element) -> Array | None:
        """The coordinate system of a motion in the frame, 4×4."""
        name = motion.get("coordinateSystemIdRef")
        if name == self.frame:
            return np.eye(4)
        for key in (self.frame, name):
            if key not in self.systems:
                raise motion.error(f"there is no coordinate system {shown(key)}", "correct coordinateSystemIdRef")
        frame, other = (self._from_root(key) for key in (self.frame, name))
        return None if frame is None or other is None else np.asarray(np.linalg.solve(frame, other))

    def _from_root(self, name: str) -> Array | None:
        pose: Array = np.eye(4)
        for link in _lineage(self.systems[name], self.systems):
            own = _own(link) if link.children else np.eye(4)
            if own is None:
                return None
            pose = own @ pose
        return pose

    def _place(self, motion: Element) -> Array | None:
        """Where the motion's own frame stands with all axes at zero, 4×4: an Origin counts from the coordinate system, a
        Transformation from the parent."""
        pose: Array = np.eye(4)
        for link in self.lineage(motion):
            own = _own(link)
            if own is None:
                return None
            pose = own @ pose
            if not link.get("parentIdRef") or vector(link, "Origin") is not None:
                system = self._system(link)
                return None if system is None else system @ pose
        return None


def _lineage(element: Element, table: dict[str, Element]) -> list[Element]:
    found = [element]
    while parent := found[-1].get("parentIdRef"):
        if parent not in table:
            raise found[-1].error(f"parentIdRef {shown(parent)} names no {element.tag} of the device", "correct it")
        if len(found) >= MAX_CHAIN:
            problem = f"the parents of {element.tag} {shown(element.get('id'))} never end"
            raise element.error(problem, "correct parentIdRef")
        found.append(table[parent])
    return found


def _own(element: Element) -> Array | None:
    """Origin or Transformation of an element, 4×4; None without them, and where it turns about several axes at once: the
    standard leaves open in which order."""
    pose: Array = np.eye(4)
    origin, transformation = vector(element, "Origin"), next(element.at("Transformation"), None)
    if transformation is None:
        if origin is None:
            return None
        pose[:3, 3] = origin
        return pose
    translation, rotation = vector(transformation, "Translation"), vector(transformation, "Rotation", "ABC")
    if translation is not None:
        pose[:3, 3] = translation
    if rotation is not None and rotation.any():
        if np.count_nonzero(rotation) > 1:
            return None
        i = int(np.flatnonzero(rotation)[0])
        j, k = (i + 1) % 3, (i + 2) % 3
        angle = math.radians(float(rotation[i]))
        pose[[j, k], [j, k]] = math.cos(angle)
        pose[k, j], pose[j, k] = math.sin(angle), -math.sin(angle)
    return pose
