"""Checks the model of skill on people it has not seen. The people are simulated, of three levels, rendered and tracked.

Each person has individual skill: the figures of their level, each multiplied by a factor that only the simulator knows
(`measurement/src/simulation/skill.rs`). The model gets only features and declared levels. A second test shuffles the levels
between people; then the model must report that it knows nothing.
"""
import csv
import json
import os
import random
from concurrent.futures import ThreadPoolExecutor

from programs import Goal, Part, output, run, table

LEVELS = ["novice", "intermediate", "expert"]
EACH, SESSIONS, BOXES = 10, 2, 6
PEOPLE = [(n, LEVELS[n % 3]) for n in range(3 * EACH)]
FIRST_SEED = 1001
SHUFFLES = 5


def measure(bench, scenes):
    sessions = [(person, level, session) for person, level in PEOPLE for session in range(1 if bench.quick else SESSIONS)]
    with ThreadPoolExecutor(os.cpu_count()) as at_once:
        tracks = list(at_once.map(lambda case: tracked(bench, scenes, *case), sessions))
    folder = bench.work / ("quick" if bench.quick else "full") / "skill"
    folder.mkdir(parents=True, exist_ok=True)
    features = folder / "features.json"
    features.write_text(json.dumps(output(bench.trocar, "score", "--json", *tracks)))
    whose = list(zip(tracks, sessions))
    report = trained(bench, folder, "declared", features, [(track, person, level) for track, (person, level, _) in whose])
    dice = random.Random(1)
    shuffled = [trained(bench, folder, f"shuffled {n}", features, labels)
                for n, labels in enumerate(shuffles(dice, whose))]
    return Part([known(report), unknown(shuffled)], [about(report), confusion(report)])


def tracked(bench, scenes, person, level, session):
    seed = FIRST_SEED + 10 * person + session
    scene = scenes.hands(seed, level, FIRST_SEED + person, box=1 + person % BOXES)
    return bench.track(scene, scene.true_camera)[0]


def shuffles(dice, whose):
    """Labels with the levels shuffled between people."""
    for _ in range(SHUFFLES):
        levels = [level for _, level in PEOPLE]
        dice.shuffle(levels)
        yield [(track, person, levels[person]) for track, (person, _, _) in whose]


def trained(bench, folder, name, features, labels):
    """The report of `trocar model`."""
    path = folder / f"{name.replace(' ', '-')}.csv"
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["file", "person", "level"])
        writer.writerows(labels)
    model = path.with_suffix(".json")
    run([bench.trocar, "model", "--quiet", "--task", "pegs", "--labels", path, "--out", model, features])
    return json.loads(model.read_text())["report"]


def known(report):
    accuracy, baseline = report["accuracy"], report["baseline"]
    reached = (f"{percent(accuracy['value'])} ({percent(accuracy['low'])}–{percent(accuracy['high'])}) of the sessions of "
               f"{accuracy['people']} people; balanced {percent(report['balanced'])}, with shuffled levels {percent(baseline['mean'])} "
               f"(95 % of shuffles ≤ {percent(baseline['high'])}), p = {baseline['p']:.2f}")
    return Goal("level of simulated people left out of training", "beats shuffled levels, p ≤ 0.05", reached, report["knows"])


def unknown(reports):
    silent = sum(not report["knows"] for report in reports)
    chances = ", ".join(f"{report['baseline']['p']:.2f}" for report in reports)
    reached = f"{silent} of {len(reports)} know nothing; p = {chances}"
    return Goal("the same with levels shuffled between people", "model knows nothing (19 of 20)", reached, silent >= len(reports) - 1)


def about(report):
    speaking = report["speaking"]
    right = speaking["right"]
    worth = (f"For people left out of training, it would have given a level to {percent(speaking['share'])} of the sessions" +
             (f"; of these levels, {percent(right['value'])} ({percent(right['low'])}–{percent(right['high'])}) were right." if right
              else "."))
    learners = ", ".join(f"{each['learner']} {each['folds']}" for each in report["chosen"])
    return (f"Model of skill: {sum(report['people'])} simulated people ({EACH} of each level, {sum(report['sessions'])} sessions "
            f"of *pegs* in {BOXES} boxes, with the true camera), each with individual skill. Learners chosen in the outer folds: "
            f"{learners}. {worth} Rows: declared level. Columns: likeliest level, as a share of these people's sessions.")


def confusion(report):
    share = [{level: row[level] / people for level in LEVELS} for row, people in zip(report["confusion"], report["people"])]
    rows = [[level, *(percent(row[given]) for given in LEVELS)] for level, row in zip(LEVELS, share)]
    return table(["declared", *LEVELS], rows)


def percent(share):
    return f"{100 * share:.0f} %"
