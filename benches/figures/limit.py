"""The smallest error that a clip's pictures allow: the Cramér–Rao bound of the tip's position. Runs under the bench's Python.

Usage: limit.py VIDEO TRUTH ANNOTATIONS CAMERA prints JSON with RMS errors in mm: `frame` from one frame's edges alone; `path` for
paths smoothed with the hand motion of `MotionSettings`; `pivoted` for such paths of a tube that turns about a known trocar;
`offset` for one frame with each part of the outline off by OFFSET_PX (one standard deviation) in an unknown direction.
limit.py --check fits edges in synthetic pictures. It fails if an estimate beats the bound, or misses it in white noise.

**Method** An edge of contrast C, blurred by s px, in noise of n codes carries information on its position of C²/(2·√π·s·n²)
per pixel of its length (∫(dI/dx)²/n² dx); a chroma plane of half size carries a quarter of that. C, s and n are read from the
clip along the true outline: each cell of the outline is regressed on an edge between two slopes. s is the blur with the smallest
residual and includes motion blur. n is derived from the scatter of the edge positions from cell to cell, so it includes the effect
of noise that compression has correlated along the edge, and of small structure in the background. The motion of the outline with
the pose converts this into information on tip and axis.
**Not included** are effects that shift a whole edge: light, gloss, sharpening, compression (except in `offset`). Sizes and camera
are assumed known, noise independent in each frame and plane and white across the edge, paths long: all of this lowers the bound.
"""
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from scipy.special import ndtr

from outline import Camera, Edge, Tube, across
from programs import VISIBLE

FRAMES = 40
MOTION_MM2_S3 = 400.0**2 * 0.05  # METHOD 5: acceleration² · its duration
OFFSET_PX = 0.1
BLURS_PX = np.geomspace(0.5, 3.5, 16)
PLANES = [(1, np.zeros(2)), (2, np.array([0.0, 0.5])), (2, np.array([0.0, 0.5]))]  # Y, U, V of 4:2:0: px per sample, first sample
REACH_PX, CELL_PX = {1: 5, 2: 7}, {1: 4, 2: 8}  # by px per sample
ALIKE_PX = 8  # noise farther apart is independent: a block of the transform
MEDIAN_OF_SQUARE = 0.4549  # of a normally distributed number of variance 1


def regressed(edge, plane, scale, first):
    """The fit of an edge in a plane, cell by cell (see `fitted`); None if too little is visible."""
    reach, cell_px = REACH_PX[scale], CELL_PX[scale]
    low = np.floor((edge.at.min(0) - reach - first) / scale).astype(int).clip(0)
    high = np.ceil((edge.at.max(0) + reach - first) / scale).astype(int) + 1
    codes = plane[low[1]:high[1], low[0]:high[0]].astype(float)
    places = np.stack(np.meshgrid(*(np.arange(codes.shape[1 - i]) + low[i] for i in (0, 1))), -1).reshape(-1, 2) * scale + first
    _, nearest = cKDTree(edge.at).query(places)
    apart, normal = places - edge.at[nearest], edge.normal[nearest]
    outside = (apart * normal).sum(1)
    use = (np.abs(outside) < reach) & (np.linalg.norm(apart - outside[:, None] * normal, axis=1) < 0.8) & edge.seen[nearest]
    cell = (nearest[use] * edge.step_px / cell_px).astype(int)
    full = np.flatnonzero(np.bincount(cell) > 0.6 * 2 * reach * cell_px / scale**2)
    if not len(full):
        return None
    whole = np.isin(cell, full)
    found = np.searchsorted(full, cell[whole]), codes.ravel()[use][whole], outside[use][whole]
    return min((fitted(*found, blur) for blur in BLURS_PX), key=lambda fit: fit.left)


def fitted(cell, codes, outside, blur):
    """Fits an edge in each cell: its contrast, contrast times position, and the variance of the latter for noise of one code."""
    inner, slope = ndtr(-outside / blur), np.exp(-0.5 * (outside / blur) ** 2) / (blur * np.sqrt(2 * np.pi))
    columns = np.stack([inner, 1 - inner, inner * outside, (1 - inner) * outside, slope])
    matrix = np.array([[np.bincount(cell, a * b) for a in columns] for b in columns]).transpose(2, 0, 1)
    inverse = np.linalg.inv(matrix + 1e-6 * np.eye(5))
    solved = np.einsum("cij,jc->ci", inverse, np.array([np.bincount(cell, a * codes) for a in columns]))
    left = ((codes - (columns * solved[cell].T).sum(0)) ** 2).sum()
    contrast, moved, variance = solved[:, 0] - solved[:, 1], solved[:, 4], inverse[:, 4, 4]
    return SimpleNamespace(blur=blur, contrast=contrast, moved=moved, variance=variance, left=left)


def noise_squared(fits, scale):
    """The scatter of edge positions along borders, as the noise of independent samples, codes². ALIKE_PX of border give one
    position. Its distance from the line of its neighbours counts, because an offset or a tilt of the whole border is no noise. The
    median is used, because background structure behind some borders is no noise either."""
    together, bends = ALIKE_PX // CELL_PX[scale], []
    for fit in fits:
        whole = len(fit.moved) // together * together
        contrast, moved, variance = (of[:whole].reshape(-1, together) for of in (fit.contrast, fit.moved, fit.variance))
        sure = (contrast**2 / variance).sum(1)
        place = (contrast * moved / variance).sum(1) / sure
        bends.append(np.diff(place, 2) ** 2 / (1 / sure[:-2] + 4 / sure[1:-1] + 1 / sure[2:]))
    return np.median(np.concatenate(bends)) / MEDIAN_OF_SQUARE


def information_per_px(fit, squared, scale):
    """Information on an edge's position per pixel of its length, 1/px²."""
    return (fit.contrast**2).mean() / (2 * np.sqrt(np.pi) * fit.blur * squared) / scale**2


def information(edges, shown, noise):
    """Information on tip, axis and the offsets of the outline's parts."""
    total = np.zeros((9, 9))
    for part, (edge, fits) in enumerate(zip(edges, shown)):
        per_px = sum(information_per_px(fit, squared, scale) for fit, squared, (scale, _) in zip(fits, noise, PLANES) if fit)
        of_all = np.hstack([edge.by_pose, np.tile(np.eye(4)[part], (len(edge.at), 1))])[edge.seen]
        total += of_all.T @ of_all * edge.step_px * per_px
    return total


def pictures(video, frames, camera):
    """Y, U and V of the chosen frames."""
    chosen = "+".join(f"eq(n,{frame})" for frame in frames)
    command = ["ffmpeg", "-v", "error", "-i", video, "-vf", f"select='{chosen}'", "-fps_mode", "passthrough", "-pix_fmt",
               "yuv420p", "-f", "rawvideo", "-"]
    sizes = [(camera.height // scale, camera.width // scale) for scale, _ in PLANES]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        for _ in frames:
            yield [np.frombuffer(process.stdout.read(h * w), np.uint8).reshape(h, w) for h, w in sizes]


def looked_at(video, truth, annotations, camera):
    """For chosen frames, each well visible tool: name, tube, edges, and the fits of each edge in each plane."""
    chosen = [truth["frames"][i] for i in sorted(set(np.linspace(0, len(truth["frames"]) - 1, FRAMES).astype(int)))]
    sizes = {tool["tool"]: tool for tool in annotations.get("tools", [])}
    for frame, picture in zip(chosen, pictures(video, [frame["frame"] for frame in chosen], camera)):
        tubes = {}
        for tool in frame["tools"]:
            size = {**truth, **annotations, **sizes.get(tool["tool"], {})}
            radius = (size.get("diameter_mm") or size["tool_diameter_mm"]) / 2
            tubes[tool["tool"]] = Tube(np.array(tool["tip_mm"]), np.array(tool["axis"]), radius, size["band_length_mm"])
        for name in (tool["tool"] for tool in frame["tools"] if tool["visible"] >= VISIBLE):
            edges = [Edge(tubes[name], part, camera, [tubes[other] for other in tubes if other != name]) for part in range(4)]
            shown = [[regressed(edge, plane, *sampled) for plane, sampled in zip(picture, PLANES)] for edge in edges]
            yield name, tubes[name], edges, shown


def smoothed(covariance, dt):
    """Covariance of the tip in the middle of a long path, if every frame has this covariance: it combines the frame itself with the
    predictions from the frames before and after."""
    step = np.kron([[1, dt], [0, 1]], np.eye(3))
    disturbed = np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3)) * MOTION_MM2_S3
    own, foretold, back = np.zeros((6, 6)), np.eye(6) * 1e6, np.kron(np.diag([1, -1]), np.eye(3))
    own[:3, :3] = np.linalg.inv(covariance)
    for _ in range(200):
        foretold = step @ np.linalg.inv(np.linalg.inv(foretold) + own) @ step.T + disturbed
    before = np.linalg.inv(foretold)
    return np.linalg.inv(own + before + back @ before @ back)[:3, :3]


def trocar(tubes):
    """The point nearest to all axes."""
    beside = [np.eye(3) - np.outer(tube.axis, tube.axis) for tube in tubes]
    return np.linalg.solve(sum(beside), sum(b @ tube.tip for b, tube in zip(beside, tubes)))


def bounds(video, truth, annotations, camera):
    seen = list(looked_at(video, truth, annotations, camera))
    noise = [noise_squared([fits[plane] for *_, shown in seen for fits in shown[:2] if fits[plane]], PLANES[plane][0])
             for plane in range(3)]
    trocars = {name: trocar([tube for other, tube, *_ in seen if other == name]) for name, *_ in seen}
    kinds = {"frame": [], "path": [], "pivoted": [], "offset": []}
    beliefs = np.diag([0] * 5 + [OFFSET_PX**-2] * 4)
    for name, tube, edges, shown in seen:
        known = information(edges, shown, noise)
        if np.linalg.matrix_rank(known[:5, :5]) < 5:
            continue  # a border is hidden
        by_tip = np.vstack([np.eye(3), across(tube.axis) / np.linalg.norm(tube.tip - trocars[name])])
        kinds["frame"].append(np.linalg.inv(known[:5, :5])[:3, :3])
        kinds["path"].append(smoothed(kinds["frame"][-1], 1 / truth["fps"]))
        kinds["pivoted"].append(smoothed(np.linalg.inv(by_tip.T @ known[:5, :5] @ by_tip), 1 / truth["fps"]))
        kinds["offset"].append(np.linalg.inv(known + beliefs)[:3, :3])
    luma = [fits[0] for *_, shown in seen for fits in shown[:2] if fits[0]]
    contrast, blur = np.abs(np.concatenate([fit.contrast for fit in luma])), [fit.blur for fit in luma]
    return {**{kind: rms(covariances) for kind, covariances in kinds.items()}, "noise_codes": np.sqrt(noise).tolist(),
            "blur_px": float(np.median(blur)), "contrast_codes": float(np.median(contrast))}


def rms(covariances):
    x, y, z = np.mean([np.diag(covariance) for covariance in covariances], 0)
    return {"lateral": (x + y) ** 0.5, "depth": z**0.5, "3d": (x + y + z) ** 0.5}


def check():
    """Fits the position of a border of 120 px in 300 pictures by least squares, in white noise and in noise correlated over 2 px."""
    random, contrast, blur, border = np.random.default_rng(1), 40.0, 0.9, np.array([0.8, 0.6])
    normal, at = np.array([border[1], -border[0]]), np.array([20.0, 30.0]) + np.outer(np.arange(120), border)
    edge = SimpleNamespace(at=at, normal=np.tile(normal, (120, 1)), seen=np.ones(120, bool), step_px=1.0)
    apart = np.stack(np.meshgrid(np.arange(140), np.arange(140)), -1) - at[0]
    outside, along = apart @ normal, apart @ border
    slope = contrast * np.exp(-0.5 * (outside / blur) ** 2) / (blur * np.sqrt(2 * np.pi)) * ((along > -0.5) & (along < 119.5))
    for alike_px, most in ((0.0, 1.1), (0.8, 2.5)):
        noise = [gaussian_filter(random.normal(0, 3.0, outside.shape), alike_px) for _ in range(300)]
        scatter = np.std([(slope * codes).sum() / (slope**2).sum() for codes in noise])
        fits = [regressed(edge, 90 + contrast * ndtr(-outside / blur) + codes, *PLANES[0]) for codes in noise]
        squared = noise_squared(fits, 1)
        bound = (np.mean([information_per_px(fit, squared, 1) for fit in fits]) * 120) ** -0.5
        print(f"noise alike over {2.5 * alike_px:.0f} px: scatter {scatter:.4f} px, bound {bound:.4f} px")
        assert 0.9 * bound < scatter < most * bound


if __name__ == "__main__":
    if sys.argv[1:] == ["--check"]:
        check()
    else:
        truth, annotations, camera = (json.loads(Path(file).read_text()) for file in sys.argv[2:])
        print(json.dumps(bounds(sys.argv[1], truth, annotations, Camera(camera))))
