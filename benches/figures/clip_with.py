"""Runs the peer's clip generator with changed colours or light. Usage: clip_with.py PEER LOOK [make_clip's options]

LOOK is empty (unchanged), `purple` (a purple band over a floor of reds and blues: the thesis's bad pair) or `hard` (hard light: a
raking lamp, deep shade, a streak of glare along the tape).
"""
import sys

peer, look = sys.argv[1], sys.argv[2]
sys.argv = ["make_clip.py", *sys.argv[3:]]
sys.path.insert(0, peer)

import cv2  # noqa: E402
import make_clip  # noqa: E402
import numpy as np  # noqa: E402


def purple_on_red_and_blue():
    make_clip.TOOLS[0].update(name="purple", bgr=(150, 45, 110))
    plain = make_clip.floor_texture

    def floor(rng):
        texture, *size = plain(rng)
        hsv = cv2.cvtColor(np.clip(texture, 0, 255).astype(np.float32) / 255, cv2.COLOR_BGR2HSV)
        coloured = hsv[..., 1] > 0.25
        hsv[..., 0] = np.where(coloured, np.where(hsv[..., 0] < 120, 0.0, 235.0), hsv[..., 0])  # degrees: red, blue
        return (255 * cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)).astype(np.float32), *size

    make_clip.floor_texture = floor


def hard_light():
    make_clip.LIGHT = np.array([40.0, -150.0, 110.0])
    make_clip.AMBIENT = 0.12
    plain = make_clip.Tool.colour

    def glossy(self, part, s, cap):
        labels, base, gloss = plain(self, part, s, cap)
        return labels, base, max(gloss, 0.6)

    make_clip.Tool.colour = glossy


{"": lambda: None, "purple": purple_on_red_and_blue, "hard": hard_light}[look]()
make_clip.main()
