"""A run as a film: the vehicle on its chart, the plans that it follows, and what moves around it."""

import errno
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray
from PIL import Image

from auvplan.errors import AuvplanError
from auvplan.plot import style
from auvplan.plot.maps import Map
from auvplan.records import MissionRun, PlanRecord
from auvplan.runtime.files import OutputError, output_folder, write_atomically
from auvplan.runtime.formatting import counted, figure, hours
from auvplan.site import at_time
from auvplan.view.scene import executed_legs, refused_legs, track_at, window
from auvplan.view.timeline import doings

#: Longest film and most pictures a second; formats hold no more than a hundredth of a second apart well.
LONGEST, FASTEST = 120.0, 30
#: Seconds of film for which the last picture stays, and in which a plan fades that is given up.
_LAST, _FADE = 2.0, 1.2
#: Dots per inch of the pictures; radius of the smallest disks, pixels.
_DPI, _LEAST = 100, 2.5
#: Colours of a GIF beside those named here: few make a small file, and 256 is the most.
_COLOURS = 64
#: Shades of 256 by which others differ from those at least.
_NEAR = 8

_TRACK, _PLAN, _ROUTE = style.BLACK, style.RED, style.BLUE
_TASK_DONE, _AHEAD, _OTHER = style.GREEN, style.SKY, "#ffffff"
#: Of obstacles that the vehicle does not sense.
_UNSEEN = 0.4

Frame = NDArray[np.uint8]


def animate_run(
    run: MissionRun,
    path: str | Path,
    *,
    seconds: float = 12.0,
    fps: int = 12,
    width: int = 640,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Write a run as a film: GIF, or MP4 where ffmpeg is found.

    Shown are the track so far, the plan that is followed, plans that are given up as they fade, the route of
    tasks and those done, the sensed range, and the true obstacles of the leg, pale beyond that range.

    Args:
        run: as executed, or a plan.
        path: of the file, ending in .gif or .mp4; its folder is created if needed.
        seconds: that the mission takes in the film, at most 120; the last picture stays two seconds more.
        fps: pictures a second, at most 30.
        width: pixels, at least 320.
        progress: called with the share that is done and words for it.

    Raises:
        AuvplanError: nothing was executed, or an argument is out of range; one line.
        OutputError: the file cannot be written, or is an MP4 and there is no ffmpeg; one line that names it.
    """
    target = Path(path)
    write = {".gif": _write_gif, ".mp4": _write_mp4}.get(target.suffix.lower())
    if write is None:
        raise OutputError(f"{target}: a film is a .gif, or an .mp4 where ffmpeg is installed")
    if write is _write_mp4 and shutil.which("ffmpeg") is None:
        raise OutputError(f"{target}: MP4 needs ffmpeg, which is not found: install it, or write a .gif")
    if not 0.0 < seconds <= LONGEST:
        raise AuvplanError(f"seconds: {seconds:g} is not above 0 and at most {LONGEST:g}")
    if not 1 <= fps <= FASTEST:
        raise AuvplanError(f"fps: {fps} is not from 1 to {FASTEST}")
    if width < 320:
        raise AuvplanError(f"width: {width} pixels are less than 320")
    if not any(len(leg.times) for leg in run.legs):
        raise AuvplanError("no leg was executed: there is nothing to animate")
    output_folder(target.parent)
    film = _Film(run, width, run.t_mission / seconds * _FADE)
    times = np.linspace(0.0, film.ends, max(round(seconds * fps), 2))

    def frames() -> Iterator[Frame]:
        for number, time in enumerate(times):
            if progress is not None:
                progress(number / len(times), "drawing the film")
            yield film.at(time)

    return write_atomically(target, lambda part: write(frames(), film, part, fps))


@dataclass(frozen=True)
class _Shown:
    """A plan and how long it is followed: `line` [S, 2] in the axes' unit, from `begin` to `end`, s."""

    line: style.Array
    begin: float
    end: float
    kept: bool


class _Film:
    """One figure, whose moving parts are drawn again over what stays."""

    def __init__(self, run: MissionRun, width: int, fade: float) -> None:
        """Draw what stays; a plan that is given up fades within `fade` s of mission time."""
        self._run, self._fade = run, fade
        self._legs, self._doings = executed_legs(run), doings(run)
        self._times = np.concatenate([leg.times for leg in self._legs])
        track = np.concatenate([leg.positions for leg in self._legs])
        self.ends = float(max(run.t_mission, self._times[-1]))
        self._waypoints = np.asarray(run.graph.positions, float)
        low, high = window(np.concatenate([self._waypoints, track]), 0.05, run.chart)
        self._stops = [node for node in range(len(self._waypoints)) if node not in (run.start, run.goal)]
        (tall, wide), inches = high - low, width / _DPI
        size = inches, inches * float(np.clip(0.87 * tall / wide, 0.4, 1.3)) + 1.35
        self._figure = Figure(figsize=size, dpi=_DPI, layout="constrained")
        self._canvas = FigureCanvasAgg(self._figure)
        self._axes = axes = self._figure.subplots()
        self._pen = pen = Map(axes, low, high)
        self._track, self._plans = pen.flat(track), _plans(run, pen)
        axes.tick_params(labelsize=7)
        axes.set_xlabel(axes.get_xlabel(), fontsize=8)
        axes.set_ylabel(axes.get_ylabel(), fontsize=8)
        pen.depths(run.seabed)
        pen.handles.clear()
        pen.coast(run.coast)
        del pen.handles[1:]
        pen.closures(run)
        pen.compass(np.concatenate([self._waypoints, track]))
        pen.end(self._waypoints[run.start], style.START, "start", 0.6)
        pen.end(self._waypoints[run.goal], style.GOAL, "destination", 0.6)
        handles = list(pen.handles)
        if not run.simulated:
            pen.known(run.obstacles, 0.0)
        axes.set_title(self._words(0.0), fontsize=8.5, loc="left")
        self._figure.legend(
            handles=handles + self._legend(), loc="outside lower center", ncols=4, fontsize=7,
            frameon=False, handlelength=1.6, columnspacing=1.2, borderpad=0.1,
        )  # fmt: skip
        self._canvas.draw()
        self._figure.set_layout_engine("none")
        self.moving = self._parts()
        self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._figure.bbox)

    def at(self, time: float) -> Frame:
        """Return the picture of a time, s: [height, width, 3]."""
        self._canvas.restore_region(self._still)
        for part in self._moved(time):
            self._axes.draw_artist(part)
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self._canvas.get_width_height()

    @staticmethod
    def colours() -> style.Array:
        """Return colours [n, 3] from 0 to 1 that are not to be lost: of few pixels, or pale over water."""
        still = (_OTHER, style.WATER, style.COAST, style.UNCERTAIN, style.GREY, style.YELLOW)
        moving = (*style.KIND_COLOURS.values(), _TRACK, _PLAN, _ROUTE, _TASK_DONE, _AHEAD)
        pale = [(_PLAN, 0.75 - 0.15 * step) for step in range(5)]
        pale += [(colour, _UNSEEN) for colour in style.KIND_COLOURS.values()]
        water = np.array(to_rgb(style.WATER))
        mixed = [share * np.array(to_rgb(colour)) + (1.0 - share) * water for colour, share in pale]
        return np.array([*(to_rgb(colour) for colour in (*still, *moving)), *mixed])

    def _parts(self) -> dict[str, Any]:
        axes, run, places = self._axes, self._run, self._pen.flat(self._waypoints)
        line: dict[str, Any] = {"solid_capstyle": "round", "animated": True}
        (route,) = axes.plot([], [], color=_ROUTE, lw=1.0, ls=(0, (1, 2)), alpha=0.8, zorder=4, **line)
        (track,) = axes.plot([], [], color=_TRACK, lw=2.2, path_effects=style.halo(3.4), zorder=5, **line)
        (plan,) = axes.plot([], [], color=_PLAN, lw=1.8, zorder=6, **line)
        past = LineCollection([], linewidths=1.3, zorder=5, animated=True)
        axes.add_collection(past, autolim=False)
        dots: dict[str, Any] = {"s": 17, "edgecolors": "black", "linewidths": 0.7, "zorder": 7}
        stops = axes.scatter(*places[self._stops].T, animated=True, **dots)
        vehicle = axes.scatter(*places[:1].T, **(style.VEHICLE | {"s": 48, "zorder": 9, "animated": True}))
        reach = Circle((0.0, 0.0), self._range, fill=False, ec=_PLAN, lw=1.0, ls="--", animated=True)
        axes.add_patch(reach)
        axes.title.set_animated(True)
        title = axes._left_title  # type: ignore[attr-defined]
        title.set_animated(True)
        scale = float(axes.transData.transform((1.0, 0.0))[0] - axes.transData.transform((0.0, 0.0))[0])
        obstacles = []
        for leg in self._legs if run.simulated else ():
            across = 2.0 * np.maximum(leg.obstacle_radii / self._pen.metres, _LEAST / scale)
            disks = EllipseCollection(
                across, across, np.zeros_like(across), units="xy", offsets=np.zeros((len(across), 2)),
                offset_transform=axes.transData, edgecolors="none", zorder=4.5, animated=True,
            )  # fmt: skip
            axes.add_collection(disks, autolim=False)
            obstacles.append(disks)
        return {
            "route": route, "past": past, "track": track, "plan": plan, "obstacles": obstacles,
            "stops": stops, "reach": reach, "vehicle": vehicle, "title": title,
        }  # fmt: skip

    @property
    def _range(self) -> float:
        """Of the sensors, in the axes' unit; zero where it is not known or nothing is sensed."""
        known = self._run.scenario.get("sensors", {}).get("range", 0.0) if self._run.simulated else 0.0
        return float(known) / self._pen.metres

    def _moved(self, time: float) -> list[Any]:
        """Move the parts to where they are at a time; return those to draw, the lowest first."""
        parts = self.moving
        number = max(sum(leg.times[0] <= time for leg in self._legs) - 1, 0)
        here = np.array([np.interp(time, self._times, axis) for axis in self._track.T])
        executed = self._track[self._times <= time]
        parts["track"].set_data(*np.concatenate([executed, here[None]]).T)
        parts["vehicle"].set_offsets(here)
        parts["title"].set_text(self._words(time))
        ahead = self._ahead(time)
        parts["route"].set_data(*self._pen.flat(self._waypoints[ahead]).T)
        parts["stops"].set_facecolors(self._states(time, ahead))
        # Plans that were given up are the paler the longer ago.
        ages = [(plan, (time - plan.end) / self._fade) for plan in self._plans if not plan.kept]
        shown = [(plan, age) for plan, age in ages if 0.0 <= age < 1.0]
        parts["past"].set_segments([plan.line for plan, _ in shown])
        parts["past"].set_color([to_rgba(_PLAN, 0.75 * (1.0 - age)) for _, age in shown])
        drawn = [parts["route"], parts["past"]]
        if self._run.simulated:
            drawn.append(self._obstacles(number, time, here))
        drawn.append(parts["track"])
        current = [plan for plan in self._plans if plan.begin <= time < plan.end]
        if current:
            parts["plan"].set_data(*current[-1].line.T)
            drawn.append(parts["plan"])
        drawn.append(parts["stops"])
        if self._range:
            parts["reach"].set_center(tuple(here))
            drawn.append(parts["reach"])
        return [*drawn, parts["vehicle"], parts["title"]]

    def _obstacles(self, number: int, time: float, here: style.Array) -> EllipseCollection:
        """True obstacles of a leg where they are."""
        leg, disks = self._legs[number], self.moving["obstacles"][number]
        if not len(leg.obstacle_radii):
            return disks
        tracks = np.asarray(leg.obstacle_positions, float).swapaxes(0, 1)
        at = self._pen.flat([track_at(leg, track, time) for track in tracks])
        away = np.linalg.norm(at - here, axis=1) - leg.obstacle_radii / self._pen.metres
        strength = np.where(away <= self._range, 1.0, _UNSEEN) if self._range else np.ones(len(away))
        colours = [style.KIND_COLOURS.get(kind, style.GREY) for kind in leg.obstacle_kinds]
        disks.set_offsets(at)
        disks.set_facecolor([to_rgba(colour, alpha) for colour, alpha in zip(colours, strength, strict=True)])
        return disks

    def _ahead(self, time: float) -> list[int]:
        """Waypoints of the route from the next one on."""
        routes = [route for route in self._run.routes if route.made_at <= time]
        if not routes:
            return []
        begun = sum(routes[-1].made_at - 1e-6 <= leg.times[0] <= time for leg in self._legs)
        arrived = bool(begun) and self._legs[-1].times[0] <= time and self._legs[-1].times[-1] <= time
        return [] if arrived else routes[-1].nodes[begun:]

    def _states(self, time: float, ahead: list[int]) -> list[str]:
        """Return the colours of the waypoints but the ends: done, in the route, or neither."""
        colours = [_OTHER] * len(self._waypoints)
        for node in ahead:
            colours[node] = _AHEAD
        for leg in self._run.earning:
            if leg.ends <= time:
                colours[leg.goal] = _TASK_DONE
        return [colours[node] for node in self._stops]

    def _words(self, time: float) -> str:
        """Return the clock, what is done and what goes on, below the run's name."""
        run = self._run
        name = str(run.scenario.get("name") or "mission")
        epoch = run.site.epoch if run.site else None
        when = f"{hours(time)} of {hours(run.t_available)}"
        clock = f"{when}, {at_time(time, epoch, since=0.0)}" if epoch else when
        done = [leg for leg in run.earning if leg.ends <= time]
        priority = figure(sum(leg.priority for leg in done))
        tasks = f"{counted(run.count_tasks(done), 'task')} done, priority {priority}"
        title = f"{name}, {f'seed {run.seed}' if run.simulated else 'plan'}"
        doing = [words for moment, words in self._doings if moment <= time]
        return f"{title}: {clock}\n{tasks}; {doing[-1] if doing else 'not under way yet'}"

    def _legend(self) -> list[Any]:
        """Return what the moving parts are."""
        dot: dict[str, Any] = {"ls": "", "marker": "o", "ms": 5.0, "mec": "black"}
        found: list[Any] = [
            style.mark(style.VEHICLE, "vehicle", mec="white"),
            style.line("executed" if self._run.simulated else "passed", color=_TRACK, lw=2.2),
            style.line("plan", color=_PLAN, lw=1.8),
            style.line("task ahead", color=_AHEAD, **dot),
            style.line("task done", color=_TASK_DONE, **dot),
            style.line("route", color=_ROUTE, lw=1.0, ls=":"),
        ]
        if not all(plan.kept for plan in self._plans):
            found.insert(3, style.line("plan given up", color=to_rgba(_PLAN, 0.4), lw=1.3))
        if self._range:
            found.append(style.line("sensed range", color=_PLAN, lw=1.0, ls="--"))
        kinds = [kind for leg in self._legs for kind in leg.obstacle_kinds]
        return found + (style.obstacle_patches(kinds, "") if self._run.simulated else [])


def _plans(run: MissionRun, pen: Map) -> list[_Shown]:
    """Return all plans that were followed or refused, by time."""

    def shown(plan: PlanRecord, begin: float, end: float, kept: bool = False) -> _Shown:
        return _Shown(pen.flat(plan.positions), begin, end, kept)

    refused = [leg.plans[-1] for leg in refused_legs(run)]
    found = [shown(plan, plan.made_at, plan.made_at) for plan in refused]
    for leg in executed_legs(run):
        plans, ends = leg.followed_plans, float(leg.times[-1])
        found += [shown(plan, plan.made_at, later.made_at) for plan, later in pairwise(plans)]
        found += [shown(last, min(last.made_at, ends), ends, True) for last in plans[-1:]]
    return sorted(found, key=lambda plan: plan.begin)


def _write_gif(frames: Iterator[Frame], film: _Film, path: Path, fps: int) -> None:
    """Write an endless GIF with one palette for all pictures."""
    # The film's own colours, and those of four of its pictures.
    shown = np.concatenate([film.at(time) for time in np.linspace(0.0, film.ends, 4)])
    common = Image.fromarray(shown).quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
    others = np.reshape(common.getpalette() or [], (-1, 3))[:_COLOURS]
    own = np.rint(255.0 * film.colours()).astype(int)
    # Pillow confuses colours that are close: its own would replace those.
    apart = np.abs(others[:, None] - own).max(axis=2).min(axis=1) > _NEAR
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([own, others[apart]]).ravel().tolist())
    pictures = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    # Times are hundredths of a second: rounded so that their sum is right.
    ends = np.rint(100.0 * np.arange(len(pictures) + 1) / fps).astype(int)
    durations = (10 * np.diff(ends)).tolist()
    durations[-1] += round(1000.0 * _LAST)
    pictures[0].save(
        path, format="GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0,
        optimize=False, disposal=1,
    )  # fmt: skip


def _write_mp4(frames: Iterator[Frame], film: _Film, path: Path, fps: int) -> None:
    """Write an MP4 that every player knows, whose sides are even.

    Raises:
        OSError: ffmpeg failed.
    """
    wide, tall = film.size
    command = [
        "ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{wide}x{tall}",
        "-r", str(fps), "-i", "-", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-c:v", "libx264",
        "-crf", "20", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-bitexact", str(path),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            frame = b""
            for picture in frames:
                frame = picture.tobytes()
                encoder.stdin.write(frame)
            for _ in range(round(_LAST * fps)):
                encoder.stdin.write(frame)
            encoder.stdin.close()
        except BrokenPipeError:
            pass  # it says why
        message = encoder.stderr.read().decode(errors="replace").strip().splitlines()
    if encoder.returncode:
        raise OSError(errno.EIO, f"ffmpeg: {message[-1] if message else 'it failed'}")
