"""Draws the true and the tracked band into the frame where the tracked tip is worst for its stated covariance.

Usage: world_picture.py WORLDS SCENE TRACK INDEX NAME OUT.jpg

INDEX is the tool's number in the truth, NAME its name in the track. OUT.json gets the frame's number and the errors.
"""
import json
import sys
from pathlib import Path

import cv2
import numpy as np
from outline import Camera, Tube

sys.dont_write_bytecode = True  # SHARED is not ours to write to
sys.path.append(sys.argv[1])

import judge  # noqa: E402

TRUE, TRACKED = (60, 220, 60), (255, 0, 255)
WIDTH, QUALITY = 640, 82  # a picture of at most 60 KB
MIN_VIEW = 0.17  # of the frame's width
BITS = 2  # drawn coordinates are in quarters of a pixel


def main():
    scene, track, index, name, out = Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]), sys.argv[5], Path(sys.argv[6])
    truth = json.loads((scene / "truth.json").read_text())
    rows = judge.read_track(track)
    frame, true, row = max(pairs(truth, rows, index, name), key=lambda pair: badness(*pair[1:]))
    camera = Camera(json.loads((scene / "contract" / "camera_true.json").read_text()))
    scale, corner = view(camera, [true["tip"], row["tip"]])
    moved = np.array([[scale, 0, -scale * corner[0]], [0, scale, -scale * corner[1]]])
    height = round(WIDTH * camera.height / camera.width)
    picture = cv2.warpAffine(read_frame(scene / "video.mp4", frame), moved, (WIDTH, height), flags=cv2.INTER_CUBIC)
    tool = truth["tools"][index]
    for pose, colour in ((true, TRUE), (row, TRACKED)):
        draw(picture, Tube(pose["tip"], pose["axis"], tool["diameter_mm"] / 2, tool["marker_length_mm"]), colour,
             lambda points: scale * (camera.project(points) - corner))
    cv2.imwrite(str(out), picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    ray = true["tip"] / np.linalg.norm(true["tip"])
    error = row["tip"] - true["tip"]
    along = error @ ray
    shown = {"frame": frame, "along_mm": along, "across_mm": np.linalg.norm(error - along * ray)}
    out.with_suffix(".json").write_text(json.dumps(shown))


def badness(true, row):
    return judge.chi2(row["tip"] - true["tip"], row["cov"])


def pairs(truth, rows, index, name):
    """Frame, true pose and measured row, where the band is well seen."""
    for frame in truth["frames"]:
        tool, row = frame["tools"][index], rows.get((frame["frame"], name))
        if row and row["state"] == "observed" and min(tool["visible_fraction"], tool["tip_end_visible_fraction"]) >= 0.5:
            yield frame["frame"], {"tip": np.array(tool["tip_mm"]), "axis": np.array(tool["axis"])}, row


def read_frame(video, number):
    """A frame by counting, because seeking is not exact in every file."""
    clip = cv2.VideoCapture(str(video))
    for _ in range(number):
        clip.grab()
    return clip.read()[1]


def view(camera, tips):
    """Scale, and the upper left corner of the part of the frame that shows both tips."""
    at = camera.project(np.array(tips))
    whole = np.array([camera.width, camera.height])
    size = whole * np.clip(2 * np.max(np.ptp(at, axis=0) / whole), MIN_VIEW, 1)
    return WIDTH / size[0], np.clip(at.mean(0) - size / 2, 0, whole - size)


def draw(picture, tube, colour, project):
    axis = project(tube.tip - np.multiply.outer(np.linspace(0, tube.length, 30), tube.axis))
    for line in [axis, *(project(tube.part(part, 60)) for part in range(4))]:
        cv2.polylines(picture, [np.round(line * 2**BITS).astype(int)], False, colour, 1, cv2.LINE_AA, BITS)
    tip = [int(at) for at in np.round(axis[0] * 2**BITS)]
    cv2.circle(picture, tip, 4 * 2**BITS, colour, 1, cv2.LINE_AA, BITS)


main()
