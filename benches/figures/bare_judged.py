"""Tracks scenes of tools without tape with Trocar and with both reference methods, and judges them with SHARED/worlds/judge.py.

Usage: bare_judged.py WORLDS TROCAR OUT SCENE…

Each SCENE is a folder in the layout of SHARED/worlds. OUT gets `bare.json`, and a folder a scene with its tracks.
"""
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.dont_write_bytecode = True  # SHARED is not ours to write to
worlds, trocar, out, *scenes = sys.argv[1:]
sys.path.insert(0, worlds)

import judge  # noqa: E402

REFERENCES = ["mixture", "zhou"]
UNSTATED = {"sigma", "in95", "in99", "width", "predicted_in95"}  # a reference method states no errors
# A tool is found on a frame with a measured row whose tip is so near across the ray, and whose axis is so near.
NEAR_MM, NEAR_DEGREES = 3, 2
LEAST_SHOWN_MM = 40


def main():
    results = [judged(Path(scene)) for scene in scenes]
    (Path(out) / "bare.json").write_text(json.dumps(results))


def judged(scene):
    """The judge's figures of all methods, by their names; each tool's figures also have those of `found`."""
    folder = Path(out) / scene.name
    folder.mkdir(parents=True, exist_ok=True)
    truth = json.loads((scene / "truth.json").read_text())
    camera = json.loads((scene / "contract" / "camera_true.json").read_text())
    result = judge.judge(scene, trocar, None, [], folder)
    if result["verdict"] not in (*judge.NOT_REFUSED, "refused"):
        sys.exit(f"{scene}: {result['error'] or 'no verdict'}")
    ours = result.pop("tools")
    for number, tool in enumerate(ours):
        tool.update(found_where_shown(truth, camera, number, judge.read_track(f"{folder}/o.csv")))
    methods = {"ours": ours, **{name: reference(scene, folder, truth, camera, name) for name in REFERENCES}}
    return {**result, "refused": result["verdict"] == "refused", "methods": methods}


def reference(scene, folder, truth, camera, name):
    """Figures of each tool, followed with a reference method."""
    track = folder / f"{name}.csv"
    track.unlink(missing_ok=True)
    contract = scene / "contract"
    command = [trocar, "track", "--quiet", "--segmenter", name, "--camera", contract / "camera_true.json", "--annotations",
               contract / "annotations_marker.json", "--out", track, scene / "video.mp4"]
    ran = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=900)
    if ran.returncode:
        sys.exit(f"{scene}, {name}: {ran.stderr.strip()}")
    rows = judge.read_track(track)
    tools = [{**judge.judge_tool(truth, number, tool["tool"], rows), **found_where_shown(truth, camera, number, rows)}
             for number, tool in enumerate(truth["tools"])]
    return [{key: tool[key] for key in tool.keys() - UNSTATED} for tool in tools]


def found_where_shown(truth, camera, number, rows):
    """Frames where the tip and enough of the shaft show; on how many the tool was found, with the axis judged in the picture
    and in space; and the measured rows on all frames."""
    tool = truth["tools"][number]
    shown = found = found_in_space = 0
    for frame in truth["frames"]:
        true = frame["tools"][number]
        tip, axis = np.array(true["tip_mm"]), np.array(true["axis"])
        if not (true["tip_in_image"] and true["tip_end_visible_fraction"] >= 0.5
                and shown_mm(tool, true, camera) >= LEAST_SHOWN_MM):
            continue
        shown += 1
        row = rows.get((frame["frame"], tool["tool"]))
        if row is None or row["state"] == "predicted":
            continue
        ray = tip / np.linalg.norm(tip)
        error = row["tip"] - tip
        is_near = np.linalg.norm(error - (error @ ray) * ray) <= NEAR_MM
        found += bool(is_near and judge.axis_error(row["axis"], axis, ray)[0] <= NEAR_DEGREES)
        found_in_space += bool(is_near and angle_degrees(row["axis"], axis) <= NEAR_DEGREES)
    measured = sum(name == tool["tool"] and row["state"] != "predicted" for (_, name), row in rows.items())
    return dict(tool=tool["tool"], diameter_mm=tool["bare_tube_diameter_mm"], shown=shown, found_where_shown=found,
                found_in_space=found_in_space, measured=measured)


def shown_mm(tool, true, camera):
    """Length of shaft that shows: of its last 40 mm as the truth says, and of the rest to the trocar what is in the picture."""
    tip, axis = np.array(true["tip_mm"]), np.array(true["axis"])
    marked = tool["marker_length_mm"]
    to_trocar = np.linalg.norm(np.array(tool["trocar_mm"]) - tip)
    behind = np.arange(marked + 0.5, to_trocar, 1.0)
    return true["visible_fraction"] * marked + sum(is_in_picture(tip - back * axis, camera) for back in behind)


def is_in_picture(point, camera):
    if point[2] <= 1:
        return False
    x, y = point[:2] / point[2]
    r2 = x * x + y * y
    if r2 > 2:  # beyond the lens's widest angle, the distortion folds back into the picture
        return False
    k1, k2, p1, p2, k3 = (camera[name] for name in ("k1", "k2", "p1", "p2", "k3"))
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = camera["fx"] * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + camera["cx"]
    v = camera["fy"] * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + camera["cy"]
    return -0.5 <= u <= camera["width"] - 0.5 and -0.5 <= v <= camera["height"] - 0.5


def angle_degrees(axis, other):
    """The angle between two unit vectors; 180 without an axis."""
    if not np.isfinite(axis).all():
        return 180.0
    return math.degrees(math.acos(min(1.0, max(-1.0, float(axis @ other) / float(np.linalg.norm(axis))))))


if __name__ == "__main__":
    main()
