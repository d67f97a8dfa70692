"""Apparent speed of a resting tool: smoothed, as used for scores, and causal, as shown to live watchers."""
from programs import Goal, Part

KINDS = {"smoothed": ([], 1.0), "causal": (["--causal"], 4.0)}


def measure(bench, scenes):
    rests = [scenes.simulated("rest", view) for view in ("top", "side")]
    cameras = [bench.calibrate(scene) for scene in rests]
    return Part([goal(bench, kind, zip(rests, cameras)) for kind in KINDS])


def goal(bench, kind, rests):
    options, most = KINDS[kind]
    floors = {}
    for scene, camera in rests:
        track, _ = bench.track(scene, camera, f"{kind}.csv", options)
        floors[scene.name] = bench.evaluated(track, scene.truth)["at_rest"]
    reached = " · ".join(f"{name} {said(floor)}" for name, floor in floors.items())
    met = all(floor and floor["rms_mm_s"] <= most for floor in floors.values())
    return Goal(f"speed of a resting tool, {kind}, mm/s: RMS (median)", f"≤ {most:g}", reached, met)


def said(floor):
    return f"{floor['rms_mm_s']:.2f} ({floor['median_mm_s']:.2f})" if floor else "too few rows"
