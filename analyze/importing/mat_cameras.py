"""Camera's pose in every strike by the mat on the table, and whether the camera was moved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from analyze.calibration.mat_pose import CameraMove, MatPose, camera_move, mat_pose, read_mat, unposed_move
from analyze.calibration.mat_view import MatView, mean_view
from analyze.cameras.camera_file import CameraFile
from analyze.errors import CalibrationError
from analyze.geometry.rotations import angle_between, inverse_transform, nearest_rotation, transform
from analyze.importing.tip_view import TagView
from analyze.sources.source import FrameSource, TimedImage
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import Array, CameraModel
from schemas.wording import counted

REST_IMAGES = 4
"""most images before a tip from which the camera's pose is taken"""
SOURCE_IMAGES = 40
"""first images of a source that is taken whole, of which some are searched for a mat"""
BLIND_IMAGES = 2
"""images without a mat after which no more are searched for it"""
PLACED_TURN, PLACED_M = math.radians(0.5), 0.005
"""difference of a camera file's pose from the mat's that is remarked, rotation [rad] and place [m]"""


@dataclass
class MatWatch:
    """The mat in the images of one tip that pass by: while the object rests, and in the last image."""

    lens: CameraModel
    """lens of the camera"""
    rest_until_ns: int | None
    """time of the last image at rest [ns]; None if all images count as at rest"""
    ruler_mm: float | None
    """length of the mat's ruler as measured on the print [mm]; None for the nominal one"""
    rest: list[MatView] = field(default_factory=list[MatView])
    """views of the mat at rest"""
    blind: int = 0
    """number of images at rest without a mat"""
    last: TimedImage | None = None
    """last image after the rest"""

    def look(self, image: TimedImage) -> None:
        """Look at one image, in order of time."""
        if self.rest_until_ns is not None and image.time_ns > self.rest_until_ns:
            self.last = image
        elif len(self.rest) < REST_IMAGES and self.blind < BLIND_IMAGES:
            view = read_mat(image.image, self.lens)
            if view is None:
                self.blind += 1
            else:
                self.rest.append(view)

    def seen(self, name: str) -> SeenMat | None:
        """The camera's pose before the tip, and its move until the last image; None if no mat is seen.

        Args:
            name: name of the tip.
        """
        view = mean_view(self.rest)
        if view is None:
            return None
        after = None if self.last is None else read_mat(self.last.image, self.lens)
        pose, refusal = None, ""
        try:
            pose = mat_pose(view, self.lens, self.ruler_mm)
            move = (
                None
                if after is None
                else camera_move(pose, mat_pose(after, self.lens, self.ruler_mm), self.lens)
            )
        except CalibrationError as error:
            refusal = str(error)
            move = None if after is None else unposed_move(view, after)
        return SeenMat(name, view, pose, move, "" if pose is not None else refusal)


@dataclass(frozen=True)
class SeenMat:
    """The mat in one tip: the camera's pose before it, and its move during it."""

    name: str
    """name of the tip"""
    view: MatView
    """the mat's tags while the object rests"""
    pose: MatPose | None
    """pose of the camera while the object rests; None if the mat shows too little for one"""
    move: CameraMove | None
    """move of the camera until the last image; None if unknown"""
    refusal: str = ""
    """why there is no pose"""


@dataclass(frozen=True)
class MatCameras:
    """Camera's poses in W by the mat: that of most strikes, and each strike's own where it was moved."""

    T_world_camera: Array
    """(4, 4) pose in most strikes, mean over them [m]"""
    own: tuple[Array | None, ...]
    """(4, 4) pose of each tip, mean over tips between which the camera stood still; None if unknown"""
    turn_sd: float
    """largest standard deviation of the pose's rotation [rad]"""
    place_sd: float
    """largest standard deviation of the pose's place [m]"""
    paper: str
    """paper of the mat"""
    remarks: tuple[str, ...]
    """remarks for the user on a camera that was moved, and on tips without the mat"""

    @property
    def views(self) -> int:
        """Number of tips in which the mat shows the camera's pose."""
        return sum(pose is not None for pose in self.own)

    def placed(self, camera: CameraFile) -> CameraFile:
        """Camera file with the pose by the mat in place of its own."""
        pose = {"T_world_camera": self.T_world_camera.tolist()}
        return replace(camera, calibration=camera.calibration.model_copy(update=pose), placed=True)

    def as_from_one_place(self, tags: Sequence[Sequence[TagView]]) -> tuple[tuple[TagView, ...], ...]:
        """Views of tags as the camera of most strikes would have them, where the camera was moved.

        Args:
            tags: for each tip the views of its tags.
        """
        to_most = inverse_transform(self.T_world_camera)
        return tuple(
            tuple(views)
            if own is None
            else tuple(replace(view, T_camera_marker=to_most @ own @ view.T_camera_marker) for view in views)
            for views, own in zip(tags, self.own, strict=True)
        )


def mat_cameras(
    seen: Sequence[SeenMat | None], names: Sequence[str], camera: CameraFile, lens: CameraModel
) -> MatCameras | None:
    """Camera's pose in each tip by the mat; None if no tip shows a mat from which it follows.

    Args:
        seen: the mat in each tip; None where none is seen.
        names: names of the tips.
        camera: camera file, whose pose, if it has one, is compared.
        lens: lens of the camera.
    """
    poses = [None if each is None else each.pose for each in seen]
    if all(pose is None for pose in poses):
        return None
    groups: list[list[int]] = []
    moves: dict[int, CameraMove] = {}
    for number, pose in enumerate(poses):
        if pose is None:
            continue
        for group in groups:
            move = _move(poses[group[0]], pose, lens)
            if move is not None and not move.moved:
                group.append(number)
                break
            if group is groups[0] and move is not None:
                moves[number] = move
        else:
            groups.append([number])
    own: list[Array | None] = [None] * len(seen)
    for group in groups:
        mean = _mean([each.T_world_camera for number in group if (each := poses[number]) is not None])
        for number in group:
            own[number] = mean
    most = max(groups, key=len)
    unknown = dict(_without_pose(seen, most))
    for number, move in unknown.items():
        own[number] = None if move.moved else own[most[0]]
    known = [pose for pose in poses if pose is not None]
    T = own[most[0]]
    first = np.eye(4) if T is None else T
    remarks = (
        *_moved_during(seen),
        *_moved_between(groups, moves, names),
        *_unseen(seen, names),
        *_unposed(seen, unknown, names[most[0]]),
        *_other_than_file(camera, first),
    )
    return MatCameras(
        first,
        tuple(own),
        max(float(pose.turn_sd.max()) for pose in known),
        max(float(pose.position_sd.max()) for pose in known),
        known[0].view.mat.paper,
        remarks,
    )


def mat_cameras_of(
    sources: Sequence[FrameSource], camera: CameraFile, ruler_mm: float | None
) -> MatCameras | None:
    """Camera's pose by the mat in the first images of each source; None if none shows a mat.

    Args:
        sources: sources of images before one camera.
        camera: camera file.
        ruler_mm: length of the mat's ruler as measured on the print [mm]; None for the nominal one.
    """
    lens = camera_from_spec(camera.calibration)
    seen: list[SeenMat | None] = []
    for source in sources:
        watch = MatWatch(lens, None, ruler_mm)
        for image in islice(source.frames(), 0, SOURCE_IMAGES, SOURCE_IMAGES // REST_IMAGES):
            watch.look(image)
        seen.append(watch.seen(source.name))
    return mat_cameras(seen, [source.name for source in sources], camera, lens)


def _move(before: MatPose | None, after: MatPose, lens: CameraModel) -> CameraMove | None:
    """Difference of two poses; None if one is unknown, or they share too few tags."""
    return None if before is None else camera_move(before, after, lens)


def _mean(poses: Sequence[Array]) -> Array:
    """Mean (4, 4) of poses of a camera that stood still."""
    every = np.array(poses)
    return transform(nearest_rotation(every[:, :3, :3].mean(axis=0)), every[:, :3, 3].mean(axis=0))


def _words(move: CameraMove) -> str:
    """Words for a move: "4.2 mm and 0.31 deg", or "3.1 px" if a pose is unknown."""
    if math.isnan(move.turn):
        return f"{move.pixels:.1f} px"
    return f"{1000 * move.distance:.1f} mm and {math.degrees(move.turn):.2f} deg"


def _moved_during(seen: Sequence[SeenMat | None]) -> Iterator[str]:
    """Yield a remark for each tip during which the camera was moved."""
    for each in seen:
        if each is not None and each.move is not None and each.move.moved:
            yield (
                f"{each.name}: the camera was moved by {_words(each.move)} during the strike, by the mat: "
                "put it on a stand that the strike does not shake, and film this strike again"
            )


def _moved_between(
    groups: Sequence[Sequence[int]], moves: dict[int, CameraMove], names: Sequence[str]
) -> Iterator[str]:
    """Yield a remark for each group of tips before which the camera stood otherwise than in the first."""
    for group in groups[1:]:
        move = moves.get(group[0])
        by = "" if move is None else f", by {_words(move)}"
        yield (
            f"{', '.join(names[number] for number in group)}: the camera stood otherwise than in "
            f"{names[groups[0][0]]}{by}: its own pose by the mat is used"
        )


def _unseen(seen: Sequence[SeenMat | None], names: Sequence[str]) -> Iterator[str]:
    """Yield a remark on tips that do not show the camera's pose by the mat, while others do."""
    without = [name for each, name in zip(seen, names, strict=True) if each is None]
    if without:
        others = counted(len(seen) - len(without), "strike")
        yield (
            f"{', '.join(without)}: no mat is seen: the camera is taken to stand as in the other {others}: "
            "leave the mat where it is"
        )


def _without_pose(seen: Sequence[SeenMat | None], most: Sequence[int]) -> Iterator[tuple[int, CameraMove]]:
    """Yield each tip whose mat shows no pose, with the tags' shift against most strikes, if any is shared."""
    first = seen[most[0]]
    for number, each in enumerate(seen):
        if each is not None and each.pose is None and first is not None:
            move = unposed_move(first.view, each.view)
            if move is not None:
                yield number, move


def _unposed(seen: Sequence[SeenMat | None], moves: dict[int, CameraMove], other: str) -> Iterator[str]:
    """Yield a remark on each tip whose mat shows too little for a pose.

    Args:
        seen: the mat in each tip.
        moves: the tags' shift against most strikes, by the tip's number, where it is known.
        other: name of one of these strikes.
    """
    for number, each in enumerate(seen):
        if each is None or each.pose is not None:
            continue
        move = moves.get(number)
        if move is not None and move.moved:
            yield (
                f"{each.name}: the camera stood otherwise than in {other}, by {_words(move)}, and its pose "
                f"is not known: leave this strike out, or film it again: {each.refusal}"
            )
        else:
            yield f"{each.name}: the camera is taken to stand as in {other}: {each.refusal}"


def _other_than_file(camera: CameraFile, T_world_camera: Array) -> Iterator[str]:
    """Yield a remark if the camera file states another pose than the mat shows."""
    if not camera.placed:
        return
    stated = np.array(camera.calibration.T_world_camera)
    turn = float(angle_between(stated[:3, :3], T_world_camera[:3, :3]))
    distance = float(np.linalg.norm(stated[:3, 3] - T_world_camera[:3, 3]))
    if turn > PLACED_TURN or distance > PLACED_M:
        yield (
            f"the mat shows the camera {1000 * distance:.0f} mm and {math.degrees(turn):.1f} deg from its "
            f"place in {camera.path} (T_world_camera): the mat's is used"
        )
