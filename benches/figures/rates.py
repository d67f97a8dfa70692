"""Checks that features do not depend on the frame rate: the same performance at 25 and at 50 frames per second, and with a tenth
of the frames lost.

Two values of a feature agree if they differ by no more than their combined error bars: the root of the sum of squares of the two
halves that face each other, because the errors of different pictures are independent.
"""
import json
from collections import Counter

from features import features
from programs import Goal, Part, run, table

# Seed, level, task, view, box. `features.py` uses none of these.
PEOPLE = [(501, "novice", "pegs", "top", 2), (502, "intermediate", "crossing", "side", 3), (503, "expert", "wire", "top", 4)]
# Of every OF frames, LOST are lost, far apart and at uneven distances.
STEP, OF, LOST = 617, 101, 10
WAYS = {"50 frames per second": lambda scenes, person: scenes.person(*person, fps=50),
        "a tenth of the frames lost": lambda scenes, person: with_losses(scenes, person)}


def measure(bench, scenes):
    people = PEOPLE[:1] if bench.quick else PEOPLE
    agree, all_of = Counter(), Counter()
    rows, goals = [], []
    for way, scene_of in WAYS.items():
        for person in people:
            for name, does in compared(bench, scenes.person(*person), scene_of(scenes, person)):
                all_of[way, name] += 1
                agree[way, name] += does
        found, values = (sum(count for (of, _), count in counts.items() if of == way) for counts in (agree, all_of))
        share = 100 * found / max(values, 1)
        apart = [f"{name} ({all_of[key] - agree[key]} of {all_of[key]})" for key in all_of if (name := key[1]) and key[0] == way
                 and agree[key] < all_of[key]]
        rows.append([way, str(values), f"{share:.1f} %", ", ".join(apart) or "–"])
        goals.append(Goal(f"features agree within their error bars: 25 frames per second and {way}", "≥ 95 %",
                          f"{share:.1f} % of {values}", share >= 95))
    about = (f"Features of {len(people)} simulated people at 25 frames per second, compared with a second recording of the same "
             "performance: share of the values that agree within their error bars, and the features that do not.")
    return Part(goals, [about, table(["second recording", "values", "agree", "do not agree"], rows)])


def compared(bench, one, other):
    """Name of each feature that both scenes have with an error bar, and whether the two values agree."""
    first, second = (features(bench, bench.track(scene, bench.calibrate(scene))[0]) for scene in (one, other))
    for key, value in first.items():
        if value["low"] is not None and second.get(key, {}).get("low") is not None:
            below, above = sorted((value, second[key]), key=lambda of: of["value"])
            room = ((below["high"] - below["value"]) ** 2 + (above["value"] - above["low"]) ** 2) ** 0.5
            yield value["name"], above["value"] - below["value"] <= room


def with_losses(scenes, person):
    """The clip at 25 frames per second with a tenth of its frames removed; marked frames stay."""
    whole = scenes.person(*person)
    lossy = scenes.beside(whole, "with losses")
    if not lossy.video.exists():
        marks = json.loads(whole.annotations.read_text())
        marked = sorted({label["frame"] for label in marks["labels"]})
        for label in marks["labels"]:
            label["frame"] -= sum(is_lost(frame, person[0]) and frame not in marked for frame in range(label["frame"]))
        lossy.annotations.write_text(json.dumps(marks))
        is_marked = "+".join(f"eq(n,{frame})" for frame in marked)
        kept = f"select='gte(mod({STEP}*n+{person[0]},{OF}),{LOST})+{is_marked}'"
        run(["ffmpeg", "-v", "error", "-y", "-i", whole.video, "-vf", kept, "-fps_mode", "passthrough", "-c:v", "libx264", "-qp", 10,
             "-pix_fmt", "yuv420p", lossy.video])
    return lossy


def is_lost(frame, seed):
    return (STEP * frame + seed) % OF < LOST
