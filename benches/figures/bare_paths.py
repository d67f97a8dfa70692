"""Tools without tape in scenes of the simulator: both at rest for a minute, and one whose tip is hidden for half a second, again
and again: behind a block that is a part of the box, and in a copy of the clip behind a card that is not.

The truth says how much of the last 40 mm of a shaft can be seen. In these scenes nothing hides a shaft but the block before the
tip, so the tip is hidden by it where less than all can be seen. The card is drawn over the clip between two sights of the block.
"""
import csv
import json
import math
from dataclasses import replace
from itertools import pairwise
from statistics import fmean

from programs import Goal, Part, run, table

VIEWS = ("top", "side")
AT_REST_MM_S = 0.5
NEAR_MM, NEAR_DEGREES = 3, 2
MOST_REST_MM_S = 2
SEEN = 0.99  # share of the last 40 mm: an end within 0.4 mm is not hidden
# The error beside a gap: the mean over frames so long before and after it. Nearer frames are smoothed together with the gap.
BESIDE_S = (0.2, 0.6)
MOST_ALONG_MM, MOST_ACROSS_MM = 2, 0.4
# The card: time over the tip, half of its side, and how far its middle is ahead of the tip.
CARD_S, CARD_HALF_MM, CARD_AHEAD_MM, CARD_COLOUR = 0.5, 14, 8, "0x9a9488"
REST_HEAD = ["scene", "tool", "from frame", "seconds", "followed", "first followed", "longest gap", "smoothed speed", "verdict"]
HIDDEN_HEAD = ["scene", "path", "gaps", "hidden frames", "with a row", "observed", "in 95 %", "added along", "added across",
               "verdict"]


def measure(bench, scenes):
    rests = [rest(bench, scenes.bare("long-rest", view)) for view in VIEWS]
    covered = [case for view in VIEWS for case in covers(scenes, scenes.bare("hidden-tip", view))]
    gaps = [hidden(bench, *case, path) for case in covered for path in ("smoothed", "causal")]
    about_rests = ("Bare tools at rest, in the simulator's `long-rest`. *From frame*: the first frame of the rest. *Followed*: "
                   "share of its frames with a measured tip within 3 mm across the line of sight and an axis within 2° in the "
                   "picture. *Smoothed speed*: RMS over the rest without its first half second.")
    about_gaps = ("A hidden tip, in the simulator's `hidden-tip`: a block hides the tip again and again. The block is a part of "
                  "the box; a *card* is not: it is drawn over the tip for half a second in a copy of the clip. *With a row*, "
                  "*observed*: hidden frames with any position, and with one that claims to be measured. *In 95 %*: share of "
                  f"the rows inside their stated region. *Added*: RMS error less the mean error {BESIDE_S[0]} to "
                  f"{BESIDE_S[1]} s before and after the gap, along the tool's axis in space, and across it in the picture, mm.")
    return Part([*rest_goals(rests), *hidden_goals(gaps)],
                [about_rests, table(REST_HEAD, [row for of_scene in rests for row in rest_rows(of_scene)]),
                 about_gaps, table(HIDDEN_HEAD, [hidden_row(of_path) for of_path in gaps])])


def tracked(bench, scene, path):
    """The rows of a path by frame and tool, and the verdict on the session."""
    quality = scene.out / f"{path}.json"
    options = ["--quality", quality, *(["--causal"] if path == "causal" else [])]
    track, _ = bench.track(scene, bench.calibrate(scene), f"{path}.csv", options)
    with open(track, newline="") as file:
        rows = {(int(row["frame"]), row["tool"]): row for row in csv.DictReader(file)}
    return track, rows, json.loads(quality.read_text())["verdict"]


# ── rest ────────────────────────────────────────────────────────────────────────────────────────────────────────────────────────


def rest(bench, scene):
    track, rows, verdict = tracked(bench, scene, "smoothed")
    frames = json.loads(scene.truth.read_text())["frames"]
    tools = [rest_of(frames, number, rows) for number in range(len(frames[0]["tools"]))]
    speeds = {tool["tool"]: tool["at_rest"] for tool in bench.evaluated(track, scene.truth)["tools"]}
    return dict(name=scene.name, verdict=verdict, tools=[{**tool, "speed": speeds.get(tool["tool"])} for tool in tools])


def rest_of(frames, number, rows):
    """How a tool was followed over its longest rest."""
    stretch = longest_rest(frames, number)
    name = stretch[0]["tools"][number]["tool"]
    is_followed = [is_found(frame["tools"][number], rows.get((frame["frame"], name))) for frame in stretch]
    first = next((frame["frame"] for frame, found in zip(stretch, is_followed) if found), None)
    missed, longest = 0, 0
    for found in is_followed:
        missed = 0 if found else missed + 1
        longest = max(longest, missed)
    step_s = stretch[1]["time_s"] - stretch[0]["time_s"]
    return dict(tool=name, start=stretch[0]["frame"], seconds=stretch[-1]["time_s"] - stretch[0]["time_s"], frames=len(stretch),
                followed=sum(is_followed), first=first, gap_s=longest * step_s)


def longest_rest(frames, number):
    """The longest run of frames without true movement."""
    longest, run = [], frames[:1]
    for before, frame in pairwise(frames):
        way = math.dist(before["tools"][number]["tip_mm"], frame["tools"][number]["tip_mm"])
        still = way < AT_REST_MM_S * (frame["time_s"] - before["time_s"])
        run = [*run, frame] if still else [frame]
        longest = max(longest, run, key=len)
    return longest


def is_found(true, row):
    if row is None or row["state"] != "observed":
        return False
    along_ray, _, side = directions(true)
    error = error_of(true, row)
    off = [value - dot(error, along_ray) * ray for value, ray in zip(error, along_ray)]
    axis = [float(row[key]) for key in ("axis_x", "axis_y", "axis_z")]
    ahead = cross(side, along_ray)  # the axis in the picture
    turn = math.degrees(math.atan2(dot(axis, side), dot(axis, ahead)))
    return math.hypot(*off) <= NEAR_MM and abs(turn) <= NEAR_DEGREES


def rest_goals(rests):
    tools = [tool for of_scene in rests for tool in of_scene["tools"]]
    share = " · ".join(f"{of_scene['name']} " + ", ".join(f"{tool['tool']} {percent(tool)}" for tool in of_scene["tools"])
                       for of_scene in rests)
    speed = " · ".join(f"{of_scene['name']} " + ", ".join(f"{tool['tool']} {speed_of(tool)}" for tool in of_scene["tools"])
                       for of_scene in rests)
    return [Goal("bare tools at rest for 60 s, the left one from the first frame on: followed", "100 %", share,
                 all(tool["followed"] == tool["frames"] for tool in tools)),
            Goal("smoothed speed of a bare tool at rest, RMS, mm/s", f"≤ {MOST_REST_MM_S}", speed,
                 all(tool["speed"] and tool["speed"]["rms_mm_s"] <= MOST_REST_MM_S for tool in tools))]


def percent(tool):
    return f"{100 * tool['followed'] / tool['frames']:.1f} %"


def speed_of(tool):
    return f"{tool['speed']['rms_mm_s']:.2f}" if tool["speed"] else "too few rows"


def rest_rows(of_scene):
    for tool in of_scene["tools"]:
        yield [of_scene["name"], tool["tool"], str(tool["start"]), f"{tool['seconds']:.1f}",
               f"{tool['followed']} of {tool['frames']}", "never" if tool["first"] is None else f"frame {tool['first']}",
               f"{tool['gap_s']:.2f} s", f"{speed_of(tool)} mm/s", of_scene["verdict"].replace("_", " ")]


# ── hidden tip ──────────────────────────────────────────────────────────────────────────────────────────────────────────────────


def covers(scenes, scene):
    """The scene with its gaps behind the block, and a copy of its clip with those behind a card."""
    frames = json.loads(scene.truth.read_text())["frames"]
    blocks = gaps_of(frames)
    cards = cards_of(frames, blocks)
    copy = scenes.beside(scene, "card")
    if not copy.video.exists():
        camera = json.loads(scene.true_camera.read_text())
        drawn = ",".join(card(frames[at]["tools"][0], at, camera) for gap in cards for at in gap)
        run(["ffmpeg", "-v", "error", "-y", "-i", scene.video, "-vf", drawn, "-c:v", "libx264", "-qp", 10, "-pix_fmt", "yuv420p",
             copy.video])
    return [(replace(scene, name=f"{scene.name}, block"), blocks),
            (replace(copy, name=f"{scene.name}, card", annotations=scene.annotations), cards)]


def cards_of(frames, blocks):
    """Gaps of half a second, two between each pair of gaps behind the block."""
    count = round(CARD_S / (frames[1]["time_s"] - frames[0]["time_s"]))
    starts = [before[-1] + round(third * (after[0] - before[-1]) / 3) - count // 2
              for before, after in pairwise(blocks) for third in (1, 2)]
    return [list(range(start, start + count)) for start in starts]


def card(true, at, camera):
    """What draws a card over the tip on a frame. It follows the tip."""
    x, y, z = true["tip_mm"]
    ahead = [true["axis"][0] * z - x * true["axis"][2], true["axis"][1] * z - y * true["axis"][2]]
    px = camera["fx"] / z
    length = math.hypot(*ahead)
    left, top = (round(tip + px * (CARD_AHEAD_MM * way / length - CARD_HALF_MM)) for tip, way in zip(true["tip_px"], ahead))
    side = round(2 * CARD_HALF_MM * px)
    return f"drawbox=x={left}:y={top}:w={side}:h={side}:color={CARD_COLOUR}:t=fill:enable='eq(n,{at})'"


def hidden(bench, scene, gaps, path):
    """What the gaps of a scene add to the errors of a path."""
    _, rows, verdict = tracked(bench, scene, path)
    frames = json.loads(scene.truth.read_text())["frames"]
    step_s = frames[1]["time_s"] - frames[0]["time_s"]
    near, far = (round(seconds / step_s) for seconds in BESIDE_S)
    added, with_row, observed, inside, hidden_frames = [], 0, 0, 0, 0
    gaps = [gap for gap in gaps if gap[0] >= far and gap[-1] + far < len(frames)]
    for gap in gaps:
        hidden_frames += len(gap)
        before, after = (mean_error(frames, rows, beside) for beside in (range(gap[0] - far, gap[0] - near),
                                                                       range(gap[-1] + near + 1, gap[-1] + far + 1)))
        for place, at in enumerate(gap):
            true = frames[at]["tools"][0]
            row = rows.get((frames[at]["frame"], true["tool"]))
            if row is None:
                continue
            with_row += 1
            observed += row["state"] == "observed"
            inside += is_inside(error_of(true, row), row)
            if before and after:
                share = (place + 1) / (len(gap) + 1)
                added.append([error - (1 - share) * b - share * a for error, b, a in zip(parts(true, row), before, after)])
    along, across = ((rms(values) for values in zip(*added)) if added else (None, None))
    return dict(name=scene.name, path=path, gaps=len(gaps), frames=hidden_frames, with_row=with_row, observed=observed,
                inside=inside, along=along, across=across, verdict=verdict)


def gaps_of(frames):
    """Runs of indices of frames with a hidden tip."""
    gaps = []
    for at, frame in enumerate(frames):
        if frame["tools"][0]["visible"] < SEEN:
            if gaps and gaps[-1][-1] == at - 1:
                gaps[-1].append(at)
            else:
                gaps.append([at])
    return gaps


def mean_error(frames, rows, indices):
    """Mean error along and across the axis over these frames; None if fewer than half of them have a row."""
    errors = [parts(true, row) for at in indices
              if (row := rows.get((frames[at]["frame"], (true := frames[at]["tools"][0])["tool"])))]
    return [fmean(values) for values in zip(*errors)] if 2 * len(errors) >= len(indices) else None


def parts(true, row):
    """The error along the axis in space, and across it in the picture, mm."""
    _, axis, side = directions(true)
    error = error_of(true, row)
    return dot(error, axis), dot(error, side)


def is_inside(error, row):
    """Whether an error lies inside its stated 95 % region."""
    xx, xy, xz, yy, yz, zz = (float(row[f"cov_{key}_mm2"]) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
    covariance = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    determinant = dot(covariance[0], cross(covariance[1], covariance[2]))
    inverse = [cross(covariance[1], covariance[2]), cross(covariance[2], covariance[0]), cross(covariance[0], covariance[1])]
    return sum(dot(error, column) * value for column, value in zip(inverse, error)) / determinant <= 7.8147


def hidden_goals(gaps):
    smoothed = [of_path for of_path in gaps if of_path["path"] == "smoothed"]
    name = "bare tool, tip hidden for half a second: error added"
    return [hidden_goal(f"{name} along the axis, smoothed, mm", smoothed, "along", MOST_ALONG_MM),
            hidden_goal(f"{name} across the axis in the picture, smoothed and causal, mm", gaps, "across", MOST_ACROSS_MM)]


def hidden_goal(name, gaps, key, most):
    reached = " · ".join(f"{of_path['name']}, {of_path['path']} {said(of_path[key])} ({of_path['with_row']} of "
                         f"{of_path['frames']} frames)" for of_path in gaps)
    return Goal(name, f"≤ {most}", reached, all(of_path[key] is not None and of_path[key] <= most for of_path in gaps))


def hidden_row(of_path):
    count = of_path["with_row"]
    return [of_path["name"], of_path["path"], *(str(of_path[key]) for key in ("gaps", "frames", "with_row", "observed")),
            f"{100 * of_path['inside'] / count:.0f} %" if count else "–", said(of_path["along"]), said(of_path["across"]),
            of_path["verdict"].replace("_", " ")]


def said(value):
    return "–" if value is None else f"{value:.2f}"


# ── vectors ─────────────────────────────────────────────────────────────────────────────────────────────────────────────────────


def directions(true):
    """Unit vectors: along the line of sight to the true tip, along the axis, and across the axis in the picture."""
    ray, axis = unit(true["tip_mm"]), true["axis"]
    return ray, axis, unit(cross(ray, axis))


def error_of(true, row):
    return [float(row[f"{key}_mm"]) - value for key, value in zip("xyz", true["tip_mm"])]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a):
    length = math.hypot(*a)
    return [value / length for value in a]


def rms(values):
    return math.sqrt(fmean(value * value for value in values))
