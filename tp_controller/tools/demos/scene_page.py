# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Scene of a lesson on a page in the browser: question, answer, and the motion of each run."""

from collections.abc import Mapping
import time
from typing import NoReturn

import numpy as np
from tp_controller.tools.demos.scene import Curve, Scene
from tp_controller.tools.demos.simulation import Run
from tp_controller.tools.demos.stage import camera_of, Stage
from tp_controller.tools.view.camera import FILM_FOV
from tp_controller.tools.view.plots import HEIGHT, series_of
from tp_controller.tools.view.scene import add_sky
from tp_controller.tools.view.stack_panel import assign
import viser

# Frame rate [1/s]; time for which the last sample is shown before the run starts again [s].
RATE, LAST_SECONDS = 30.0, 1.5
# Height of the picture beside the panel [pixels], its width per height, and number of samples that
# define the view.
PIXELS, ASPECT, VIEWS = 768, 1.0, 20


class ScenePage:
    """
    Page of a scene, shared by all browsers that open it.

    Parameters
    ----------
    server : viser.ViserServer
    scene : Scene
    runs : {str: Run}
        Run of each variant.

    Attributes
    ----------
    variant : viser.GuiDropdownHandle
        Name of the run that is shown.
    clock : viser.GuiSliderHandle
        Time of the sample that is shown [s]; set by the page while the run is played.
    button : viser.GuiButtonHandle
        Pauses the run, and continues it.

    """

    def __init__(self, server: viser.ViserServer, scene: Scene, runs: Mapping[str, Run]) -> None:
        self._server, self._scene, self._runs = server, scene, runs
        gui, first = server.gui, next(iter(runs.values()))
        add_question(gui, scene)
        self.variant = gui.add_dropdown('run', tuple(runs), visible=len(runs) > 1)
        self.clock = gui.add_slider('time [s]', 0.0, float(first.times[-1]), 0.01, 0.0)
        self.button = gui.add_button('Pause')
        self.button.on_click(lambda _: self._toggle())
        for label, curve in scene.curves.items():
            _add_plot(gui, f'{label} [{curve.unit}]', curve, runs)
        self._shown, self._time, self._drawn, self._plays = self.variant.value, 0.0, 0.0, True
        motion = scene.motion(first)
        samples = np.linspace(0, len(first.times) - 1, VIEWS).astype(int).tolist()
        camera = camera_of(motion, samples, ASPECT)
        add_sky(server.scene)
        self._stage = Stage(server.scene, motion, camera, PIXELS)
        view = server.initial_camera
        view.position = camera.position
        view.look_at = camera.position + camera.distance * camera.R[:, 2]
        view.fov = FILM_FOV
        self.update(0.0)

    def update(self, seconds: float) -> None:
        """
        Show the sample that is due.

        Parameters
        ----------
        seconds : float
            Time since the last call [s].

        """
        if self.variant.value != self._shown:
            self._shown = self.variant.value
            self._stage.restart(self._scene.motion(self._runs[self._shown]))
        run = self._runs[self._shown]
        if self.clock.value != self._drawn:
            # Somebody has moved the slider.
            self._time = self.clock.value
        elif self._plays:
            self._time += seconds
            if self._time > run.times[-1] + LAST_SECONDS:
                self._time = 0.0
        sample = min(round(self._time / run.times[1]), len(run.times) - 1)
        with self._server.atomic():
            self._stage.show(sample)
            self._drawn = round(float(run.times[sample]), 2)
            if self.clock.value != self._drawn:
                assign(self.clock, self._drawn)

    def _toggle(self) -> None:
        """Pause or continue."""
        self._plays = not self._plays
        self.button.label = 'Pause' if self._plays else 'Play'


def show_scene(server: viser.ViserServer, scene: Scene) -> NoReturn:
    """Compute the runs of a scene, and show them until Ctrl-C."""
    page = ScenePage(server, scene, scene.runs())
    last = time.monotonic()
    while True:
        time.sleep(1.0 / RATE)
        now = time.monotonic()
        page.update(now - last)
        last = now


def add_question(gui: viser.GuiApi, scene: Scene) -> None:
    """Add the question of a scene, with its answer in a folder that is closed at first."""
    gui.add_markdown(f'**{scene.title}**\n\n{scene.question}')
    with gui.add_folder('Answer', expand_by_default=False):
        gui.add_markdown(scene.answer)


def _add_plot(gui: viser.GuiApi, title: str, curve: Curve, runs: Mapping[str, Run]) -> None:
    """Add a plot of a curve of all runs over time, with its bounds as lines."""
    first = next(iter(runs.values()))
    values = (np.asarray(curve.values(run), dtype=float) for run in runs.values())
    bounds = [bound for bound in (curve.lower, curve.upper) if np.isfinite(bound)]
    lines = (np.full(len(first.times), bound) for bound in bounds)
    gui.add_uplot((first.times, *values, *lines), series_of(tuple(runs), len(bounds)),
                  title=title, height=HEIGHT, scales={'x': {'time': False}})
