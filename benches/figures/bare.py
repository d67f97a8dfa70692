"""Tools without tape in scenes of SHARED/worlds, and in more of them that its renderer has made: judged with the true camera by
SHARED/worlds/judge.py, beside the two reference methods.

More scenes: `python3 SHARED/worlds/renderer/worlds.py open --kind bare --only 0-41 --out FOLDER`, then `--more-worlds FOLDER`.
"""
from statistics import median

from programs import Goal, Part, table
from worlds import number, percent

METHODS = {"ours": "Trocar", "mixture": "Framework 1", "zhou": "Zhou & Payandeh"}
HEAD = ["scene", "grade", "view", "verdict", "tool", "mm", "shown", "found", "across", "along", "σ", "in 95 %", "in 99.9 %",
        "axis: picture", "camera", "false"]
METHODS_HEAD = ["scenes", "method", "tools", "shown", "found", "in space", "rows", "across", "along", "axis: picture",
                "camera", "false", "swaps"]
SMALL_MM = 5.0


def measure(bench, scenes):
    folders = bench.worlds("bare")
    judged = bench.bare_judged(folders[:2] if bench.quick else folders, bench.folder("bare"))
    about = (f"Bare tools: {len(judged)} worlds with tools that have no tape, {len(opened(judged))} of them `open`, tracked "
             "with the true camera. All lengths in mm, all angles in degrees. *mm*: diameter of the tube. *Shown*: frames "
             "where the tip and at least 40 mm of the shaft show. *Found*: share of them with a measured tip within 3 mm "
             "across the line of sight and an axis within 2° in the picture. *Across*, *along*: RMS error across and along "
             "the line of sight, on frames where at least half of the last 40 mm of the shaft and its end show. *σ*: median "
             "stated standard deviation along it. *Axis*: RMS error of the axis in the picture and towards the camera. "
             "*False*: rows on nothing. *Silently wrong* (bold) as for tapes. `open` scenes are not among those of "
             "`../shared`: its renderer made them. Some thresholds were chosen with all of these scenes in view "
             "([method.md](method.md#36-bare-shafts)), so new ones must still prove these figures.")
    compared = ("Reference methods beside Trocar on the same scenes, refused ones included: a reference method refuses "
                "nothing and states no errors. *In space*: *found*, with the axis within 2° in space instead of the "
                "picture. *Rows*: measured ones on all frames. RMS errors are those of all rows on frames that count, wrong "
                "ones included.")
    return Part(goals(judged), [about, table(HEAD, [row for scene in judged for row in rows(scene)]),
                                compared, table(METHODS_HEAD, method_rows(judged))])


def goals(judged):
    usual = [scene for scene in judged if scene["grade"] != "hard"]
    return [found_goal(usual), *error_goals(kept(usual)), *honesty_goals(kept(judged)), axis_goal(kept(usual)),
            refused_goal(judged), *(reference_goal(usual, method) for method in METHODS if method != "ours")]


def opened(scenes):
    """The scenes that are not SHARED's own."""
    return [scene for scene in scenes if scene["scene"].startswith("open-")]


def kept(scenes):
    return [scene for scene in scenes if not scene["refused"]]


def tools_of(scenes, method="ours"):
    return [tool for scene in scenes for tool in scene["methods"][method]]


def tracked(scenes, method="ours"):
    """Tools with measured rows on frames that count. The others have no errors."""
    return [tool for tool in tools_of(scenes, method) if tool["rows"]]


def found_share(tools, key="found_where_shown"):
    shown = sum(tool["shown"] for tool in tools)
    return sum(tool[key] for tool in tools) / shown if shown else 0


def pooled(tools, key):
    """RMS of all rows of these tools together; None without any."""
    count = sum(tool["rows"] for tool in tools)
    return (sum(tool[key] ** 2 * tool["rows"] for tool in tools) / count) ** 0.5 if count else None


def found_goal(scenes):
    tools = tools_of(scenes)
    shown, rows, false, swaps = (sum(tool[key] for tool in tools) for key in ("shown", "measured", "false", "swaps"))
    share, in_kept = found_share(tools), found_share(tools_of(kept(scenes)))
    false_share = 100 * false / max(rows, 1)
    return Goal("bare worlds, true camera, easy and ordinary: tool found (axis within 2°, tip within 3 mm across) where "
                "≥ 40 mm of shaft show; false rows; swaps", "≥ 97 %; ≤ 0.1 %; 0",
                f"{100 * share:.1f} % of {shown} ({100 * in_kept:.1f} % in scenes not refused); {false_share:.2f} % of {rows}; "
                f"{swaps}",
                share >= 0.97 and false_share <= 0.1 and swaps == 0)


def error_goals(scenes):
    of = "bare worlds, easy and ordinary, not refused: RMS error across; along the line of sight, mm"
    tools = tracked(scenes)
    small = [tool for tool in tools if tool["diameter_mm"] <= SMALL_MM]
    large = [tool for tool in tools if tool["diameter_mm"] > SMALL_MM]
    return [error_goal(f"{of}, 5 mm tools", small, 0.4, 3), error_goal(f"{of}, 8 and 10 mm tools", large, 0.2, 1.5)]


def error_goal(name, tools, most_across, most_along):
    goal = f"≤ {most_across}; ≤ {most_along}"
    if not tools:
        return Goal(name, goal, "no tool", None)
    across, along = (pooled(tools, key) for key in ("across", "along"))
    middle = "; ".join(f"{median(tool[key] for tool in tools):.2f}" for key in ("across", "along"))
    return Goal(name, goal, f"{across:.2f}; {along:.2f} (all rows of {len(tools)} tools; median of the tools {middle})",
                across <= most_across and along <= most_along)


def honesty_goals(scenes):
    tools = tracked(scenes)
    silent = [scene["scene"] for scene in scenes if scene["silent"]]
    rows = sum(tool["rows"] for tool in tools)
    wrong = Goal("bare worlds: silently wrong scenes", "0 of those not refused",
                 f"{len(silent)} of {len(scenes)}" + (f": {', '.join(silent)}" if silent else ""), not silent if scenes else None)
    if not rows:
        return [wrong]
    share = 100 * sum(tool["in95"] * tool["rows"] for tool in tools) / rows
    width = median(tool["width"] for tool in tools)
    return [Goal("bare worlds, not refused: rows inside the stated 95 % region", "≥ 92 %", f"{share:.1f} % of {rows}",
                 share >= 92),
            wrong,
            Goal("bare worlds, not refused: stated 3-D σ ÷ 3-D RMS error, median of tools", "0.8–1.5", f"{width:.2f}",
                 0.8 <= width <= 1.5)]


def axis_goal(scenes):
    picture, camera = (pooled(tracked(scenes), key) for key in ("axis_picture", "axis_camera"))
    name = "bare worlds, easy and ordinary, not refused: RMS error of the axis in the picture; towards the camera"
    goal = "≤ 0.3°; ≤ 1.2°"
    if picture is None:
        return Goal(name, goal, "no tool", None)
    return Goal(name, goal, f"{picture:.2f}°; {camera:.2f}°", picture <= 0.3 and camera <= 1.2)


def refused_goal(judged):
    usual, hard = ([scene for scene in judged if (scene["grade"] == "hard") == is_hard] for is_hard in (False, True))
    reached = "; ".join(f"{len(scenes) - len(kept(scenes))} of {len(scenes)}" for scenes in (usual, hard))
    return Goal("bare worlds: refused: easy and ordinary; hard", "none set", reached, None)


def reference_goal(scenes, method):
    tools = tools_of(scenes, method)
    across, along = (pooled(tracked(scenes, method), key) for key in ("across", "along"))
    rows, false = (sum(tool[key] for tool in tools) for key in ("measured", "false"))
    errors = "no rows" if across is None else f"{across:.1f}; {along:.1f} mm"
    return Goal(f"{METHODS[method]} as written, same scenes: tool found; RMS error across; along; false rows", "none set",
                f"{100 * found_share(tools):.1f} %; {errors}; {false} of {rows}", None)


def rows(scene):
    first = [scene["scene"], scene["grade"], scene["view"], scene["verdict"].replace("_", " ")]
    for tool in scene["methods"]["ours"]:
        name = f"**{tool['tool']}**" if tool["silent"] else tool["tool"]
        found = tool["found_where_shown"] / tool["shown"] if tool["shown"] else None
        yield [*first, name, f"{tool['diameter_mm']:g}", str(tool["shown"]), percent(found),
               *(number(tool.get(key)) for key in ("across", "along", "sigma")),
               *(percent(tool.get(key)) for key in ("in95", "in99")),
               *(number(tool.get(key)) for key in ("axis_picture", "axis_camera")), str(tool["false"])]
        first = [""] * 4


def method_rows(judged):
    """All methods on groups of scenes: by grade, and the rendered ones by the parity of their number."""
    is_open = opened(judged)
    groups = {"easy and ordinary": [scene for scene in judged if scene["grade"] != "hard"],
              "hard": [scene for scene in judged if scene["grade"] == "hard"],
              "SHARED": [scene for scene in judged if scene not in is_open],
              "open, even": [scene for scene in is_open if int(scene["scene"][-2:]) % 2 == 0],
              "open, odd": [scene for scene in is_open if int(scene["scene"][-2:]) % 2 == 1]}
    for group, scenes in groups.items():
        if scenes:
            yield method_row(f"{group} ({len(scenes)})", "Trocar", scenes, "ours")
            not_refused = kept(scenes)
            if not_refused:
                yield method_row("", f"Trocar, {len(not_refused)} not refused", not_refused, "ours")
            for method, name in list(METHODS.items())[1:]:
                yield method_row("", name, scenes, method)


def method_row(group, name, scenes, method):
    tools, with_rows = tools_of(scenes, method), tracked(scenes, method)
    shown, count, false, swaps = (str(sum(tool[key] for tool in tools)) for key in ("shown", "measured", "false", "swaps"))
    found = (f"{100 * found_share(tools, key):.1f} %" for key in ("found_where_shown", "found_in_space"))
    return [group, name, str(len(tools)), shown, *found, count,
            *(number(pooled(with_rows, key)) for key in ("across", "along", "axis_picture", "axis_camera")), false, swaps]
