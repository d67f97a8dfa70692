"""Checks the error bars of features on simulated people of three levels, in six boxes, tracked from their rendered clips.

Each feature of the tracked path, with its error bar, is compared with the same feature of the true path, which knows nothing of
the track: a tool counts as observed on each frame with at least VISIBLE of its band in view. The size of the errors was fitted on other
scenes (`measurement/src/motion/features`), with none of these seeds.
"""
import csv
import json
from collections import Counter

from programs import VISIBLE, Goal, Part, output, table

# Seed, level, task, view. The boxes are used in rotation.
PEOPLE = [(401 + n, level, task, view) for n, (level, task, view) in enumerate(
    (level, task, view) for task, view in [("pegs", "top"), ("crossing", "side"), ("pegs", "side"), ("wire", "top")]
    for level in ("novice", "intermediate", "expert"))]
BOXES = 6
POSITION = ["frame", "time_s", "tool", "x_mm", "y_mm", "z_mm", "state"]


def measure(bench, scenes):
    people = PEOPLE[:2] if bench.quick else PEOPLE
    cases = [case for n, person in enumerate(people) for case in cases_of(bench, scenes.person(*person, box=1 + n % BOXES))]
    inside, all_of = Counter(), Counter()
    for name, is_inside in cases:
        all_of[name] += 1
        inside[name] += is_inside
    share = 100 * inside.total() / max(all_of.total(), 1)
    worst = sorted(all_of, key=lambda name: inside[name] / all_of[name])
    about = (f"Features of {len(people)} simulated people (three levels, {len({p[2:] for p in people})} tasks and views, {BOXES} boxes), tracked "
             "from rendered clips: share of the values with the true path's value inside the error bar. The worst first.")
    rows = [[name, str(all_of[name]), f"{100 * inside[name] / all_of[name]:.0f} %"] for name in worst]
    goal = Goal("true features inside the stated 95 %", "95 ± 3 %", f"{share:.1f} % of {all_of.total()}", 92 <= share <= 98)
    return Part([goal], [about, table(["feature", "values", "inside"], rows)])


def cases_of(bench, scene):
    """Name of each feature with an error bar, and whether the true value lies inside."""
    track, _ = bench.track(scene, bench.calibrate(scene))
    truth = scene.out / "truth.csv"
    write_truth(scene.truth, truth)
    seen, true = (features(bench, path) for path in (track, truth))
    for key, value in seen.items():
        if value["low"] is not None and true.get(key, {}).get("value") is not None:
            yield value["name"], value["low"] <= true[key]["value"] <= value["high"]


def write_truth(truth, out):
    """Writes the true positions of the tools on the frames where they are in view."""
    with open(out, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(POSITION)
        for frame in json.loads(truth.read_text())["frames"]:
            for tool in frame["tools"]:
                if tool["visible"] >= VISIBLE:
                    writer.writerow([frame["frame"], frame["time_s"], tool["tool"], *tool["tip_mm"], "observed"])


def features(bench, path):
    session, = output(bench.trocar, "score", "--json", path)
    return {(value["name"], value["tool"], value["space"]): value for value in session["features"]}
