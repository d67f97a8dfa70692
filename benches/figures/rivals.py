"""Things of a tape's colour in the box: the right tool must be followed, or the session refused.

Half of the cases are V1 with a thing drawn into it (`rival_clip.py`); the other half are scenes of SHARED/worlds where something
is carried, or where pegs have a tape's colour. Judged with the true camera by SHARED/worlds/judge.py.
"""
import hashlib
import json
import shutil

import degraded
from programs import RIVAL_CLIP, Goal, Part, run, table

KINDS = ["sticker as large as a band", "large sticker", "ring", "pen lying still", "second instrument lying still", "glove",
         "suture packet", "sticker carried", "pen carried", "second instrument carried"]
WORLDS = [0, 4, 5, 8, 9, 10, 11, 16, 37, 39]
MAX_FALSE = 0.05
"""A tool is followed rightly if at most this share of its rows is on nothing: a thing that passes in front of it may mislead
the tracker for some frames, not for most."""


def measure(bench, scenes):
    out = bench.folder("rivals")
    drawn = [clip(bench, scenes.rendered[0], out, kind) for kind in KINDS[:2 if bench.quick else None]]
    worlds = [bench.shared / "worlds" / "dev" / f"band{number:02d}" for number in WORLDS[:1 if bench.quick else None]]
    judged = bench.judged([*drawn, *worlds], out)
    wrong = [scene["scene"] for scene in judged if outcome(scene) == "wrong"]
    refused = sum(outcome(scene) == "refused" for scene in judged)
    goal = Goal("something of a tape's colour in the box: right tool followed, or refused", f"{len(judged)} of {len(judged)}",
                f"{len(judged) - len(wrong)} of {len(judged)}, {refused} of them refused" + degraded.listed(wrong), not wrong)
    about = ("Rivals: things of a tape's colour. *Wrong*: not refused, and over 5 % of a tool's rows are on nothing or on the other "
             "tool, or the tool is silently wrong.")
    rows = [[scene["scene"], scene["verdict"], outcome(scene), " · ".join(map(cell, scene["tools"]))] for scene in judged]
    return Part([goal], [about, table(["case", "verdict", "outcome", "tools"], rows)])


def clip(bench, scene, out, kind):
    """V1 with a thing drawn into it, in the layout of SHARED/worlds."""
    made_of = hashlib.sha256(scene.video.read_bytes() + kind.encode() + RIVAL_CLIP.read_bytes()).hexdigest()[:12]
    folder = out / f"clip-{made_of}"
    (folder / "contract").mkdir(parents=True, exist_ok=True)
    shutil.copyfile(scene.true_camera, folder / "contract" / "camera_true.json")
    annotations = json.loads(scene.annotations.read_text())
    (folder / "contract" / "annotations.json").write_text(json.dumps({**annotations, "video": "../video.mp4"}))
    (folder / "truth.json").write_text(json.dumps({**degraded.truth(scene, kind), "scene": kind}))
    if not (folder / "video.mp4").exists():
        unfinished = folder / "unfinished.mp4"
        run([bench.python, RIVAL_CLIP, scene.video, scene.truth, scene.annotations, kind, unfinished])
        unfinished.rename(folder / "video.mp4")
    return folder


def outcome(scene):
    if scene["refused"]:
        return "refused"
    misled = [tool for tool in scene["tools"] if tool["false"] + tool["swaps"] > MAX_FALSE * max(tool["rows"], 1)]
    return "wrong" if misled or scene["silent"] else "right"


def cell(tool):
    if not tool["rows"]:
        return f"{tool['tool']}: never seen"
    return f"{tool['tool']}: {100 * tool['found']:.0f} % found, {tool['false']} of {tool['rows']} rows on nothing"
