"""Scenes of SHARED/worlds with bands: an independent renderer drew boxes, tools, light and cameras at random. Judged with the
true camera by SHARED/worlds/judge.py."""
import json
from statistics import median, quantiles

from programs import WORLD_PICTURE, Goal, Part, run, table

HEAD = ["scene", "grade", "view", "verdict", "tool", "seen", "found", "RMS", "across", "along", "σ", "in 95 %", "in 99.9 %",
        "false"]
WORST = 3


def measure(bench, scenes):
    folders = bench.worlds("band")
    out = bench.folder("worlds")
    judged = bench.judged(folders[:4] if bench.quick else folders, out)
    worst = sorted(kept(judged), key=lambda scene: max(map(badness, scene["tools"])), reverse=True)[:WORST]
    pictures = [picture(bench, out, scene, place + 1) for place, scene in enumerate(worst)]
    about = ("Worlds: boxes, tools, light and cameras drawn at random by an independent renderer, tracked with the true camera. "
             "All lengths in mm. *Seen*: frames with at least half of the band and half of its last 3 mm in view. *Found*: share "
             "of them with the tip within 5 mm. *RMS*: 3-D RMS error. *Across*, *along*: RMS error across and along the line of "
             "sight. *σ*: median stated standard deviation along it. *In 95 %*, *in 99.9 %*: share of the rows inside these "
             "stated regions. *False*: rows on nothing. *Silently wrong* (bold): not refused, and under 80 % of a tool's rows "
             "are inside the 99.9 % region.")
    tables = [about, table(HEAD, [row for scene in judged for row in rows(scene)]), worst_text(worst, pictures)]
    return Part(goals(judged), tables, [str(path) for path, _ in pictures])


def goals(judged):
    usual, hard = ([scene for scene in judged if (scene["grade"] == "hard") == is_hard] for is_hard in (False, True))
    return [*honesty_goals(kept(judged)), *error_goals(kept(usual)), found_goal(usual, kept(hard)), refused_goal(usual, hard),
            false_goal(judged)]


def kept(scenes):
    return [scene for scene in scenes if not scene["refused"]]


def tools_of(scenes):
    return [tool for scene in scenes for tool in scene["tools"]]


def tracked(scenes):
    """Tools with measured rows on frames that count. The others have no errors."""
    return [tool for tool in tools_of(scenes) if tool["rows"]]


def honesty_goals(scenes):
    silent = [scene["scene"] for scene in scenes if scene["silent"]]
    tools = tracked(scenes)
    rows = sum(tool["rows"] for tool in tools)
    share = 100 * sum(tool["in95"] * tool["rows"] for tool in tools) / rows
    low = sum(tool["in95"] < 0.8 for tool in tools)
    width = median(tool["width"] for tool in tools)
    return [Goal("worlds, true camera: silently wrong scenes", "0 of those not refused",
                 f"{len(silent)} of {len(scenes)}" + (f": {', '.join(silent)}" if silent else ""), not silent),
            Goal("worlds, not refused: rows inside the stated 95 % region; tools with under 80 % of them", "≥ 92 %; ≤ 1 in 10",
                 f"{share:.1f} % of {rows}; {low} of {len(tools)}", share >= 92 and 10 * low <= len(tools)),
            Goal("worlds, not refused: stated 3-D σ ÷ 3-D RMS error, median of tools", "0.8–1.5", f"{width:.2f}",
                 0.8 <= width <= 1.5)]


def error_goals(scenes):
    tools = tracked(scenes)
    errors = [tool["rms"] for tool in tools]
    middle, high = median(errors), quantiles(errors, n=10, method="inclusive")[-1]
    across = median(tool["across"] for tool in tools)
    of = "worlds, easy and ordinary, not refused"
    return [Goal(f"{of}: 3-D RMS error of a tool, mm: median; 90 % of the tools", "≤ 0.8; ≤ 2.0",
                 f"{middle:.2f}; {high:.2f} ({len(tools)} tools)", middle <= 0.8 and high <= 2),
            Goal(f"{of}: RMS error across the line of sight, mm, median of tools", "≤ 0.15", f"{across:.3f}", across <= 0.15)]


def found_goal(usual, hard):
    shares = [100 * sum((tool["found"] or 0) * tool["seen"] for tool in tools) / max(1, sum(tool["seen"] for tool in tools))
              for tools in map(tools_of, (usual, hard))]
    return Goal("worlds: tips found within 5 mm: easy and ordinary; hard, not refused", "≥ 97 %; ≥ 90 %",
                "; ".join(f"{share:.1f} %" for share in shares), shares[0] >= 97 and shares[1] >= 90)


def refused_goal(usual, hard):
    of_usual, of_hard = ([scene["scene"] for scene in scenes if scene["refused"]] for scenes in (usual, hard))
    reached = "; ".join(f"{len(names)} of {len(scenes)}" + (f" ({', '.join(names)})" if names else "")
                        for names, scenes in ((of_usual, usual), (of_hard, hard)))
    return Goal("worlds: refused: easy and ordinary; hard", "0; ≤ half", reached, not of_usual and 2 * len(of_hard) <= len(hard))


def false_goal(scenes):
    rows, false, swaps = (sum(tool[key] for tool in tools_of(scenes)) for key in ("rows", "false", "swaps"))
    in_kept = sum(tool["false"] for tool in tools_of(kept(scenes)))
    return Goal("worlds: rows on nothing; on the other tool", "≤ 0.1 %; 0",
                f"{100 * false / rows:.2f} % of {rows} ({in_kept} of {false} in scenes not refused); {swaps}",
                false <= 0.001 * rows and swaps == 0)


def rows(scene):
    first = [scene["scene"], scene["grade"], scene["view"], scene["verdict"].replace("_", " ")]
    for tool in scene["tools"]:
        cells = [number(tool.get(key)) for key in ("rms", "across", "along", "sigma")]
        regions = [percent(tool.get(key)) for key in ("in95", "in99")]
        name = f"**{tool['tool']}**" if tool["silent"] else tool["tool"]
        yield [*first, name, str(tool["seen"]), percent(tool["found"]), *cells, *regions, str(tool["false"])]
        first = [""] * 4


def number(value):
    return "–" if value is None else f"{value:.2f}"


def percent(share):
    return "–" if share is None else f"{100 * share:.0f} %"


def badness(tool):
    """How many times its stated σ a tool's RMS error is. Its square is the mean square error ÷ the stated variance."""
    return 1 / tool["width"] if tool["rows"] else 0


def picture(bench, out, scene, place):
    """A picture of the worst tool of a scene, and the errors in it."""
    worst = max(scene["tools"], key=badness)
    path = out / f"worlds_worst_{place}.jpg"
    run([bench.python, WORLD_PICTURE, bench.shared / "worlds", scene["folder"], out / scene["scene"] / "o.csv",
         scene["tools"].index(worst), worst["tool"], path])
    return path, json.loads(path.with_suffix(".json").read_text())


def worst_text(worst, pictures):
    lines = []
    for scene, (path, shown) in zip(worst, pictures):
        tool = max(scene["tools"], key=badness)
        lines.append(f"- {scene['scene']}, {tool['tool']}: RMS error {badness(tool):.1f} × σ. Frame {shown['frame']}: off by "
                     f"{shown['across_mm']:.2f} mm across and {shown['along_mm']:+.2f} mm along the line of sight.\n"
                     f"  ![{scene['scene']}, frame {shown['frame']}: true and tracked band](images/{path.name})")
    return ("Worst worlds: of the scenes that are not refused, those with a tool whose 3-D RMS error is the largest multiple of "
            "its median stated 3-D σ. Each picture shows the frame with the largest error for its stated covariance: the true "
            "band's outline, axis and tip in green, the tracked one's in magenta.\n\n" + "\n".join(lines))
