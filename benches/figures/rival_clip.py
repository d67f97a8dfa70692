"""Draws something of a tape's colour into a clip. Usage: rival_clip.py VIDEO TRUTH ANNOTATIONS KIND OUT

KIND is a name in `KINDS`. The thing has the colour of the first tool's tape, darker towards its sides, blurred and noisy like the
rest of the picture. Still things lie where no tool comes near; carried ones cross the picture in front of the tools.
"""
import json
import subprocess
import sys

import cv2
import numpy as np

BLUR_PX = 1.0
NOISE_CODES = 2.5
SHAFT_CODES = (45, 45, 48)


def main():
    video, truth, annotations, kind, out = sys.argv[1:]
    frames = read(video)
    height, width = frames[0].shape[:2]
    scale = height / 720
    marks = json.loads(open(annotations).read())["labels"]
    tape = colour_of(frames, [m for m in marks if m["label"] not in ("background", "shaft", "jaw", "glove", "other")][:1])
    place = quietest_place(json.loads(open(truth).read()), width, height)
    rng = np.random.default_rng(1)
    with encoder(out, width, height) as encoding:
        for number, frame in enumerate(frames):
            layer, mask = np.zeros_like(frame), np.zeros(frame.shape[:2], np.uint8)
            KINDS[kind](layer, mask, tape, place, scale, number / len(frames), (width, height))
            encoding.stdin.write(blended(frame, layer, mask, rng).tobytes())
    if encoding.returncode:
        sys.exit("ffmpeg failed")


def read(video):
    capture, frames = cv2.VideoCapture(video), []
    while (read := capture.read())[0]:
        frames.append(read[1])
    return frames


def colour_of(frames, marks):
    """Mean colour of the marked pixels."""
    return np.mean([frames[m["frame"]][m["y"]:m["y"] + m["h"], m["x"]:m["x"] + m["w"]].reshape(-1, 3).mean(0) for m in marks], 0)


def quietest_place(truth, width, height):
    """The place in the picture that is farthest from all paths of the tips."""
    points = np.array([tool["tip_px"] for frame in truth["frames"] for tool in frame["tools"] if tool["tip_px"]])
    grid = [(x, y) for x in np.linspace(0.14, 0.86, 9) * width for y in np.linspace(0.16, 0.84, 7) * height]
    return max(grid, key=lambda at: np.min(np.linalg.norm(points - at, axis=1)))


def encoder(out, width, height):
    return subprocess.Popen(["ffmpeg", "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{width}x{height}", "-r", "25",
                             "-i", "-", "-vf", "scale=out_color_matrix=bt709:out_range=limited,format=yuv420p", "-c:v", "libx264", "-crf",
                             "18", "-colorspace", "bt709", "-color_range", "tv", out], stdin=subprocess.PIPE)


def blended(frame, layer, mask, rng):
    cover = cv2.GaussianBlur(mask.astype(np.float32) / 255, (0, 0), BLUR_PX)[..., None]
    drawn = cv2.GaussianBlur(layer.astype(np.float32), (0, 0), BLUR_PX) + rng.normal(0, NOISE_CODES, frame.shape)
    return np.clip(frame * (1 - cover) + drawn * cover, 0, 255).astype(np.uint8)


def bar(layer, mask, colour, middle, size, turn_deg, round_light=True):
    """A bar, darker towards its long sides as a tube is."""
    length, thick = size
    turn = np.deg2rad(turn_deg)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    strips = 12 if round_light else 1
    for strip in range(strips):
        low, high = (thick * (edge / strips - 0.5) for edge in (strip, strip + 1))
        light = np.sqrt(max(0.0, 1 - (2 * (strip + 0.5) / strips - 1) ** 2)) if round_light else 1.0
        corners = [middle + along * x + across * y for x, y in
                   [(-length / 2, low), (length / 2, low), (length / 2, high), (-length / 2, high)]]
        points = np.round(np.array(corners) * 16).astype(np.int32)
        cv2.fillConvexPoly(layer, points, [float(c) * (0.55 + 0.45 * light) for c in colour], cv2.LINE_8, 4)
        cv2.fillConvexPoly(mask, points, 255, cv2.LINE_8, 4)


def blob(layer, mask, colour, middle, axes, turn_deg=0.0, thick=-1):
    at, axes = tuple(int(c) for c in middle), tuple(int(a) for a in axes)
    for picture, value in [(layer, [float(c) for c in colour]), (mask, 255)]:
        cv2.ellipse(picture, at, axes, turn_deg, 0, 360, value, thick, cv2.LINE_AA)


def taped(layer, mask, colour, tip, scale, turn_deg):
    """A second taped instrument: a band, and a dark shaft behind it."""
    back = -np.array([np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))])
    bar(layer, mask, SHAFT_CODES, tip + back * 260 * scale, (360 * scale, 24 * scale), turn_deg)
    bar(layer, mask, colour, tip + back * 45 * scale, (90 * scale, 26 * scale), turn_deg)


def carried(share, size):
    """Where a carried thing is: it crosses the picture and comes back."""
    width, height = size
    return np.array([width * (0.5 - 0.42 * np.cos(2 * np.pi * share)), height * (0.45 + 0.25 * np.sin(4 * np.pi * share))])


KINDS = {
    "sticker as large as a band": lambda l, m, c, p, s, t, z: bar(l, m, c, np.array(p), (90 * s, 28 * s), 20, False),
    "large sticker": lambda l, m, c, p, s, t, z: bar(l, m, c, np.array(p), (170 * s, 70 * s), -35, False),
    "ring": lambda l, m, c, p, s, t, z: blob(l, m, c, p, (34 * s, 26 * s), 15, int(12 * s)),
    "pen lying still": lambda l, m, c, p, s, t, z: bar(l, m, c, np.array(p), (230 * s, 20 * s), 60),
    "second instrument lying still": lambda l, m, c, p, s, t, z: taped(l, m, c, np.array(p), s, 205),
    "glove": lambda l, m, c, p, s, t, z: blob(l, m, c, p, (120 * s, 80 * s), 30),
    "suture packet": lambda l, m, c, p, s, t, z: bar(l, m, c, np.array(p), (150 * s, 110 * s), 8, False),
    "sticker carried": lambda l, m, c, p, s, t, z: bar(l, m, c, carried(t, z), (90 * s, 28 * s), 360 * t, False),
    "pen carried": lambda l, m, c, p, s, t, z: bar(l, m, c, carried(t, z), (200 * s, 18 * s), 40 + 60 * np.sin(6 * t)),
    "second instrument carried": lambda l, m, c, p, s, t, z: taped(l, m, c, carried(t, z), s, 200 + 20 * np.sin(5 * t)),
}

if __name__ == "__main__":
    main()
