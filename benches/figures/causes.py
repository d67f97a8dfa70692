"""What the depth error depends on: scenes of SHARED/worlds rendered again with one effect of sensor or video off, and with
rectangles that other hands draw. Judged with the true camera by SHARED/worlds/judge.py.

A scene takes about ten minutes to render. Its clips are kept for later runs (`cause_clips.py`).
"""
import hashlib

from programs import CAUSE_CLIPS, Goal, Part, run, table

SCENES = [2, 6, 9, 10, 34, 41]  # easy or ordinary, seen from above
FRAMES = 110  # the length of the longest of these scenes but band10, which is cut
SETS = 10
MAX_SPREAD_MM, MAX_SHIFT_MM = 0.3, 0.5


def measure(bench, scenes):
    results = {f"band{index:02}": judged(bench, index) for index in (SCENES[:1] if bench.quick else SCENES)}
    about = ("Causes: scenes of the worlds rendered again, tracked with the true camera. All lengths in mm. *Full clip*: mean "
             f"depth error of each tool. *Rectangles*: its spread (largest less smallest) over {SETS} sets of rectangles that "
             "other hands draw on the full clip. *Without*, *all off*: its shift with one effect of sensor or video off, or all. "
             "Of two tools, the larger value. –: the scene does not have the effect, or its full clip is refused.")
    effects = sorted({name for result in results.values() for name in result if name.startswith(("without", "all-off"))})
    rows = [["full clip", *(errors_cell(result["all-on"]) for result in results.values())],
            ["rectangles", *(spread_cell(result) for result in results.values())],
            *([words(name), *(shift_cell(result, name) for result in results.values())] for name in effects)]
    return Part([spread_goal(results), shift_goal(results)], [about, table(["cause", *results], rows)])


def judged(bench, index):
    """The judge's figures of a scene's clips, by the names of their folders."""
    frames, sets = (10, 2) if bench.quick else (FRAMES, SETS)
    renderer = bench.shared / "worlds" / "renderer"
    sources = sorted(path for path in renderer.iterdir() if path.suffix in (".py", ".cpp", ".inc"))
    made_of = hashlib.sha256(b"".join(path.read_bytes() for path in sources) + repr((frames, sets)).encode()).hexdigest()[:12]
    clips = bench.folder(f"causes/{made_of}/band{index:02}")
    if not (clips / "ready").exists():
        run([bench.python, CAUSE_CLIPS, renderer, index, clips, frames, sets])
    folders = sorted(path for path in clips.iterdir() if (path / "truth.json").exists())
    figures = bench.judged(folders, bench.folder(f"causes/tracks/band{index:02}"))
    return {folder.name: clip for folder, clip in zip(folders, figures)}


def errors(clip):
    """Mean depth error of each tool, mm; empty if the clip is refused."""
    return {} if clip["refused"] else {tool["tool"]: tool["bias_along"] for tool in clip["tools"] if tool["rows"]}


def spread(result):
    """The largest spread of a tool's mean depth error over the sets of rectangles, mm. None: fewer than two sets to compare."""
    sets = [errors(clip) for clip in marked_again(result)]
    of_tools = [[error[tool] for error in sets if tool in error] for tool in set().union(*sets)]
    return max((max(values) - min(values) for values in of_tools if len(values) > 1), default=None)


def marked_again(result):
    return [clip for name, clip in result.items() if name.startswith("rectangles")]


def shift(result, name):
    """The largest shift of a tool's mean depth error against the full clip, mm. None: nothing to compare."""
    full, other = errors(result["all-on"]), errors(result[name]) if name in result else {}
    return max((other[tool] - full[tool] for tool in full if tool in other), key=abs, default=None)


def spread_goal(results):
    reached = " · ".join(f"{scene} {spread_cell(result)}" for scene, result in results.items())
    known = [value for value in map(spread, results.values()) if value is not None]
    return Goal(f"causes: spread of the mean depth error over {SETS} sets of rectangles, mm", f"≤ {MAX_SPREAD_MM}", reached,
                bool(known) and max(known) <= MAX_SPREAD_MM)


def shift_goal(results):
    worst = {}
    for scene, result in results.items():
        shifts = {name: shift(result, name) for name in result if name.startswith("without")}
        shifts = {name: value for name, value in shifts.items() if value is not None}
        worst[scene] = max(shifts.items(), key=lambda item: abs(item[1]), default=None)
    reached = " · ".join(f"{scene} " + (f"{item[1]:+.2f} ({words(item[0])})" if item else "refused")
                         for scene, item in worst.items())
    known = [abs(item[1]) for item in worst.values() if item]
    return Goal("causes: largest shift of the mean depth error with one effect of sensor or video off, mm", f"≤ {MAX_SHIFT_MM}",
                reached, bool(known) and max(known) <= MAX_SHIFT_MM)


def words(name):
    """The name of a clip's folder in words."""
    return name.replace("-", " ").replace("_", " ")


def errors_cell(clip):
    means = " · ".join(f"{tool['bias_along']:+.2f}" for tool in clip["tools"] if tool["rows"]) or "–"
    return f"{means} (refused)" if clip["refused"] else means


def spread_cell(result):
    value, sets = spread(result), marked_again(result)
    refused = sum(clip["refused"] for clip in sets)
    return ("–" if value is None else f"{value:.2f}") + (f" ({refused} of {len(sets)} refused)" if refused else "")


def shift_cell(result, name):
    if name in result and result[name]["refused"] and not result["all-on"]["refused"]:
        return "refused"
    value = shift(result, name)
    return "–" if value is None else f"{value:+.2f}"
