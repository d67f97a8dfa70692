"""Scenes with known truth, each with checkerboard photos of its camera: rendered scenes, the peer's, and the simulator's."""
import sys
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from programs import run


@dataclass
class Scene:
    """Paths of a clip, its annotations, truth, camera and photos, and a folder for results."""
    name: str
    out: Path
    video: Path
    annotations: Path
    truth: Path
    true_camera: Path
    photos: list


class Scenes:
    """Finds or makes the scenes. Scenes are kept for later runs."""

    def __init__(self, bench):
        self.bench = bench

    @cached_property
    def rendered(self):
        """V1–V5 of SHARED: V2 is seen at an oblique angle at 1080p, the others from above at 720p."""
        names = ["V2", "V3"] if self.bench.quick else ["V1", "V2", "V3", "V4", "V5"]
        return [self._rendered(name) for name in names]

    def _rendered(self, name):
        folder = self.bench.shared / "scenes" / name
        photos = self.bench.shared / "scenes" / "calib" / ("W" if name == "V2" else "V")
        return Scene(name, self._folder(name), folder / "video.mp4", folder / "annotations.json", folder / "truth.json",
                     folder / "camera_true.json", sorted(photos.glob("*.jpg")))

    @cached_property
    def peer_1080p(self):
        """Two tools at 1080p, made by the peer's clip generator."""
        return self.peer_clip("peer, 1080p", "1080p", 4 if self.bench.quick else 20)

    def peer_clip(self, name, size, seconds, look=""):
        """A clip made by the peer's generator. `look` changes colours and light (see `clip_with.py`)."""
        folder = self._folder(f"{name} {seconds} s")
        if not (folder / "truth.json").exists():
            maker = Path(__file__).with_name("clip_with.py")
            run([self.bench.python, maker, self.bench.shared / "peer", look, "--out", folder, "--size", size,
                 "--seconds", seconds])
        return Scene(name, folder, folder / "clip.mp4", folder / "annotations.json", folder / "truth.json",
                     folder / "camera.json", sorted((folder / "boards").glob("*.jpg")))

    @cached_property
    def own(self):
        """The simulator's scenes: two tools moving beads, seen from above, and two tools crossing, seen from the side."""
        chosen = [("pegs", "top"), ("crossing", "side")]
        return [self.simulated(scene, view) for scene, view in chosen[:1 if self.bench.quick else None]]

    def simulated(self, scene, view):
        """A whole task of the simulator (the scene `rest`: 8 s), 720p."""
        seconds = ["--seconds", 4] if self.bench.quick and scene != "slide" else []
        return self._own(f"own {scene} {view}", f"own {scene}, {view}", ["--scene", scene, "--view", view, "--seed", 5, *seconds])

    def bare(self, scene, view):
        """A whole scene of the simulator with tools without tape, 720p."""
        seconds = ["--seconds", 8] if self.bench.quick else []
        how = ["--scene", scene, "--view", view, "--seed", 5, "--marker", "bare", *seconds]
        return self._own(f"own bare {scene} {view}", f"own {scene}, {view}", how)

    @cached_property
    def bare_1080p(self):
        """Two tools without tape at 1080p, moving beads."""
        how = ["--scene", "pegs", "--view", "top", "--seed", 5, "--marker", "bare", "--size", "1920x1080",
               "--seconds", 4 if self.bench.quick else 10]
        return self._own("own bare pegs 1080p", "own pegs, 1080p, bare", how)

    def person(self, seed, level, task, view, box, fps=25):
        """A whole task of a simulated person, 720p."""
        seconds = ["--seconds", 6] if self.bench.quick else []
        name = f"person {seed}" + (f" {fps} fps" if fps != 25 else "")
        return self._own(name, name, ["--scene", task, "--view", view, "--skill", level, "--box", box, "--fps", fps, "--seed", seed,
                                      *seconds])

    def beside(self, scene, how):
        """A scene for another clip with its annotations. Photos and truth are those of the given scene."""
        out = self._folder(f"{scene.name} {how}")
        return replace(scene, name=f"{scene.name} {how}", out=out, video=out / "clip.mp4", annotations=out / "annotations.json")

    def hands(self, seed, level, person, box):
        """A whole peg transfer by a person with individual skill: small and at 15 frames per second, because there are many."""
        seconds = ["--seconds", 6] if self.bench.quick else []
        return self._own(f"hands {seed}", f"hands {seed}", ["--scene", "pegs", "--skill", level, "--person", person, "--box", box,
                                                            "--size", "640x360", "--fps", 15, "--boards", 0, "--seed", seed, *seconds])

    def _own(self, folder, name, how):
        folder = self._folder(folder)
        if not (folder / "clip.mp4").exists():
            run([self.bench.trocar, "simulate", "--quiet", *how, "--out", folder / "new"])
            for made in sorted((folder / "new").iterdir()):
                made.rename(folder / made.name)
        return Scene(name, folder, folder / "clip.mp4", folder / "annotations.json", folder / "truth.json",
                     folder / "camera.json", sorted((folder / "boards").glob("*.jpg")))

    def _folder(self, name):
        folder = self.bench.work / ("quick" if self.bench.quick else "full") / name.replace(", ", "-").replace(" ", "-")
        if not folder.exists():
            print(f"  {name}", file=sys.stderr)
        folder.mkdir(parents=True, exist_ok=True)
        return folder
