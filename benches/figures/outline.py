"""The outline of a band of tape in the camera picture, and its motion with the tube's pose.

METHOD 4, `measurement/src/vision/tube.rs`.
"""
import numpy as np

JAWS_MM = 30.0


class Camera:
    """OpenCV's pinhole camera with the distortion `k1 k2 p1 p2 k3`."""

    def __init__(self, numbers):
        self.__dict__.update(numbers)

    def project(self, points):
        x, y = (points[:, :2] / points[:, 2:]).T
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        u = x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x)
        v = y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y
        return np.stack([u * self.fx + self.cx, v * self.fy + self.cy], 1)


class Tube:
    """A tube that ends at its tip. Its band's outline has two borders (parts 0, 1), a distal end (2) and another end (3)."""

    def __init__(self, tip, axis, radius, length):
        self.tip, self.axis, self.radius, self.length = tip, axis / np.linalg.norm(axis), radius, length
        nearest = tip - self.axis * (tip @ self.axis)
        distance = np.linalg.norm(nearest)
        self.away, self.half_angle = nearest / distance, np.arccos(radius / distance)
        self.sideways = np.cross(self.axis, self.away)

    def part(self, part, steps):
        """Points along a part at equal steps, without its ends. For a rim, only the near half."""
        along = (np.arange(steps) + 0.5) / steps
        if part < 2:
            return self._rim(along * self.length, np.full(steps, (-1.0, 1.0)[part]))
        return self._rim(np.full(steps, (0.0, self.length)[part - 2]), 1.8 * along - 0.9)

    def _rim(self, back_mm, across):
        angle = (across * self.half_angle)[:, None]
        outwards = -self.away * np.cos(angle) + self.sideways * np.sin(angle)
        return self.tip - np.multiply.outer(back_mm, self.axis) + outwards * self.radius

    def moved(self, unknown, by):
        """The tube moved in one unknown: the tip in mm (unknowns 0–2) or the axis in radians (3, 4)."""
        change = [*np.eye(3), *across(self.axis)][unknown] * by
        tip, axis = (self.tip + change, self.axis) if unknown < 3 else (self.tip, self.axis + change)
        return Tube(tip, axis, self.radius, self.length)

    def hides(self, points):
        """True for each point that the tube or its jaws hide."""
        sight = points / np.linalg.norm(points, axis=1)[:, None]
        inside = np.abs(sight @ self.sideways) * np.sin(self.half_angle) <= sight @ self.away * np.cos(self.half_angle)
        along = sight @ self.axis
        ahead = (along * (sight @ self.tip) - self.axis @ self.tip) / np.maximum(1 - along**2, 1e-9)
        return inside & (ahead < JAWS_MM) & ((self.tip + np.outer(ahead, self.axis))[:, 2] < points[:, 2])


def across(axis):
    """Two unit vectors perpendicular to an axis and to each other."""
    return np.linalg.svd(axis[None])[2][1:]


class Edge:
    """One part of an outline in the picture, in steps of about a pixel: position, outward normal, visibility, and its outward
    motion in pixels per unit of each unknown of the pose."""

    def __init__(self, tube, part, camera, others):
        coarse = camera.project(tube.part(part, 64))
        length_px = np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum() * 64 / 63
        steps = max(int(length_px), 2)
        self.step_px = length_px / steps
        points = tube.part(part, steps)
        self.at = camera.project(points)
        tangent = np.gradient(self.at, axis=0)
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], 1) / np.linalg.norm(tangent, axis=1)[:, None]
        opposite = camera.project(tube.part(part ^ 1, 1))
        self.normal = normal * np.sign(((self.at - opposite) * normal).sum(1).mean())
        self.seen = ((self.at > 8) & (self.at < np.array([camera.width, camera.height]) - 9)).all(1)
        for other in others:
            self.seen &= ~other.hides(points)
        by = 1e-4
        there, back = ([camera.project(tube.moved(unknown, to).part(part, steps)) for unknown in range(5)] for to in (by, -by))
        self.by_pose = np.stack([((a - b) * self.normal).sum(1) / (2 * by) for a, b in zip(there, back)], 1)
