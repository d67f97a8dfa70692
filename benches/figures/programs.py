"""Runs programs, measures their cost, and reads the results that `trocar` prints."""
import json
import os
import subprocess
import sys
import time
import venv
from dataclasses import dataclass, field
from pathlib import Path

ROUNDS = 3
VISIBLE = 0.4
LIMIT, JUDGED, BARE_JUDGED, WORLD_PICTURE, CAUSE_CLIPS, RIVAL_CLIP = (
    Path(__file__).with_name(f"{name}.py")
    for name in ("limit", "judged", "bare_judged", "world_picture", "cause_clips", "rival_clip"))
PEER_NEEDS = ["opencv-python-headless<5", "numpy", "scipy", "numba"]


@dataclass
class Goal:
    """A goal: the figure, the limit, the value reached, and whether it meets the limit (None: unknown)."""
    name: str
    goal: str
    reached: str
    met: bool | None

    def verdict(self):
        return {True: "yes", False: "**no**", None: "–"}[self.met]


@dataclass
class Part:
    """The goals and tables that one part of the measurement adds to docs/accuracy.md, and the pictures that they show."""
    goals: list = field(default_factory=list)
    tables: list = field(default_factory=list)
    pictures: list = field(default_factory=list)


@dataclass
class Usage:
    """Resources of one run of a program. The peak is at least the few MiB of this script itself."""
    cpu_s: float
    wall_s: float
    peak_mib: float


class Bench:
    """The programs under test and the folder for their results. `more_worlds`: a folder of further scenes, or None."""

    def __init__(self, trocar, shared, work, quick, more_worlds=None):
        self.trocar, self.shared, self.work, self.quick, self.more_worlds = trocar, shared, work, quick, more_worlds
        work.mkdir(parents=True, exist_ok=True)
        self._python = None

    def rounds(self, usual):
        return 1 if self.quick else usual

    def folder(self, name):
        """A folder for results, apart from those of quick runs."""
        folder = self.work / ("quick" if self.quick else "full") / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    @property
    def python(self):
        """A Python environment with the peer's packages; created on first use."""
        folder = self.work / "peer-venv"
        if not (folder / "ready").exists():
            venv.create(folder, with_pip=True, clear=True)
            run([folder / "bin" / "pip", "install", "-q", *PEER_NEEDS])
            (folder / "ready").touch()
        return folder / "bin" / "python"

    def calibrate(self, scene):
        camera = scene.out / "camera.json"
        run([self.trocar, "calibrate", "--quiet", "--board", "9x6", "--square-mm", "21", "--out", camera, *scene.photos])
        return camera

    def track(self, scene, camera, name="track.csv", options=()):
        """Tracks a scene's clip. Returns the path of the trajectory file and the resources used."""
        track = scene.out / name
        command = [self.trocar, "track", "--quiet", "--camera", camera, "--annotations", scene.annotations,
                   "--out", track, *options, scene.video]
        return track, run(command)

    def peer_track(self, scene, camera):
        """Tracks with the peer. Returns its trajectory file and its own CPU times. Its colour table is stored, so that a second run
        does not compute it again."""
        track, timings = scene.out / "peer.csv", scene.out / "peer.json"
        run([self.python, self.shared / "peer" / "opencv_tracker.py", "--video", scene.video, "--camera", camera,
             "--annotations", scene.annotations, "--out", track, "--timings", timings, "--lut", scene.out / "peer-lut.npy"])
        return track, json.loads(timings.read_text())

    def limit(self, scene):
        """The smallest errors that the scene's pictures allow (see `limit.py`)."""
        return output(self.python, LIMIT, scene.video, scene.truth, scene.annotations, scene.true_camera)

    def evaluated(self, track, truth):
        """Figures of all tools together, for frames with at least VISIBLE of the band in view; each tool's are under `tools`."""
        figures = output(self.trocar, "evaluate", "--json", track, truth)
        return {**well_visible(figures["all"]), "tools": [well_visible(tool) for tool in figures["tools"]]}

    def judged(self, scenes, out):
        """Figures of SHARED/worlds/judge.py for folders of scenes, tracked with the true camera. The tracks stay in `out`."""
        run([self.python, JUDGED, self.shared / "worlds", self.trocar, out, *scenes])
        results = json.loads((out / "judged.json").read_text())
        for result in results:
            if result["error"]:
                print(f"  {result['scene']}: {result['error']}", file=sys.stderr)
        return results

    def worlds(self, kind):
        """The scenes of SHARED/worlds with this kind of marker, and those in the folder of further scenes."""
        places = [self.shared / "worlds" / "dev", *([self.more_worlds] if self.more_worlds else [])]
        folders = [folder for place in places for folder in sorted(place.iterdir()) if (folder / "truth.json").exists()]
        return [folder for folder in folders if marker_kind(folder) == kind]

    def bare_judged(self, scenes, out):
        """The same for tools without tape, tracked by each method (see `bare_judged.py`)."""
        run([self.python, BARE_JUDGED, self.shared / "worlds", self.trocar, out, *scenes])
        return json.loads((out / "bare.json").read_text())

    def repeatability(self, *tracks):
        return output(self.trocar, "evaluate", "--json", "--repeatability", *tracks)


def well_visible(tool):
    """A tool's figures for frames with at least VISIBLE of the band in view, together with its figures for all frames."""
    level = next(level for level in tool["levels"] if level["visible_from"] == VISIBLE)
    return {**level, **{key: tool[key] for key in ("tool", "false_tracks", "at_rest")}}


def marker_kind(folder):
    """What is on the tools of a scene in the layout of SHARED/worlds."""
    return json.loads((folder / "truth.json").read_text())["tools"][0].get("marker_kind", "band")


def run(command):
    """Runs a program until it ends. Raises CalledProcessError if it fails."""
    start = time.monotonic()
    process = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        print(said, file=sys.stderr)
        raise subprocess.CalledProcessError(process.returncode, command, stderr=said)
    return Usage(used.ru_utime + used.ru_stime, time.monotonic() - start, used.ru_maxrss / 1024)


def output(*command):
    """The JSON that a program prints."""
    return json.loads(subprocess.run([str(part) for part in command], check=True, stdout=subprocess.PIPE, text=True).stdout)


def decoding(video):
    """The command that only decodes a video, as every tracker must."""
    return ["ffmpeg", "-v", "error", "-threads", "2", "-i", video, "-f", "null", "-"]


def frames_and_mbit_s(video):
    """Number of frames and bit rate of a clip."""
    command = ["ffprobe", "-v", "error", "-select_streams", "v:0", "-count_packets", "-show_entries",
               "stream=nb_read_packets:format=duration,size", "-of", "json", str(video)]
    probed = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    size, duration = float(probed["format"]["size"]), float(probed["format"]["duration"])
    return int(probed["streams"][0]["nb_read_packets"]), 8e-6 * size / duration


def table(head, rows):
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))
