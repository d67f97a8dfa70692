#!/usr/bin/env python3
"""Measures the figures of docs/accuracy.md on every scene with known truth.

Most parts work as a user would: calibrate → track → evaluate, with photos and annotations as the only inputs, beside the OpenCV
peer and the theoretical limits. Four parts use the true camera and the judge of SHARED/worlds: `worlds` and `bare` (scenes of an
independent renderer), `degraded` (copies that other programs have spoilt) and `causes` (scenes rendered again with one effect
off; the first run takes an hour and 2 GB of disk, and needs g++).

Usage: python3 benches/figures TROCAR SHARED WORK [--document docs/accuracy.md] [--only PART,…] [--kept] [--quick]
                               [--more-worlds FOLDER]

TROCAR is the release binary, SHARED the folder with `scenes/`, `peer/` and `worlds/`, WORK a folder for results. PART is a name
in `PARTS` below. The results of each part are stored in WORK. With `--kept`, a part is measured only if WORK has no results of
this binary and script; so timings can be measured alone, on a quiet machine. `--document` replaces the figures between two marks
in this file, and the pictures that they show in `images/` beside it: those of tapes if a part of tapes was measured, and those
of bare tools likewise. `--quick` runs each part once on short clips to check that it works; its figures are not for the
document. `--more-worlds` judges the worlds in this folder, too. Parts that need what SHARED does not have are skipped; the exit
status is then 1.
"""
import argparse
import hashlib
import json
import os
import shutil
import sys
from dataclasses import asdict
from pathlib import Path

import accuracy
import bad_case
import bare
import bare_cost
import bare_paths
import causes
import cost
import degraded
import features
import memory
import rates
import repeatability
import rest
import rivals
import skill
import worlds
from programs import ROUNDS, Bench, Goal, Part
from scenes import Scenes

TAPES = {"accuracy": accuracy, "worlds": worlds, "degraded": degraded, "rivals": rivals, "causes": causes,
         "repeatability": repeatability, "rest": rest, "bad": bad_case, "features": features, "rates": rates, "skill": skill,
         "cost": cost, "memory": memory}
BARE = {"bare": bare, "bare-paths": bare_paths, "bare-cost": bare_cost}
PARTS = {**TAPES, **BARE}
# Folders of SHARED that a part needs.
NEEDS = {"accuracy": ["scenes", "peer"], "worlds": ["worlds/dev"], "degraded": ["scenes", "worlds"],
         "rivals": ["scenes", "worlds/dev"], "causes": ["worlds/renderer"], "repeatability": ["scenes"], "bad": ["peer"],
         "cost": ["scenes", "peer"], "memory": ["peer"], "bare": ["worlds/dev"]}
HOW = "made by `make figures`; do not edit by hand -->"
# Parts that share a table of figures, and the marks around it in the document.
TABLES = [(TAPES, f"<!-- figures: {HOW}", "<!-- /figures -->"),
          (BARE, f"<!-- figures of bare tools: {HOW}", "<!-- /figures of bare tools -->")]


def main():
    options = arguments()
    bench = Bench(options.trocar.resolve(), options.shared, options.work, options.quick, options.more_worlds)
    skipped = [name for name in options.only if missing(options.shared, name)]
    warn_of(options.shared, skipped)
    scenes = Scenes(bench)
    measured = {name: part_of(bench, scenes, name, options.kept) for name in options.only if name not in skipped}
    for parts, begin, end in TABLES:
        of_table = {name: measured[name] for name in parts if name in measured}
        if not of_table:
            continue
        text = "\n\n".join([goals_table([goal for part in of_table.values() for goal in part.goals]),
                            *(table for part in of_table.values() for table in part.tables), note(bench, parts, of_table)])
        print(text)
        if options.document:
            pictures = [picture for part in of_table.values() for picture in part.pictures]
            replace(options.document, begin, end, text, pictures)
    warn_of(options.shared, skipped)
    sys.exit(1 if skipped else 0)


def part_of(bench, scenes, name, may_be_kept):
    part = kept(bench, name) if may_be_kept else None
    if part is None:
        print(f"… {name}", file=sys.stderr)
        part = PARTS[name].measure(bench, scenes)
        keep(bench, name, part)
    return part


def missing(shared, name):
    """Folders that a part needs and that are not there."""
    return [shared / folder for folder in NEEDS.get(name, []) if not (shared / folder).is_dir()]


def warn_of(shared, skipped):
    for name in skipped:
        print(f"SKIPPED: `{name}` needs {', '.join(map(str, missing(shared, name)))}, which is not there", file=sys.stderr)


def replace(document, begin, end, text, pictures):
    """Replaces the text between two marks of a document, and pictures in the folder `images` beside it."""
    before, rest_of_it = document.read_text().split(begin)
    after = rest_of_it.split(end)[1]
    document.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}")
    for picture in map(Path, pictures):
        shutil.copyfile(picture, document.parent / "images" / picture.name)


def arguments():
    parser = argparse.ArgumentParser(prog="figures", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trocar", type=Path)
    parser.add_argument("shared", type=Path)
    parser.add_argument("work", type=Path)
    parser.add_argument("--document", type=Path)
    parser.add_argument("--only", type=lambda names: names.split(","), default=list(PARTS))
    parser.add_argument("--kept", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--more-worlds", type=Path)
    options = parser.parse_args()
    if unknown := set(options.only) - set(PARTS):
        parser.error(f"unknown part: {', '.join(sorted(unknown))}; the parts are {', '.join(PARTS)}")
    if options.document and options.quick:
        parser.error("--document and --quick exclude each other: figures of short clips are not for the document")
    if options.document and (skipped := [name for name in options.only if missing(options.shared, name)]):
        parser.error(f"{options.shared} lacks what {', '.join(skipped)} need: give --only the others, or leave out --document")
    if options.more_worlds and not options.more_worlds.is_dir():
        parser.error(f"--more-worlds: {options.more_worlds} is not a folder")
    return options


def keep(bench, name, part):
    place(bench, name).write_text(json.dumps({"of": made_by(bench, name), **asdict(part)}))


def kept(bench, name):
    """The stored results of this part, if they are of this binary and script."""
    if not place(bench, name).exists():
        return None
    known = json.loads(place(bench, name).read_text())
    if known["of"] != made_by(bench, name):
        return None
    return Part([Goal(**goal) for goal in known["goals"]], known["tables"], known.get("pictures", []))


def place(bench, name):
    return bench.work / f"{name}{'-quick' if bench.quick else ''}.json"


def made_by(bench, name):
    """Hash of the binary and of the part's script."""
    sources = [bench.trocar, Path(PARTS[name].__file__)]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def goals_table(goals):
    rows = [f"| {goal.name} | {goal.goal} | {goal.reached} | {goal.verdict()} |" for goal in goals]
    return "\n".join(["| figure | goal | reached | |", "|---|---|---|---|", *rows])


def note(bench, parts, measured):
    missing_parts = ", ".join(f"`{name}`" for name in parts if name not in measured)
    return ("All figures use only photos and annotations, unless a row says otherwise. "
            f"{os.cpu_count()} cores; times are medians of {bench.rounds(ROUNDS)} interleaved rounds." +
            (f" Not measured for this table: {missing_parts}." if missing_parts else "") +
            (" QUICK: not for quoting." if bench.quick else ""))


if __name__ == "__main__":
    main()
