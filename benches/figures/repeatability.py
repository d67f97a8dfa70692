"""The thesis's repeatability (T 7.1.3): slides along one guide, and the distance of each slide's points from the lines of the
others."""
from programs import Goal, Part, table

THESIS_MM = {"top": 7, "side": 12}
MOST_MM = {"top": 0.5, "side": 0.8}


def measure(bench, scenes):
    rendered = [scene for scene in scenes.rendered if scene.name in ("V3", "V4", "V5")]
    tracks = [tracked(bench, scene) for scene in rendered]
    rows = [("top", scene.name, bench.repeatability(track)) for scene, track in zip(rendered, tracks)]
    if len(tracks) > 1:
        rows.append(("top", "V3 to V5, there and back", bench.repeatability(*tracks)))
    for view in ("top", "side"):
        rows.append((view, f"own slide, {view}", bench.repeatability(tracked(bench, scenes.simulated("slide", view)))))
    about = ("Repeatability: a line is fitted to each slide. *To others*: mean distance of the other slides' points from the line. *To its "
             "own*: mean distance of the slide's own points. Each direction of motion is a slide of its own, unless the row says "
             "otherwise. Hands wobble by up to 0.3 mm on the guide.")
    cells = [[name, str(r["paths"]), f"{r['others_mm']:.2f} mm", f"{r['own_mm']:.2f} mm"] for _, name, r in rows]
    return Part([goal(view, rows) for view in MOST_MM], [about, table(["slides", "number", "to others", "to its own"], cells)])


def tracked(bench, scene):
    track, _ = bench.track(scene, bench.calibrate(scene))
    return track


def goal(view, rows):
    of_view = [(name, r["others_mm"]) for seen, name, r in rows if seen == view]
    reached = " · ".join(f"{name} {value:.2f}" for name, value in of_view)
    return Goal(f"repeatability, {view} view, mm (thesis: {THESIS_MM[view]})", f"≤ {MOST_MM[view]}", reached,
                all(value <= MOST_MM[view] for _, value in of_view))
