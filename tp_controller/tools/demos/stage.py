# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scene of a recorded motion: robot, goals, regions, objects and paths."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from tp_controller.model.shapes import HalfSpace
from tp_controller.model.spatial import Array, pose
from tp_controller.tasks.aim import pose_along
from tp_controller.tasks.primitives import COLOURS, Primitive, primitives
from tp_controller.tasks.sketch import Arrow, Body, Cone, Sketch
from tp_controller.tasks.sketch import Path as Polyline
from tp_controller.tools.demos.motion import FixedObject, Motion, Playback
from tp_controller.tools.view.camera import Camera, camera_for, FILM_FOV
from tp_controller.tools.view.markers import ADD, MarkerScene
from tp_controller.tools.view.parts import (
    add_part,
    Colour,
    corners,
    outer_points,
    Part,
    place,
)
from tp_controller.tools.view.scene import add_ground, RobotScene, Trail
from tp_controller.tools.view.visuals import visuals_of
import viser

CARRIED_COLOUR: Colour = (204, 121, 167)
BAR_RADIUS = 0.018
# Colours of parts that differ from those of markers: obstacles are solid.
CARRIED = 'carried'
FILM_COLOURS = {
    **COLOURS, 'allowed': (0.0, 0.62, 0.45, 0.18), 'forbidden': (0.69, 0.48, 0.26, 1.0),
    'cone': (0.34, 0.71, 0.91, 0.18), CARRIED: (0.8, 0.475, 0.655, 1.0)}
# Size of goals per size of the scene, as a factor on that of markers, and largest length of a cone
# as a share of it.
GOAL_SCALE, LONGEST_CONE = 0.9, 0.14
# Corners of a cube of side 1.
CORNERS = 0.5 * np.array(list(product((-1.0, 1.0), repeat=3)))


class Stage:
    """
    Motion in a scene.

    Parameters
    ----------
    scene : viser.SceneApi
    motion : Motion
    camera : Camera
        Viewer, whose distance defines the size of goals.
    height : int
        Height of the picture [pixels].

    """

    def __init__(self, scene: viser.SceneApi, motion: Motion, camera: Camera,
                 height: int) -> None:
        self._motion, self._playback = motion, Playback(motion)
        self._robot = RobotScene(scene, motion.robot)
        self._robot.show(motion.q[0])
        look = motion.look
        add_ground(scene, self._robot.ground() if look.ground is None else look.ground)
        self._size = look.enlarged * camera.distance
        self._sketches = MarkerScene(scene, pixels=height / (
            2.0 * np.tan(0.5 * FILM_FOV) * camera.distance))
        self._trails = [Trail(scene, f'/trail/{frame}') for frame in look.frames]
        self._objects = [(_add_object(scene, f'/objects/{number}', each), each.frame)
                         for number, each in enumerate(look.objects)]
        self._bars = [add_part(scene, f'/bar/{number}', _bar(ends))
                      for number, ends in enumerate(self._playback.bars())]
        self._next = 0

    def restart(self, motion: Motion) -> None:
        """Start again without a path, with another motion of the same robot and look."""
        self._motion, self._playback, self._next = motion, Playback(motion), 0
        for trail in self._trails:
            trail.clear()

    def show(self, sample: int) -> None:
        """Show a sample, and the path up to it."""
        if sample < self._next - 1:
            self.restart(self._motion)
        for each in range(self._next, sample + 1):
            self._playback.seek(each)
            for trail, frame in zip(self._trails, self._motion.look.frames):
                trail.add(self._playback.state.position(frame))
        self._next = sample + 1
        state = self._playback.state
        self._robot.show(self._motion.q[sample])
        self._sketches.show({
            (f'{task}/{sketch.part}', number): primitive
            for task, parts in self._playback.sketches().items() for sketch in parts
            for number, primitive in enumerate(_drawn(sketch, self._size))})
        for handle, frame in self._objects:
            place(handle, state.pose(frame))
        for bar, ends in zip(self._bars, self._playback.bars()):
            place(bar, _bar(ends).T)


def _add_object(scene: viser.SceneApi, name: str, each: FixedObject) -> viser.SceneNodeHandle:
    """Add an object, and return the node that follows its frame."""
    handle = scene.add_frame(name, show_axes=False)
    for primitive in _solid(each):
        place(ADD[primitive.kind](scene, f'{name}/shape', primitive), primitive.T)
    return handle


def _solid(each: FixedObject) -> list[Primitive]:
    """Return the primitives of an object in its frame; none for a half-space."""
    return _drawn(Body(CARRIED, pose(np.eye(3), each.at), each.shape))


def _drawn(sketch: Sketch, size: float = 1.0) -> list[Primitive]:
    """
    Return the primitives of a sketch; none for a half-space, which is infinite.

    An arrow is a line: the first picture after an arrow is added does not show it yet.
    """
    if isinstance(sketch, Body) and isinstance(sketch.shape, HalfSpace):
        return []
    if isinstance(sketch, Cone):
        sketch = replace(sketch, length=min(sketch.length, LONGEST_CONE * size))
    if isinstance(sketch, Arrow):
        sketch = Polyline(sketch.part, np.stack((sketch.start, sketch.end)))
    return primitives(sketch, GOAL_SCALE * size, FILM_COLOURS)


def extent(sketch: Sketch, size: float) -> Array:
    """
    Return points (k, 3) that enclose a goal, a cone or a shape; empty for lines [m].

    Parameters
    ----------
    sketch : Sketch
        Sketch of a task.
    size : float
        Size of the scene, to which the size of goals is proportional [m].

    """
    return _outline([] if isinstance(sketch, (Arrow, Polyline)) else _drawn(sketch, size))


def _outline(solids: Sequence[Primitive]) -> Array:
    """Return points (k, 3) whose convex hull contains primitives [m]."""
    found = [np.empty((0, 3))]
    for each in solids:
        points = each.points if len(each.points) else CORNERS * each.size
        found.append(each.T[:3, 3] + points @ each.T[:3, :3].T)
    return np.concatenate(found)


def _bar(ends: Array) -> Part:
    """Return a bar between two points (2, 3)."""
    difference = ends[1] - ends[0]
    length = float(np.linalg.norm(difference))
    T = pose_along(difference / length, ends.mean(axis=0))
    return Part('cylinder', (BAR_RADIUS, length), T, CARRIED_COLOUR)


def camera_of(motion: Motion, samples: Sequence[int], aspect: float) -> Camera:
    """
    Return a camera with all content in view; the size of goals grows with its distance.

    Parameters
    ----------
    motion : Motion
        Motion to show.
    samples : sequence of int
        Samples that are shown, in order of time.
    aspect : float
        Width of the picture per height.

    """
    (points, sketches), look = seen(motion, samples), motion.look
    camera = camera_for(points, look.view, aspect)
    for _ in range(2):
        camera = camera_for(np.concatenate(
            [points, *(extent(sketch, look.enlarged * camera.distance) for sketch in sketches)]),
            look.view, aspect)
    return camera


def seen(motion: Motion, samples: Sequence[int]) -> tuple[Array, list[Sketch]]:
    """Return the points (k, 3) [m] and sketches that must be in view."""
    playback, points = Playback(motion), []
    sketches: list[Sketch] = []
    solids = corners(visuals_of(motion.robot).parts)
    for each in motion.look.objects:
        solids[each.frame] = np.concatenate([
            solids.get(each.frame, np.empty((0, 3))), _outline(_solid(each))])
    for sample in samples:
        playback.seek(sample)
        points.append(outer_points(playback.state, solids))
        points += [playback.state.position(frame)[np.newaxis] for frame in motion.look.frames]
        sketches += [sketch for parts in playback.sketches().values() for sketch in parts]
    return np.concatenate(points), sketches
